/** Which guides are drawn over the picture. They stay in this browser. */

import { button, choice, h, toggle } from "./dom.js";
import { ASPECTS, nearestAxis, tiltOf } from "./guides.js";

const SQUEEZES = [1, 1.25, 1.33, 1.5, 1.8, 2].map((each) => ({ value: String(each), label: each === 1 ? "None" : `${each}×` }));
const ROLL = 10; // degrees for a step of the move
const KEPT = "rptcam-guides";
const LINES = [
  { name: "thirds", label: "Thirds", key: "g" },
  { name: "centre", label: "Centre" },
  { name: "safe", label: "Safe frames" },
  { name: "circle", label: "Image circle" },
  { name: "level", label: "Level" },
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
    this.squeeze = choice("De-squeeze", SQUEEZES, (value) => this.change({ squeeze: value }), { value: this.shown.squeeze ?? "1", name: "squeeze" });
    this.straighten = button("Straighten", () => link.ask("move", { kind: "roll", dx: -this.shown.tilt.roll / ROLL, dy: 0, dz: 0 }).catch(() => {}), { name: "straighten", title: "Turn the camera about its view until it is level" });
    link.on("hello", () => { this.vertical = null; });
    link.on("state", ({ camera }) => camera && this.tilt(camera));
    this.note = h("p", { class: "vf-note" });
    link.on("state", ({ guides }) => guides !== undefined && this.circle(guides?.image_circle ?? null));
    this.angles = h("p", { class: "vf-note", "data-name": "angles" });
    stage.show(this.shown);
    stage.widen(Number(this.shown.squeeze ?? 1));
  }

  /** What is level goes by the axis of the scene that up was nearest to when this page came. */
  tilt(camera) {
    this.vertical ??= nearestAxis(camera.up);
    const tilt = tiltOf(camera, this.vertical);
    this.shown.tilt = tilt;
    this.straighten.disabled = !tilt || Math.abs(tilt.roll) < 0.01;
    this.angles.textContent = tilt ? `Turned by ${tilt.roll.toFixed(1)}°, looks ${tilt.pitch < 0 ? "down" : "up"} by ${Math.abs(tilt.pitch).toFixed(1)}°.` : "The camera looks straight up or down.";
    this.stage.show({ tilt });
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
    if (what.squeeze) this.stage.widen(Number(what.squeeze));
    try {
      localStorage.setItem(KEPT, JSON.stringify({ ...this.shown, tilt: null }));
    } catch { /* then they are forgotten */ }
  }

  /** Press the first button, as its key does. */
  thirds() {
    this.buttons[0].click();
  }

  panel() {
    return h("div", { class: "vf-panel" },
      h("h2", {}, "Lines"), h("div", { class: "vf-row" }, this.buttons), this.note,
      h("div", { class: "vf-row" }, this.straighten), this.angles,
      h("h2", {}, "Frame lines"), this.aspect, h("div", { class: "vf-row" }, this.lines),
      h("h2", {}, "Anamorphic"), this.squeeze);
  }
}
