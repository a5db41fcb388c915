/** The viewfinder in a notebook: the same page over the messages of a Jupyter widget. */

import { Viewfinder } from "./app.js";

const PULSE = 20000; // [ms] between signs of life; the kernel forgets a view that gives none

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
    this.pulse = setInterval(() => this.send(JSON.stringify({ type: "ping" })), PULSE);
  }

  receive({ view, text, gone }, buffers) {
    if (view !== this.view) return;
    if (gone) this.onstate("refused", gone);
    else if (text !== undefined) this.onmessage(text);
    else for (const buffer of buffers) this.onmessage(buffer);
  }

  send(text) {
    this.model.send({ view: this.view, text });
  }

  close() {
    clearInterval(this.pulse);
    this.model.off("msg:custom", this.listener);
    this.model.send({ view: this.view, closed: true });
  }
}

/** Called by the notebook for each view of the widget. */
export function render({ model, el }) {
  const root = document.createElement("div");
  el.append(root);
  const comm = new Comm(model);
  new Viewfinder(root, comm);
  comm.open();
  return () => comm.close();
}
