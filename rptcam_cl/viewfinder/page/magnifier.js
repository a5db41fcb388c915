/** The magnifier: pixels of the full resolution one to one, beside the picture. */

import { h, toggle } from "./dom.js";

const SHARE = 0.38; // of the picture's width
const LARGEST = 512; // [pixels]

export class Magnifier {
  constructor(link, stage) {
    Object.assign(this, { link, stage, on: false, point: { x: 0.5, y: 0.5 } });
    this.canvas = h("canvas", { width: 1, height: 1, role: "img", "aria-label": "Magnifier" });
    this.caption = h("figcaption", {}, "1:1");
    this.element = h("figure", { class: "vf-loupe", hidden: true }, this.canvas, this.caption);
    this.button = toggle("Magnifier 1:1", (pressed) => this.set(pressed), { key: "x", name: "magnifier" });
    stage.over.append(this.element);
    stage.others.set("magnifier", (header, bitmap) => this.draw(header, bitmap));
  }

  set(on = !this.on) {
    this.on = on;
    this.button.show(on);
    this.element.hidden = !on;
    if (on) this.ask();
    else this.link.tell("magnify", { x: null, y: null });
  }

  /** Show what lies at a point. */
  at(point) {
    if (!point) return;
    this.point = point;
    if (this.on) this.ask();
  }

  ask() {
    const ratio = window.devicePixelRatio || 1;
    const side = Math.round(Math.min(LARGEST, Math.max(96, this.stage.panes.A.size.width * SHARE * ratio)));
    this.element.classList.toggle("vf-left", this.point.x > 0.5 && this.point.y < 0.6);
    this.link.soon("magnify", "magnify", { x: this.point.x, y: this.point.y, width: side, height: Math.round(side * 0.75) });
  }

  draw(header, bitmap) {
    this.canvas.width = bitmap.width;
    this.canvas.height = bitmap.height;
    this.canvas.getContext("2d").drawImage(bitmap, 0, 0);
    this.canvas.style.width = `${bitmap.width / (window.devicePixelRatio || 1)}px`;
    this.caption.textContent = `1:1 · ${header.spp} spp`;
  }
}
