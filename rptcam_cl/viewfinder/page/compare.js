/** Two settings beside one another or with a wipe, the map of their difference and its numbers. */

import { button, choice, h, newId, toggle } from "./dom.js";
import { digits, signed } from "./numbers.js";

const MODES = [{ value: "off", label: "Off" }, { value: "side", label: "Side by side" }, { value: "wipe", label: "Wipe" }];
const MODELS = [
  { model: "thin_lens", label: "Thin lens" },
  { model: "thick_lens", label: "Thick lens" },
  { model: "pinhole", label: "Pinhole" },
];
const NUMBERS = {
  relmse: ["Relative mean square error", (value) => digits(value, 3)],
  mean_stops: ["Mean of differences", (value) => `${digits(value, 2)} EV`],
  bias_stops: ["B is brighter by", (value) => `${signed(value, 2)} EV`],
  worst_stops: ["Greatest difference", (value) => `${digits(value, 2)} EV`],
};

/** Key paths and values from lines like "camera.f_number = 8"; values as in YAML: numbers, words, JSON. */
export function changesOf(text) {
  const changes = {};
  for (const line of text.split("\n").map((each) => each.trim()).filter(Boolean)) {
    const found = /^([\w.]+)\s*[=:]\s*(.+)$/.exec(line);
    if (!found) throw new Error(`${line}: write a key, an equals sign and a value, as camera.f_number = 8`);
    try {
      changes[found[1]] = JSON.parse(found[2]);
    } catch {
      changes[found[1]] = found[2];
    }
  }
  return changes;
}

export class Compare {
  constructor(link, stage) {
    Object.assign(this, { link, stage, mode: "off", model: null, difference: false });
    this.modes = choice("Compare", MODES, (value) => this.set({ mode: value }), { value: "off", name: "compare" });
    const id = newId("changes");
    this.text = h("textarea", { id, rows: 3, spellcheck: "false", "data-name": "changes", placeholder: "camera.f_number = 8" });
    this.form = h("div", { class: "vf-field vf-tall" }, h("label", { for: id }, "What B changes, a line each"), this.text);
    this.map = toggle("Difference map", (pressed) => this.set({ difference: pressed }), { name: "difference" });
    this.canvas = h("canvas", { width: 16, height: 9, role: "img", "aria-label": "Map of the difference" });
    this.legend = h("figcaption", { class: "vf-legend" });
    this.figure = h("figure", { class: "vf-difference", hidden: true }, this.canvas, this.legend);
    this.numbers = h("dl", { class: "vf-list", "data-name": "numbers" });
    this.words = h("p", { class: "vf-note", role: "status" }, "A is the picture as it is. B is the same with the changes that you name.");
    stage.others.set("difference", (header, bitmap) => this.draw(header, bitmap));
    link.on("state", ({ compare }) => compare && this.standing(compare));
  }

  /** Another page, or this one before a reload, has changed what is compared. */
  standing({ mode, difference = false, model = null, changes = {} }) {
    if (this.asking || (mode === this.mode && difference === this.difference)) return;
    Object.assign(this, { mode, difference, model });
    this.text.value = Object.entries(changes).map(([key, value]) => `${key} = ${JSON.stringify(value)}`).join("\n");
    this.shown(changes);
  }

  /** Show what is in force. */
  shown(changes) {
    this.stage.arrange(this.mode);
    this.modes.show(this.mode);
    this.map.show(this.difference);
    this.figure.hidden = this.numbers.hidden = !this.difference || this.mode === "off";
    this.words.textContent = this.mode === "off" ? "Nothing is compared." : this.named(changes);
  }

  async set(what) {
    const before = { mode: this.mode, model: this.model, difference: this.difference };
    Object.assign(this, what);
    this.asking = true;
    try {
      const changes = changesOf(this.text.value);
      await this.link.ask("compare", { mode: this.mode, difference: this.difference && this.mode !== "off", changes, model: this.model });
      this.shown(changes);
    } catch (problem) {
      Object.assign(this, before);
      this.shown({});
      this.words.textContent = problem.message;
    } finally {
      this.asking = false;
    }
  }

  named(changes) {
    const model = MODELS.find((each) => each.model === this.model)?.label;
    const keys = Object.entries(changes).map(([key, value]) => `${key} = ${typeof value === "string" ? value : JSON.stringify(value)}`);
    return `B: ${[model, ...keys].filter(Boolean).join(", ") || "the same as A"}`;
  }

  /** Compare with a setting at once, with the wipe unless the pictures lie side by side already. */
  preset({ model = null, text = "" }) {
    this.text.value = text;
    this.set({ model, mode: this.mode === "off" ? "wipe" : this.mode });
  }

  /** Go on to the next way to compare, as the key does. */
  next() {
    const at = MODES.findIndex((each) => each.value === this.mode);
    this.set({ mode: MODES[(at + 1) % MODES.length].value });
  }

  draw(header, bitmap) {
    this.canvas.width = bitmap.width;
    this.canvas.height = bitmap.height;
    this.canvas.getContext("2d").drawImage(bitmap, 0, 0);
    const rows = Object.entries(header.numbers ?? {}).filter(([name]) => name in NUMBERS);
    this.numbers.replaceChildren(...rows.map(([name, value]) => h("div", {}, h("dt", {}, NUMBERS[name][0]), h("dd", {}, NUMBERS[name][1](value)))));
    this.canvas.setAttribute("aria-label", `Map of the difference; mean ${digits(header.numbers?.mean_stops ?? 0, 2)} EV`);
    this.legend.replaceChildren(...(header.legend ?? []).map(({ stops, colour }) => {
      const patch = h("i");
      patch.style.background = `rgb(${colour.join(",")})`;
      return h("span", {}, patch, `${signed(stops, 0)} EV`);
    }));
  }

  panel() {
    const presets = [
      ...MODELS.map((each) => button(each.label, () => this.preset(each), { name: each.model })),
      button("f/8", () => this.preset({ text: "camera.f_number = 8" }), { name: "f8" }),
    ];
    return h("div", { class: "vf-panel" },
      h("h2", {}, "Show"), this.modes, this.words,
      h("h2", {}, "B is A, but"), h("div", { class: "vf-row" }, presets), this.form,
      h("div", { class: "vf-row" }, button("Apply", () => this.set({ model: null, mode: this.mode === "off" ? "side" : this.mode }), { name: "apply" }), this.map),
      this.figure, this.numbers);
  }
}

