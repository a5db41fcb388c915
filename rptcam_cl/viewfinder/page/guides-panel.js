/** Which guides are drawn over the picture. They stay in this browser. */

import { choice, h, toggle } from "./dom.js";
import { ASPECTS } from "./guides.js";

const KEPT = "rptcam-guides";
const LINES = [
  { name: "thirds", label: "Thirds", key: "g" },
  { name: "centre", label: "Centre" },
  { name: "safe", label: "Safe frames" },
  { name: "circle", label: "Image circle" },
];

function kept() {
  try {
    return JSON.parse(localStorage.getItem(KEPT)) ?? {};
  } catch {
    return {}; // a browser that keeps nothing
  }
}

export class Guides {
  constructor(link, stage) {
    this.stage = stage;
    this.shown = { aspect: "", ...kept() };
    this.buttons = LINES.map(({ name, label, key }) => toggle(label, (on) => this.change({ [name]: on }), { key, name, pressed: Boolean(this.shown[name]) }));
    this.lines = toggle("Lines only", (on) => this.change({ lines: on }), { name: "lines", pressed: Boolean(this.shown.lines) });
    this.aspect = choice("Aspect mask", ASPECTS, (value) => this.change({ aspect: value }), { value: this.shown.aspect, name: "aspect" });
    this.note = h("p", { class: "vf-note" });
    link.on("state", ({ guides }) => guides !== undefined && this.circle(guides?.image_circle ?? null));
    stage.show(this.shown);
  }

  circle(found) {
    this.stage.show({ imageCircle: found });
    this.note.textContent = found
      ? `The lens lights a circle of ${Math.round(200 * found.rx)} % of the picture's width.`
      : "This camera has no image circle: nothing limits its field.";
  }

  change(what) {
    this.shown = { ...this.shown, ...what };
    this.stage.show(what);
    try {
      localStorage.setItem(KEPT, JSON.stringify(this.shown));
    } catch { /* then they are forgotten */ }
  }

  /** Press the first button, as its key does. */
  thirds() {
    this.buttons[0].click();
  }

  panel() {
    return h("div", { class: "vf-panel" },
      h("h3", {}, "Lines"), h("div", { class: "vf-row" }, this.buttons), this.note,
      h("h3", {}, "Frame lines"), this.aspect, h("div", { class: "vf-row" }, this.lines));
  }
}
