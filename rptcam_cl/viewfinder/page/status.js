/** The line above the picture: scene, connection, and what the picture is worth: scale, samples, time, noise. */

import { h } from "./dom.js";
import { digits, percent, reduction } from "./numbers.js";

const READINGS = [
  { name: "scale", label: "scale", title: "Rendered samples against the full resolution" },
  { name: "spp", label: "spp", title: "Samples per pixel" },
  { name: "ms", label: "ms", title: "Time of this picture" },
  { name: "noise", label: "noise", title: "Relative standard error of the picture" },
];

/** What a person sees of the noise: when the picture will be clean, by the samples or by the clock. */
export function noiseWords(noise, spp, target, clean) {
  if (!clean) return noise === null || noise === undefined ? "–" : percent(noise);
  if (clean.noise <= 0.02) return "clean";
  if (spp >= target) return "grainy";
  if (clean.spp > target) return `clean at ${digits(clean.spp, 2)} samples`;
  return `clean at about ${clean.seconds < 90 ? `${digits(clean.seconds, 2)}\u00a0s` : `${digits(clean.seconds / 60, 2)}\u00a0min`}`;
}

export class Status {
  constructor(link, stage) {
    this.stage = stage;
    this.lamp = h("i", { class: "vf-link", "data-state": "connecting" });
    this.words = h("span", { class: "vf-link-words", role: "status" });
    this.name = h("span", {}, "Viewfinder");
    this.values = Object.fromEntries(READINGS.map(({ name }) => [name, h("dd", { "data-reading": name }, "–")]));
    const list = h("dl", { class: "vf-readings", "aria-label": "Picture" },
      READINGS.map(({ name, label, title }) => h("div", { title }, h("dt", {}, label), this.values[name])));
    this.lacking = h("span", { class: "vf-lacks", hidden: true, title: "A saved picture has it; it is added to the picture at rest once it is computed" });
    this.denoised = h("span", { class: "vf-lacks vf-denoised", hidden: true, title: "Noise is taken out of what is shown, until it is not seen any more. Saved files never have that. n switches it off" }, "denoised");
    this.busyWords = h("span", {});
    this.busy = h("p", { class: "vf-busy", role: "status", hidden: true }, h("i", {}), this.busyWords);
    this.messages = h("p", { class: "vf-messages", role: "status", hidden: true });
    this.element = h("header", { class: "vf-top" }, h("h1", { class: "vf-name" }, this.lamp, this.name), this.words, this.busy, this.denoised, this.lacking, list);
    link.on("link", ({ state, words }) => this.connection(state, words));
    link.on("hello", ({ scene, device }) => this.opened(scene, device));
    link.on("painted", (header) => this.painted(header));
    link.on("state", (state) => this.standing(state));
    link.on("busy", ({ texts }) => this.working(texts));
    link.on("link", () => this.working([]));
  }

  connection(state, words) {
    this.lamp.dataset.state = state;
    this.lamp.title = words;
    this.words.textContent = state === "open" ? "" : words;
  }

  opened(scene, device) {
    this.name.textContent = scene;
    this.name.title = `${scene}, rendered by ${device}`;
  }

  /** The one sign of all that runs beside the frames. */
  working(texts) {
    this.busy.hidden = texts.length === 0;
    this.busyWords.textContent = texts.join(", ");
  }

  standing({ messages = [], paused, changed = [] }) {
    const words = [paused ? "Paused: press space to go on" : null, ...messages].filter(Boolean);
    this.messages.hidden = words.length === 0;
    this.messages.textContent = words.join(" · ");
    this.name.classList.toggle("vf-changed", changed.length > 0);
  }

  painted({ kind, slot, scale, spp, target_spp: target, ms, noise, stale, moving, width, height, lacks = [], denoised, clean_at: clean }) {
    if (kind !== "picture") return;
    if (slot === "A") {
      this.values.scale.textContent = reduction(scale);
      this.values.scale.classList.toggle("vf-reduced", scale < 0.99);
      this.values.spp.textContent = target > 1 ? `${spp}\u2009/\u2009${target}` : String(spp);
      this.values.ms.textContent = digits(ms, 3);
      this.lacking.hidden = lacks.length === 0;
      this.lacking.textContent = `without ${lacks.join(", ")}`;
      this.denoised.hidden = !denoised;
      this.values.noise.textContent = noiseWords(noise, spp, target, clean);
      this.values.noise.parentElement.title = `Relative standard error of the picture${noise ? `: ${percent(noise)}` : ""}${clean ? `; of most pixels, as seen: ${percent(clean.noise)}, of which less than 2\u00a0% is not seen` : ""}`;
    }
    const words = `Picture ${slot}, ${width} by ${height} pixels, scale ${reduction(scale)}, ${spp} samples per pixel`;
    this.stage.panes[slot].describe(words + (stale ? ", of an older setting" : "") + (moving ? ", moving" : "") + (denoised ? ", denoised" : "") + (lacks.length ? `, without ${lacks.join(", ")}` : ""));
    this.stage.panes[slot].element.classList.toggle("vf-stale", Boolean(stale));
  }
}
