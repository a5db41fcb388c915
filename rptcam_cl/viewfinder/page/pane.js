/** One picture on the stage: its layers one over the other, its guides, and what its scale is. */

import { h } from "./dom.js";
import { guidesDrawing } from "./guides.js";

const ORDER = ["picture", "overlay/false_colour", "overlay/zebra", "overlay/peaking"]; // upwards; other overlays lie above

export class Pane {
  constructor(slot, label) {
    this.slot = slot;
    this.layers = new Map();
    this.header = null;
    this.guides = guidesDrawing();
    this.tag = h("div", { class: `vf-tag vf-slot${slot === "B" ? " vf-slot-b" : ""}`, hidden: true }, label);
    this.element = h("div", { class: "vf-frame", "data-slot": slot }, this.guides.element, this.tag);
    for (const name of ORDER) this.layer(name);
    this.layers.get("picture").setAttribute("role", "img");
  }

  layer(name) {
    const canvas = h("canvas", { width: 1, height: 1, "data-layer": name, hidden: name !== "picture" });
    this.guides.element.before(canvas);
    this.layers.set(name, canvas);
    return canvas;
  }

  /** Draw a frame into the layer that it belongs to. */
  draw(header, bitmap) {
    const name = header.kind === "overlay" ? `overlay/${header.overlay}` : header.kind;
    const canvas = this.layers.get(name) ?? (header.kind === "overlay" ? this.layer(name) : null);
    if (!canvas) return;
    if (canvas.width !== bitmap.width || canvas.height !== bitmap.height) {
      canvas.width = bitmap.width;
      canvas.height = bitmap.height;
    }
    const context = canvas.getContext("2d");
    if (header.kind === "overlay") context.clearRect(0, 0, canvas.width, canvas.height);
    context.drawImage(bitmap, 0, 0);
    canvas.hidden = false;
    if (header.kind === "picture") this.header = header;
  }

  /** Remove an overlay that was switched off. */
  clear(name) {
    const canvas = this.layers.get(name);
    if (canvas) canvas.hidden = true;
  }

  describe(text) {
    this.layers.get("picture").setAttribute("aria-label", text);
  }

  place({ x, y, width, height }) {
    Object.assign(this.element.style, { left: `${x}px`, top: `${y}px`, width: `${width}px`, height: `${height}px` });
    this.guides.resize(width, height);
    this.size = { width, height };
  }
}
