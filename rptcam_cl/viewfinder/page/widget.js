/** The viewfinder in a notebook: the same page over the messages of a Jupyter widget. */

import { Viewfinder } from "./app.js";

/** A transport over a widget's messages. Each view of a widget is a client of its own. */
class Comm {
  constructor(model) {
    this.model = model;
    this.view = [...crypto.getRandomValues(new Uint8Array(12))].map((byte) => byte.toString(16)).join("-");
    this.onmessage = () => {};
    this.onstate = () => {};
    this.listener = (message, buffers) => this.receive(message, buffers ?? []);
  }

  open() {
    this.model.on("msg:custom", this.listener);
    this.onstate("connecting", "Connecting to the kernel");
    this.send(JSON.stringify({ type: "ping" }));
  }

  receive({ view, text, gone }, buffers) {
    if (view !== this.view) return;
    if (this.isSilent) this.onstate("open", "Connected");
    this.isSilent = false;
    if (gone) this.onstate("refused", gone);
    else if (text !== undefined) this.onmessage(text);
    else for (const buffer of buffers) this.onmessage(buffer);
  }

  /** Wait for a kernel that does not answer: what it was asked waits there, and its answer shows that it is back. */
  silent() {
    this.isSilent = true;
    this.onstate("lost", "The kernel does not answer: it computes a cell, or has ended.");
  }

  send(text) {
    this.model.send({ view: this.view, text });
  }

  close() {
    this.model.off("msg:custom", this.listener);
    this.model.send({ view: this.view, closed: true });
  }
}

/** Called by the notebook for each view of the widget. */
export function render({ model, el }) {
  const root = document.createElement("div");
  root.dataset.jpSuppressContextMenu = "true";
  // Keys pressed here are not the notebook's. JupyterLab listens before the page does, and looks at what has the focus.
  root.addEventListener("focusin", ({ target }) => { target.dataset.lmSuppressShortcuts = "true"; });
  for (const type of ["keydown", "keypress", "keyup"]) root.addEventListener(type, (event) => event.stopPropagation()); // others listen after it
  el.append(root);
  const comm = new Comm(model);
  const finder = new Viewfinder(root, comm);
  comm.open();
  return () => {
    finder.link.close();
    comm.close();
  };
}
