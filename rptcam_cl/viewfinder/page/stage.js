/** Where pictures lie: one, two side by side, or one over the other with a wipe. */

import { h } from "./dom.js";
import { Frames } from "./frames.js";
import { Pane } from "./pane.js";

const GAP = 2; // [CSS pixels] between two pictures
const SETTLED = 120; // [ms] after the last change of size

function fitted(width, height, aspect) {
  const w = Math.max(16, Math.min(width, height * aspect));
  return { width: w, height: w / aspect };
}

/** The places of one picture or of two beside or below one another, whichever lets them be larger. */
export function places(width, height, aspect, count) {
  const beside = fitted((width - GAP * (count - 1)) / count, height, aspect);
  const below = fitted(width, (height - GAP * (count - 1)) / count, aspect);
  const across = count === 1 || beside.width >= below.width;
  const each = across ? beside : below;
  const total = { width: across ? each.width * count + GAP * (count - 1) : each.width, height: across ? each.height : each.height * count + GAP * (count - 1) };
  return Array.from({ length: count }, (_, i) => ({
    x: (width - total.width) / 2 + (across ? i * (each.width + GAP) : 0),
    y: (height - total.height) / 2 + (across ? 0 : i * (each.height + GAP)),
    ...each,
  }));
}

export class Stage {
  constructor(link) {
    this.link = link;
    this.mode = "off";
    this.wipeAt = 0.5;
    this.aspect = 16 / 9;
    this.squeeze = 1;
    this.panes = { A: new Pane("A", "A"), B: new Pane("B", "B") };
    this.others = new Map(); // who draws frames of other kinds: magnifier, difference
    this.over = h("div", { class: "vf-over" }); // what lies over both pictures
    this.wipe = h("div", {
      class: "vf-wipe", role: "slider", tabindex: 0, hidden: true, "aria-label": "Wipe between A and B",
      "aria-valuemin": 0, "aria-valuemax": 100, on: { pointerdown: (event) => this.grab(event), keydown: (event) => this.key(event) },
    });
    this.banner = h("div", { class: "vf-banner", role: "status", hidden: true });
    this.gone = h("div", { class: "vf-gone", role: "alert", hidden: true }, h("strong"), h("span", {}, "This is the last picture that came, and nothing here acts until the connection is back."));
    this.element = h("div", {
      class: "vf-stage", tabindex: 0, role: "group", "aria-label": "Picture. Press question mark for the keys.",
    }, this.panes.A.element, this.panes.B.element, this.over, this.wipe, this.banner, this.gone);
    new Frames(link, (header, bitmap) => this.draw(header, bitmap));
    new ResizeObserver(() => this.layout()).observe(this.element);
    link.on("hello", (hello) => this.resolution(hello.size));
    link.on("compiling", (message) => this.announce(message.busy ? message.text || "Compiling" : null));
    this.arrange("off");
  }

  draw(header, bitmap) {
    if (header.kind === "picture" && header.full) this.resolution(header.full);
    const other = this.others.get(header.kind);
    if (other) other(header, bitmap);
    else this.panes[header.slot]?.draw(header, bitmap);
  }

  announce(text) {
    this.banner.hidden = text === null;
    this.banner.textContent = text ?? "";
  }

  /** Say over the picture, paler then, that there is no connection; words that are null stay. */
  bury(dead, words) {
    this.gone.hidden = !dead;
    this.element.classList.toggle("vf-dead", dead);
    if (words !== null) this.gone.firstChild.textContent = words;
    if (dead) this.announce(null);
  }

  resolution([width, height]) {
    this.full = [width, height];
    const aspect = (this.squeeze * width) / height;
    if (this.aspect === aspect) return;
    this.aspect = aspect;
    this.element.style.setProperty("--aspect", this.aspect);
    this.layout();
  }

  /** Show the picture so many times as wide, as anamorphic lenses are squeezed. */
  widen(squeeze) {
    this.squeeze = squeeze;
    if (this.full) this.resolution(this.full);
  }

  arrange(mode) {
    this.mode = mode;
    this.panes.B.element.hidden = mode === "off";
    this.panes.A.tag.hidden = this.panes.B.tag.hidden = mode === "off";
    this.wipe.hidden = mode !== "wipe";
    this.panes.B.element.classList.toggle("vf-wiped", mode === "wipe");
    this.layout();
  }

  layout() {
    const [A, B] = places(this.element.clientWidth, this.element.clientHeight, this.aspect, this.mode === "side" ? 2 : 1);
    this.panes.A.place(A);
    this.panes.B.place(B ?? A);
    const { left, top, width, height } = this.panes.A.element.style;
    Object.assign(this.over.style, { left, top, width, height });
    this.moveWipe(this.wipeAt);
    clearTimeout(this.settling);
    this.settling = setTimeout(() => this.tellSize(), SETTLED);
  }

  tellSize(again = false) {
    const { width, height } = this.panes.A.size;
    const ratio = window.devicePixelRatio || 1;
    const size = { width: Math.max(16, Math.round(width * ratio)), height: Math.max(16, Math.round(height * ratio)) };
    if (!again && this.told?.width === size.width && this.told?.height === size.height) return;
    this.told = size;
    this.link.tell("view", size);
  }

  moveWipe(share) {
    this.wipeAt = Math.min(1, Math.max(0, share));
    const left = Number.parseFloat(this.panes.A.element.style.left) + this.wipeAt * this.panes.A.size.width;
    Object.assign(this.wipe.style, { left: `${left}px`, top: this.panes.A.element.style.top, height: this.panes.A.element.style.height });
    this.wipe.setAttribute("aria-valuenow", Math.round(100 * this.wipeAt));
    this.wipe.setAttribute("aria-valuetext", `A on the left ${Math.round(100 * this.wipeAt)} %`);
    this.panes.B.element.style.clipPath = this.mode === "wipe" ? `inset(0 0 0 ${100 * this.wipeAt}%)` : "none";
  }

  grab(event) {
    event.stopPropagation();
    this.wipe.setPointerCapture(event.pointerId);
    const move = (later) => {
      const box = this.panes.A.element.getBoundingClientRect();
      this.moveWipe((later.clientX - box.left) / box.width);
    };
    this.wipe.addEventListener("pointermove", move);
    this.wipe.addEventListener("pointerup", () => this.wipe.removeEventListener("pointermove", move), { once: true });
  }

  key(event) {
    const step = { ArrowLeft: -0.02, ArrowRight: 0.02, PageDown: -0.2, PageUp: 0.2, Home: -1, End: 1 }[event.key];
    if (step === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    this.moveWipe(this.wipeAt + step);
  }

  /** Where in the picture an event lies, as fractions from left and top; null when it lies outside. */
  at(event) {
    const over = this.mode === "side" ? this.paneBelow(event) : this.panes.A;
    const box = over.element.getBoundingClientRect();
    const x = (event.clientX - box.left) / box.width;
    const y = (event.clientY - box.top) / box.height;
    return x >= 0 && x <= 1 && y >= 0 && y <= 1 ? { x, y, width: box.width, height: box.height } : null;
  }

  paneBelow(event) {
    const box = this.panes.B.element.getBoundingClientRect();
    const inside = event.clientX >= box.left && event.clientX <= box.right && event.clientY >= box.top && event.clientY <= box.bottom;
    return inside ? this.panes.B : this.panes.A;
  }

  show(what) {
    this.panes.A.guides.show(what);
    this.panes.B.guides.show(what);
  }
}
