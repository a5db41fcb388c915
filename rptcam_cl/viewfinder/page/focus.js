/** Focusing: by a click, by the camera itself with its zones and the curve of its search; peaking and magnifier. */

import { button, h, range, select, toggle } from "./dom.js";
import { focusScale } from "./focus-scale.js";
import { digits, distance, percent } from "./numbers.js";
import { plot } from "./plots.js";

export const METHODS = [
  { value: "", label: "Of the scene, or hybrid" },
  { value: "contrast", label: "Contrast" },
  { value: "phase", label: "Phase detection" },
  { value: "hybrid", label: "Hybrid: phase, then contrast" },
  { value: "depth", label: "Distance by rays" },
  { value: "laplacian", label: "Sum-modified Laplacian" },
  { value: "variance", label: "Variance, as in the paper" },
];
/** The methods that the server has, with the words that are known for them. */
function named(methods) {
  const known = new Map(METHODS.map((each) => [each.value, each]));
  return [METHODS[0], ...methods.map((each) => known.get(each.value) ?? each)];
}

const HALF = 0.02; // of the picture's width: half the square that is drawn at a click

function square({ x, y }, state) {
  return { x0: x - HALF, x1: x + HALF, y0: y - HALF * 1.6, y1: y + HALF * 1.6, state };
}

function rectangle(zone, state) {
  const [x0, x1, y0, y1] = Array.isArray(zone) ? zone : [zone.x0, zone.x1, zone.y0, zone.y1];
  return { x0, x1, y0, y1, state };
}

export class Focus {
  constructor(link, stage, overlays, dials) {
    Object.assign(this, { link, stage, overlays, dials, zones: [] });
    this.result = h("p", { class: "vf-note", role: "status" }, "Click the picture to focus there.");
    this.curve = h("div", { class: "vf-chart" });
    this.method = select("Method", METHODS, () => {}, { value: "", name: "method" });
    this.start = button("Autofocus", () => this.auto(), { key: "f", name: "autofocus" });
    this.useZone = toggle("Zone at the last point", () => {}, { name: "zone" });
    link.on("hello", ({ methods }) => methods && this.method.fill(named(methods), ""));
    link.on("state", ({ focus }) => this.standing(focus));
    link.on("link", () => this.show([]));
    link.on("search", ({ curve }) => this.busy && curve.length > 1 && this.draw(curve));
  }

  standing(focus) {
    if (this.busy || this.zones.length || !focus?.zones?.length) return;
    this.show(focus.zones.map((zone) => rectangle(zone, "set")));
  }

  show(zones) {
    this.zones = zones;
    this.stage.show({ zones });
    clearTimeout(this.fading);
    if (zones.length && zones[0].state !== "busy") this.fading = setTimeout(() => this.show([]), 6000);
  }

  /** Focus at a point of the picture. */
  at(point) {
    this.point = point;
    return this.search(square(point, "busy"), this.link.ask("focus", { x: point.x, y: point.y }));
  }

  /** Let the camera focus by itself. */
  auto() {
    const { x, y } = this.point ?? { x: 0.5, y: 0.5 };
    const one = this.useZone.getAttribute("aria-pressed") === "true";
    const zone = square({ x, y }, "busy");
    const within = (value) => Math.min(1, Math.max(0, value));
    const zones = one ? [[zone.x0, zone.x1, zone.y0, zone.y1].map(within)] : null;
    const method = this.method.querySelector("select").value || null;
    return this.search(one ? zone : null, this.link.ask("autofocus", { method, zones }));
  }

  async search(zone, answer) {
    this.busy = answer;
    this.show(zone ? [zone] : []);
    this.result.textContent = "Focusing …";
    try {
      const report = await answer;
      if (this.busy === answer) this.found(report, zone);
    } catch (problem) {
      if (this.busy !== answer) return;
      this.result.textContent = problem.message;
      this.show(zone ? [{ ...zone, state: "failed" }] : []);
    } finally {
      if (this.busy === answer) this.busy = null;
    }
  }

  found(report, zone) {
    if (report.superseded) {
      this.result.textContent = "The search ended, as something else was changed.";
      this.show([]);
      return;
    }
    const sure = report.confidence === null || report.confidence === undefined ? "" : `, confidence ${percent(report.confidence)}`;
    this.result.textContent = report.failure || `${distance(report.distance_m)} by ${report.method}${sure}`;
    const state = report.failure ? "failed" : "found";
    const zones = report.zones?.length && !zone ? report.zones.map((each) => rectangle(each, state)) : [];
    this.show(zone ? [{ ...zone, state }] : zones);
    this.draw(report.curve ?? [], report.failure ? undefined : report.film_distance_mm);
  }

  /** Draw the probes of a search: contrast as a share of the greatest of its round, or how far the halves lie apart. */
  draw(curve, found) {
    const probes = curve.filter((each) => Number.isFinite(each.position) && Number.isFinite(each.score));
    const contrast = probes.filter((each) => each.quantity === "contrast");
    const shown = contrast.length > 1 ? contrast : probes;
    if (shown.length < 2) {
      const why = shown.length ? "One probe was enough: there is no curve." : "This method measures distances: it has no curve.";
      this.curve.replaceChildren(h("p", { class: "vf-note" }, why));
      return;
    }
    const rounds = Array.from(new Set(shown.map((each) => each.round)), (round) => {
      const own = shown.filter((each) => each.round === round).sort((a, b) => a.position - b.position);
      const scale = shown === contrast ? 100 / (Math.max(...own.map((each) => each.score)) || 1) : 1;
      return own.map((each) => [each.position, scale * each.score]);
    });
    const xs = rounds.flat().map(([x]) => x).concat(found ?? []);
    const ys = rounds.flat().map(([, y]) => y).concat(0);
    const text = (at) => at.toFixed(Math.max(0, 1 - Math.floor(Math.log10(Math.max(...xs) - Math.min(...xs) || 1))));
    const pad = (list) => (Math.max(...list) - Math.min(...list)) * 0.04 || 1;
    this.curve.replaceChildren(plot({
      title: `${shown.length} probes of the search` + (found ? `, which ends at ${digits(found)} mm` : ""),
      x: { from: Math.min(...xs) - pad(xs), to: Math.max(...xs) + pad(xs), label: "focus position, mm", text },
      y: { from: Math.min(...ys), to: Math.max(...ys) + pad(ys) },
      series: rounds.flatMap((points) => [{ points, kind: "vf-line-soft" }, { points, dots: true }]),
      marks: found ? [{ x: found }] : [],
    }));
  }

  panel(magnifier) {
    const level = range("Peaking above", {
      min: 0, max: 1, step: 0.05, value: 0.5, name: "peaking_level", text: (value) => percent(value),
      changed: (value) => this.link.soon("peaking", "view", { peaking_level: value }),
    });
    return h("div", { class: "vf-panel" },
      h("h2", {}, "Depth of field"), focusScale(this.link, (...how) => this.dials.turned(...how)),
      h("h2", {}, "Autofocus"), this.method,
      h("div", { class: "vf-row" }, this.start, this.useZone), this.result, this.curve,
      h("h2", {}, "By eye"),
      h("div", { class: "vf-row" }, this.overlays.button("peaking", "Peaking", "p"), magnifier.button, magnifier.levels), level);
  }
}
