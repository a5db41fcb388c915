/** The lens: its cross-section with the rays of the point under the pointer, its spot and MTF there, and its numbers. */

import { h, s } from "./dom.js";
import { digits, distance, percent } from "./numbers.js";
import { plot } from "./plots.js";

const MARGIN = 0.04; // of the length drawn

function path(points, across) {
  return points.map(([z, height], i) => `${i ? "L" : "M"}${across.x(z)} ${across.y(height)}`).join("");
}

/** The colour that a wavelength in nanometres has to the eye, roughly, light enough for a dark ground. */
export function wavelengthColour(nm) {
  const hues = [[400, 275], [450, 235], [490, 190], [530, 130], [570, 70], [600, 35], [650, 0], [750, 0]];
  const at = hues.findIndex(([from]) => nm < from);
  if (at <= 0) return `hsl(${at === 0 ? 275 : 0} 85% 70%)`;
  const [[low, a], [high, b]] = [hues[at - 1], hues[at]];
  return `hsl(${a + ((b - a) * (nm - low)) / (high - low)} 85% 68%)`;
}

function ends(section) {
  const outlines = [...section.surfaces, ...(section.glass ?? []), ...(section.stop ?? []), section.film].filter(Boolean);
  const points = outlines.flatMap((each) => each.points);
  const zs = [...points.map(([z]) => z), ...(section.axis ?? [])];
  const [low, high] = [Math.min(...zs), Math.max(...zs)];
  const margin = (high - low) * MARGIN;
  return { low: low - margin, high: high + margin, reach: 1.08 * Math.max(...points.map(([, height]) => Math.abs(height))) };
}

function scales({ low, high, reach }, width, tallest) {
  const scale = Math.min(width / (high - low), tallest / (2 * reach));
  const height = 2 * reach * scale;
  const left = (width - (high - low) * scale) / 2;
  return {
    height,
    x: (z) => (left + (z - low) * scale).toFixed(2),
    y: (value) => (height / 2 - value * scale).toFixed(2),
  };
}

function rayMarks(ray, across) {
  const line = s("path", { class: `vf-ray${ray.passed ? "" : " vf-ray-blocked"}`, d: path(ray.points, across) });
  line.style.stroke = wavelengthColour(ray.wavelength_nm);
  if (ray.passed) return [line];
  const [z, height] = ray.points[ray.points.length - 1];
  const mark = s("path", { class: "vf-blocked", d: `M${across.x(z)} ${across.y(height)}m-3-3l6 6m0-6l-6 6` },
    s("title", {}, `${ray.why ?? "blocked"} at surface ${ray.stopped_by}`));
  return [line, mark];
}

function pupilMarks(pupils, across) {
  return Object.entries(pupils ?? {}).filter(([, pupil]) => pupil && Number.isFinite(pupil.z_mm)).map(([name, { z_mm: z, radius_mm: radius }]) =>
    s("path", { class: `vf-pupil vf-pupil-${name}`, d: `M${across.x(z)} ${across.y(-radius)}V${across.y(radius)}` }, s("title", {}, `${name} pupil`)));
}

/** The cross-section as SVG, with rays in it. */
export function crossSection(section, rays = [], width = 352) {
  const across = scales(ends(section), width, 220);
  return s("svg", { class: "vf-section", viewBox: `0 0 ${width} ${across.height.toFixed(1)}`, role: "img", "aria-label": words(section, rays) },
    s("path", { class: "vf-axis-line", d: `M0 ${across.y(0)}H${width}` }),
    (section.glass ?? []).map((each) => s("path", { class: "vf-glass", d: `${path(each.points, across)}Z` })),
    pupilMarks(section.pupils, across),
    rays.flatMap((ray) => rayMarks(ray, across)),
    section.surfaces.map((each) => s("path", { class: "vf-surface", d: path(each.points, across) })),
    (section.stop ?? []).map((each) => s("path", { class: "vf-stop", d: path(each.points, across) }, s("title", {}, "stop"))),
    section.film && s("path", { class: "vf-film", d: path(section.film.points, across) }, s("title", {}, "film")));
}

function words(section, rays) {
  const blocked = rays.filter((ray) => !ray.passed);
  const where = [...new Set(blocked.map((ray) => ray.stopped_by))].join(", ");
  const live = rays.length ? `, ${rays.length} rays, ${blocked.length} blocked${blocked.length ? ` at surface ${where}` : ""}` : "";
  return `Cross-section of the lens with ${section.surfaces.length} surfaces${live}`;
}

function spotPlot({ points_um: points, rms_um: rms, colours = [] }) {
  const reach = Math.max(1, ...points.flat().map(Math.abs)) * 1.15;
  const side = 150;
  const at = (value) => (side / 2) * (1 + value / reach);
  return s("svg", { class: "vf-spot", viewBox: `0 0 ${side} ${side}`, role: "img", "aria-label": `Spot, ${digits(rms)} micrometres root mean square` },
    s("path", { class: "vf-grid", d: `M0 ${side / 2}H${side}M${side / 2} 0V${side}` }),
    s("circle", { class: "vf-rms", cx: side / 2, cy: side / 2, r: (rms / reach) * (side / 2) }),
    points.map(([x, y], i) => {
      const dot = s("circle", { class: "vf-spot-dot", cx: at(x).toFixed(1), cy: at(-y).toFixed(1), r: 1.3 });
      if (colours[i]) dot.style.fill = colours[i];
      return dot;
    }));
}

function mtfPlot({ frequencies, tangential, sagittal, tangential_limit: limit = [] }) {
  const points = (values) => frequencies.map((frequency, i) => [frequency, values[i]]).filter(([, value]) => Number.isFinite(value));
  return plot({
    title: "Modulation transfer at the pointer: tangential and sagittal over line pairs per millimetre",
    width: 196, height: 150,
    x: { from: 0, to: Math.max(...frequencies), label: "lp/mm" },
    y: { from: 0, to: 1, ticks: [0, 0.5, 1] },
    series: [{ points: points(limit), kind: "vf-line-soft" }, { points: points(tangential), kind: "vf-line-tangential" }, { points: points(sagittal), kind: "vf-line-sagittal" }],
  });
}

const NUMBERS = [
  ["Focal length", "focal_length_mm", (value) => `${digits(value, 4)}\u00a0mm`],
  ["As on 35 mm film", "equivalent_mm", (value) => `${digits(value)}\u00a0mm`],
  ["f-number", "f_number", (value) => `f/${digits(value)}`],
  ["Working f-number", "working_f_number", (value) => `f/${digits(value)}`],
  ["Entrance pupil", "entrance_pupil", (value) => `${digits(2 * value.radius_mm)} mm wide at ${digits(value.z_mm)}\u00a0mm`],
  ["Exit pupil", "exit_pupil", (value) => `${digits(2 * value.radius_mm)} mm wide at ${digits(value.z_mm)}\u00a0mm`],
  ["Sharp from", "near_m", distance],
  ["to", "far_m", distance],
  ["Hyperfocal", "hyperfocal_m", distance],
  ["Breathing against infinity", "breathing", (value) => percent(value, 3)],
  ["Field, diagonal", "field_degrees", (value) => `${digits(value)}°`],
];

export class LensView {
  constructor(link) {
    this.drawing = h("div", { class: "vf-chart" });
    this.field = h("p", { class: "vf-note" }, "Point at the picture: its rays through the lens appear here.");
    this.spot = h("div", { class: "vf-chart vf-pair" });
    this.list = h("dl", { class: "vf-list", "data-name": "lens-numbers" });
    link.on("lens", (message) => this.show(message));
  }

  show({ section, numbers, pointer }) {
    if (section) this.section = section;
    if (this.section?.film) this.drawing.replaceChildren(crossSection(this.section, pointer?.rays ?? []));
    else if (section) this.drawing.replaceChildren(h("p", { class: "vf-note" }, "This camera sees the whole sphere around it: there is no lens to draw."));
    if (numbers) this.numbers(numbers);
    if (pointer) this.pointer(pointer);
  }

  pointer({ rays = [], field_degrees: field, spot, mtf }) {
    const blocked = rays.filter((ray) => !ray.passed);
    const count = new Map();
    for (const ray of blocked) count.set(ray.stopped_by, (count.get(ray.stopped_by) ?? 0) + 1);
    const stopped = [...count].map(([surface, times]) => `${times} at ${surface}`).join(", ");
    this.field.textContent = `${Number.isFinite(field) ? `${digits(field)}° off the axis: ` : ""}${rays.length - blocked.length} of ${rays.length} rays pass${stopped ? `; blocked ${stopped}` : ""}`;
    this.spot.replaceChildren(...[
      spot?.points_um?.length && h("figure", {}, spotPlot(spot), h("figcaption", {}, `Spot, ${digits(spot.rms_um)}\u00a0µm RMS ±\u00a0${digits(100 * (spot.relative_error ?? 0))}\u00a0%`)),
      mtf?.frequencies?.length && h("figure", {}, mtfPlot(mtf), h("figcaption", {}, h("b", { class: "vf-tangential" }, "tangential"), " ", h("b", { class: "vf-sagittal" }, "sagittal"))),
    ].filter(Boolean));
  }

  numbers(numbers) {
    this.list.replaceChildren(...NUMBERS.filter(([, name]) => numbers[name] !== undefined && numbers[name] !== null)
      .map(([label, name, text]) => h("div", {}, h("dt", {}, label), h("dd", {}, text(numbers[name])))));
  }

  panel() {
    return h("div", { class: "vf-panel" }, h("h2", {}, "Cross-section"), this.drawing, this.field, this.spot, h("h2", {}, "Numbers"), this.list);
  }
}
