/** Waveform, RGB parade and vectorscope of the picture as it is shown. */

import { choice, h } from "./dom.js";

const SCOPES = [
  { value: "histogram", label: "Histogram" },
  { value: "waveform", label: "Wave" },
  { value: "parade", label: "Parade" },
  { value: "vectorscope", label: "Vector" },
];
const NAMES = { waveform: "Waveform: luma from left to right", parade: "Parade: red, green and blue from left to right", vectorscope: "Vectorscope: hue around, saturation outwards" };
const COLUMNS = 256; // of the picture that is counted
const ROWS = 144;
const LEVELS = 128;
const PAUSE = 120; // [ms] between two scopes of a picture that moves
// Luma and colour difference of Rec. 709 from the codes of the picture (ITU-R BT.709-6, item 3).
const LUMA = [0.2126, 0.7152, 0.0722];
const CHANNELS = [[1, 0.35, 0.3], [0.3, 1, 0.4], [0.4, 0.55, 1]];
const SKIN = (123 * Math.PI / 180); // the hue of skin, from +Cb towards +Cr

/** Counts of levels by column, from the bottom up: (levels × columns), from pixels of four codes. `of(r, g, b)` is 0 to 255. */
export function columnCounts(data, width, of, levels = LEVELS) {
  const counts = new Uint32Array(levels * width);
  for (let i = 0; i < data.length; i += 4) {
    const level = Math.min(levels - 1, Math.max(0, Math.floor((of(data[i], data[i + 1], data[i + 2]) * levels) / 256)));
    counts[(levels - 1 - level) * width + ((i / 4) % width)] += 1;
  }
  return counts;
}

/** Where a colour of codes lies in the vectorscope: Cb to the right, Cr upwards, from −0.5 to 0.5. */
export function chroma(r, g, b) {
  const y = LUMA[0] * r + LUMA[1] * g + LUMA[2] * b;
  return [(b - y) / 1.8556 / 255, (r - y) / 1.5748 / 255];
}

function brightness(count, most) {
  return count ? Math.min(1, 0.25 + Math.sqrt(count / most)) : 0;
}

function painted(context, counts, width, height, colour, left = 0) {
  const image = context.createImageData(width, height);
  const most = Math.max(1, counts.reduce((a, b) => Math.max(a, b), 0) / 4);
  counts.forEach((count, i) => {
    const light = 255 * brightness(count, most);
    for (let channel = 0; channel < 3; channel += 1) image.data[4 * i + channel] = light * colour[channel];
    image.data[4 * i + 3] = 255;
  });
  context.putImageData(image, left, 0);
}

function vectorCounts(data, side) {
  const counts = new Uint32Array(side * side);
  for (let i = 0; i < data.length; i += 4) {
    const [cb, cr] = chroma(data[i], data[i + 1], data[i + 2]);
    counts[Math.min(side - 1, Math.floor((0.5 - cr) * side)) * side + Math.min(side - 1, Math.floor((0.5 + cb) * side))] += 1;
  }
  return counts;
}

function graticule(context, side) {
  const at = (cb, cr) => [(0.5 + cb) * side, (0.5 - cr) * side];
  context.strokeStyle = context.fillStyle = "#aeb2b9";
  context.lineWidth = 1;
  context.beginPath();
  context.arc(side / 2, side / 2, side / 2 - 1, 0, 2 * Math.PI);
  context.moveTo(side / 2, side / 2);
  context.lineTo(...at(0.48 * Math.cos(SKIN), 0.48 * Math.sin(SKIN)));
  for (const [r, g, b] of [[1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1], [1, 0, 1]]) { // of 75 %
    const [x, y] = at(...chroma(191 * r, 191 * g, 191 * b));
    context.rect(x - 4, y - 4, 8, 8);
  }
  context.stroke();
}

function lines(context, width, height) {
  context.fillStyle = "#747b8688";
  for (const share of [0, 0.25, 0.5, 0.75, 1]) context.fillRect(0, Math.round((height - 1) * share), width, 1);
}

export class Scopes {
  /** `histogram`: the element that a scope takes the place of. */
  constructor(link, stage, histogram) {
    Object.assign(this, { link, stage, histogram, scope: "histogram", at: -PAUSE });
    this.choice = choice("Scope", SCOPES, (value) => this.use(value), { value: "histogram", name: "scope" });
    this.canvas = h("canvas", { width: COLUMNS, height: LEVELS, role: "img", "data-name": "scope-canvas" });
    this.figure = h("figure", { class: "vf-exposure vf-scope", hidden: true }, this.canvas);
    this.element = h("div", { class: "vf-scopes" }, this.choice, histogram, this.figure);
    this.small = h("canvas", { width: COLUMNS, height: ROWS });
    link.on("painted", ({ kind, slot }) => kind === "picture" && slot === "A" && this.soon());
  }

  use(scope) {
    this.scope = scope;
    this.choice.show(scope);
    this.histogram.hidden = scope !== "histogram";
    this.figure.hidden = scope === "histogram";
    if (scope !== "histogram") this.draw();
  }

  next() {
    const at = SCOPES.findIndex(({ value }) => value === this.scope);
    this.use(SCOPES[(at + 1) % SCOPES.length].value);
  }

  /** Draw once the picture is painted; several times a second while it moves. */
  soon() {
    if (this.scope === "histogram" || this.due) return;
    this.due = setTimeout(() => {
      this.due = null;
      this.draw();
    }, Math.max(0, this.at + PAUSE - performance.now()));
  }

  draw() {
    const picture = this.stage.panes.A.layers.get("picture");
    if (this.scope === "histogram" || picture.width < 2) return;
    this.at = performance.now();
    const small = this.small.getContext("2d", { willReadFrequently: true });
    small.drawImage(picture, 0, 0, COLUMNS, ROWS);
    const { data } = small.getImageData(0, 0, COLUMNS, ROWS);
    const side = this.scope === "vectorscope" ? 200 : 0;
    this.canvas.width = side || (this.scope === "parade" ? 3 * COLUMNS : COLUMNS);
    this.canvas.height = side || LEVELS;
    const context = this.canvas.getContext("2d");
    if (this.scope === "vectorscope") {
      painted(context, vectorCounts(data, side), side, side, [0.8, 1, 0.8]);
      graticule(context, side);
    } else if (this.scope === "waveform") {
      painted(context, columnCounts(data, COLUMNS, (r, g, b) => LUMA[0] * r + LUMA[1] * g + LUMA[2] * b), COLUMNS, LEVELS, [0.8, 1, 0.8]);
    } else {
      CHANNELS.forEach((colour, i) => painted(context, columnCounts(data, COLUMNS, (...codes) => codes[i]), COLUMNS, LEVELS, colour, i * COLUMNS));
    }
    if (!side) lines(context, this.canvas.width, this.canvas.height);
    this.canvas.classList.toggle("vf-square", side > 0);
    this.canvas.setAttribute("aria-label", NAMES[this.scope]);
  }
}
