/** The states that were: undo and redo, a list with thumbnails, snapshots in a strip, and A against any of them. */

import { button, h } from "./dom.js";

export class History {
  constructor(link) {
    this.link = link;
    this.thumbs = new Map();
    this.states = h("ol", { class: "vf-past", "data-name": "states", "aria-label": "States, the newest first" });
    this.strip = h("ol", { class: "vf-strip", "data-name": "snapshots", "aria-label": "Snapshots" });
    this.undo = button("Undo", () => this.tell("undo"), { key: "Ctrl+Z", name: "undo" });
    this.redo = button("Redo", () => this.tell("redo"), { key: "Ctrl+Shift+Z", name: "redo" });
    link.on("history", (message) => this.show(message));
    link.on("thumb", ({ number, data }) => this.picture(number, data));
    link.on("hello", () => this.thumbs.clear());
  }

  tell(what, number = undefined) {
    this.link.ask("history", number === undefined ? { do: what } : { do: what, number }).catch(() => {}); // the message shows why
  }

  picture(number, data) {
    this.thumbs.set(number, `data:image/jpeg;base64,${data}`);
    for (const image of this.element.querySelectorAll(`img[data-number="${number}"]`)) image.src = this.thumbs.get(number);
  }

  thumb({ number }) {
    return h("img", { "data-number": number, alt: "", width: 64, height: 36, src: this.thumbs.get(number) ?? null });
  }

  against({ number }, words) {
    return h("button", { type: "button", class: "vf-button", "aria-label": `Compare with ${words}, as B`, on: { click: () => this.tell("compare", number) } }, "A/B");
  }

  show({ states = [], at, snapshots = [] }) {
    const focused = document.activeElement?.dataset?.go;
    this.undo.disabled = states.length === 0 || states[0].number === at;
    this.redo.disabled = states.length === 0 || states[states.length - 1].number === at;
    this.states.replaceChildren(...states.toReversed().map((state) => h("li", {}, h("button", {
      type: "button", class: "vf-button", "data-go": state.number, "aria-current": state.number === at ? "true" : null,
      on: { click: () => this.tell("go", state.number) },
    }, this.thumb(state), h("span", {}, state.label)), this.against(state, state.label))));
    this.strip.replaceChildren(...snapshots.map((state, i) => h("li", {},
      h("button", { type: "button", class: "vf-button", "aria-label": `Go to snapshot ${i + 1}, ${state.label}`, on: { click: () => this.tell("go", state.number) } }, this.thumb(state)),
      this.against(state, `snapshot ${i + 1}`),
      h("button", { type: "button", class: "vf-button", "aria-label": `Drop snapshot ${i + 1}`, on: { click: () => this.tell("drop", state.number) } }, "\u00d7"))));
    this.empty.hidden = snapshots.length > 0;
    if (focused) this.states.querySelector(`[data-go="${focused}"]`)?.focus();
  }

  panel() {
    this.empty = h("p", { class: "vf-note" }, "A snapshot keeps a state; A/B shows it beside the picture.");
    this.element = h("div", { class: "vf-panel" },
      h("div", { class: "vf-row" }, this.undo, this.redo, button("Snapshot", () => this.tell("snap"), { key: "b", name: "snap" })),
      h("h2", {}, "Snapshots"), this.empty, this.strip, h("h2", {}, "States"), this.states);
    return this.element;
  }
}
