/** The magnifier, beside the picture: pixels of the full resolution one to one, or as many times the picture as electronic viewfinders show. */

import { choice, h, toggle } from "./dom.js";

const SHARE = 0.38; // of the picture's width
const LARGEST = 512; // [CSS pixels]
const ASPECT = 0.75;
const LEAST = 4; // [pixels of the full resolution]
const MOST = 1024;
const LEVELS = [{ value: "1", label: "1:1" }, { value: "5", label: "5×" }, { value: "10", label: "10×" }];

export class Magnifier {
  constructor(link, stage) {
    Object.assign(this, { link, stage, on: false, level: "1", point: { x: 0.5, y: 0.5 } });
    this.canvas = h("canvas", { width: 1, height: 1, role: "img", "aria-label": "Magnifier" });
    this.caption = h("figcaption", {}, "1:1");
    this.element = h("figure", { class: "vf-loupe", hidden: true }, this.canvas, this.caption);
    this.button = toggle("Magnifier", (pressed) => this.set(pressed), { key: "x", name: "magnifier" });
    this.levels = choice("Magnification", LEVELS, (value) => this.set(true, value), { value: "1", name: "magnification" });
    stage.over.append(this.element);
    stage.others.set("magnifier", (header, bitmap) => this.draw(header, bitmap));
  }

  /** How large a pixel of the full resolution is in the picture [CSS pixels]. */
  get pixel() {
    return this.stage.panes.A.size.width / (this.stage.full?.[0] ?? this.stage.panes.A.size.width);
  }

  /** How large the magnifier shows it. One to one is one of the screen's own pixels. */
  sized(level) {
    return level === "1" ? 1 / (window.devicePixelRatio || 1) : this.pixel * Number(level);
  }

  /** The levels that show more than the picture itself: one to one does not where that is enlarged already. */
  get useful() {
    return LEVELS.map(({ value }) => value).filter((level) => this.sized(level) > this.pixel * 1.001);
  }

  set(on, level = this.level) {
    const { useful } = this;
    this.level = useful.includes(level) ? level : useful[0];
    this.on = on;
    this.button.show(on);
    this.levels.offer(useful);
    this.levels.show(this.level);
    this.element.hidden = !on;
    if (on) this.ask();
    else this.link.tell("magnify", { x: null, y: null });
  }

  /** Go on to the next level, and after the last to none, as a camera's button does. */
  next() {
    const { useful } = this;
    if (!this.on) this.set(true, useful[0]);
    else if (this.level === useful.at(-1)) this.set(false);
    else this.set(true, useful[useful.indexOf(this.level) + 1]);
  }

  /** Show what lies at a point. */
  at(point) {
    if (!point) return;
    this.point = point;
    if (this.on) this.ask();
  }

  ask() {
    const side = Math.min(LARGEST, this.stage.panes.A.size.width * SHARE);
    const count = (length) => Math.round(Math.min(MOST, Math.max(LEAST, length / this.sized(this.level))));
    this.element.classList.toggle("vf-left", this.point.x > 0.5 && this.point.y < 0.6);
    this.link.soon("magnify", "magnify", { x: this.point.x, y: this.point.y, width: count(side), height: count(side * ASPECT) });
  }

  draw(header, bitmap) {
    this.canvas.width = bitmap.width;
    this.canvas.height = bitmap.height;
    this.canvas.getContext("2d").drawImage(bitmap, 0, 0);
    this.canvas.style.width = `${bitmap.width * this.sized(this.level)}px`;
    this.caption.textContent = `${LEVELS.find(({ value }) => value === this.level).label} · ${header.spp} spp`;
  }
}
