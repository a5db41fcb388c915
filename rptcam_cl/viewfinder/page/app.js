/** The viewfinder: everything put together on an element, over any transport. */

import { Compare } from "./compare.js";
import { Dials } from "./dials.js";
import { button, choice, h, toggle } from "./dom.js";
import { exposurePanel, histogramView, meterNeedle, meterText, Overlays } from "./exposure.js";
import { Focus } from "./focus.js";
import { Gestures, TOOLS } from "./gestures.js";
import { Guides } from "./guides-panel.js";
import { History } from "./history.js";
import { helpSheet, listen } from "./keys.js";
import { LensView } from "./lens.js";
import { Link } from "./link.js";
import { Magnifier } from "./magnifier.js";
import { distance } from "./numbers.js";
import { Out } from "./out.js";
import { Scopes } from "./scopes.js";
import { Stage } from "./stage.js";
import { Status } from "./status.js";
import { Tabs } from "./tabs.js";
import { Things } from "./things.js";
import { Time } from "./time.js";
import { Toasts } from "./toasts.js";

export class Viewfinder {
  /** Build the viewfinder in `root`; keys pressed in `keyTarget` are its own. */
  constructor(root, transport, keyTarget = root) {
    this.root = root;
    this.link = new Link(transport);
    this.stage = new Stage(this.link);
    this.toasts = new Toasts();
    this.status = new Status(this.link, this.stage);
    this.dials = new Dials(this.link);
    this.overlays = new Overlays(this.link, this.stage);
    this.magnifier = new Magnifier(this.link, this.stage);
    this.focus = new Focus(this.link, this.stage, this.overlays, this.dials);
    this.compare = new Compare(this.link, this.stage);
    this.guides = new Guides(this.link, this.stage);
    this.lens = new LensView(this.link);
    this.history = new History(this.link);
    this.things = new Things(this.link, this.stage, this.dials);
    this.time = new Time(this.link, this.dials);
    this.out = new Out(this.link, this.toasts, this.dials);
    this.help = helpSheet(root);
    this.gestures = new Gestures(this.stage, this.link, { pointed: (point) => this.pointed(point), clicked: (point) => this.clicked(point) });
    this.scopes = new Scopes(this.link, this.stage, histogramView(this.link));
    this.meterTag();
    this.inFinder();
    this.scaleKey();
    root.classList.add("vf");
    root.replaceChildren(this.body());
    this.toasts.follow(this.link);
    this.link.on("link", ({ state, words }) => this.connection(state, words));
    this.link.on("hello", () => this.opened());
    this.link.on("painted", (header) => root.dispatchEvent(new CustomEvent("vf-painted", { detail: header })));
    this.link.on("told", (message) => root.dispatchEvent(new CustomEvent("vf-sent", { detail: message })));
    listen(keyTarget, this);
    new ResizeObserver(() => root.classList.toggle("vf-narrow", root.clientWidth < 860)).observe(root);
  }

  body() {
    this.tools = choice("What a drag does", TOOLS, (tool) => this.gestures.use(tool), { value: "tilt", name: "tool" });
    const foot = this.foot = h("section", { class: "vf-foot", "aria-label": "Camera" },
      h("div", { class: "vf-tools" }, this.tools, meterNeedle(this.link), h("span", { class: "vf-wheel" }),
        button("Full", () => this.fill(), { key: "F", name: "full", title: "Full screen: the picture alone" }),
        h("button", { type: "button", class: "vf-button vf-ask", "aria-label": "Keys", "data-name": "help", on: { click: () => this.help.open() } }, "?")),
      this.status.messages, this.time.strip, this.dials.strip);
    this.link.on("state", ({ wheel, paused }) => {
      if (paused === this.pausing) this.pausing = null; // until then more presses go by what was asked
      const words = foot.querySelector(".vf-wheel");
      words.textContent = words.title = wheel?.text ? `Wheel: ${wheel.text}` : "";
    });
    this.tabs = new Tabs("Instruments", this.panels(), () => this.wanted());
    const side = this.side = h("aside", { class: "vf-side", "aria-label": "Instruments" }, this.scopes.element, this.tabs.element);
    return h("div", { class: "vf-body" }, this.status.element, h("main", { class: "vf-main" }, this.toasts.fault, this.stage.element, this.toasts.element), foot, side, this.help.element);
  }

  panels() {
    const denoising = toggle("Denoise until it is clean", (wanted) => this.denoise(wanted), { key: "n", name: "denoise", pressed: true });
    const turning = toggle("Turn with the device", (on) => this.gestures.turnWithDevice(on).catch(() => turning.show(false)), { name: "orientation" });
    turning.hidden = !("DeviceOrientationEvent" in window && window.isSecureContext && matchMedia("(pointer: coarse)").matches);
    const camera = h("div", { class: "vf-panel" }, h("h2", {}, "Lens, film, picture"), this.dials.others, denoising, turning);
    this.link.on("state", ({ denoise }) => denoising.show(Boolean(denoise)));
    return [
      { name: "camera", label: "Camera", element: camera },
      { name: "exposure", label: "Exposure", element: exposurePanel(this.link, this.overlays) },
      { name: "focus", label: "Focus", element: this.focus.panel(this.magnifier) },
      { name: "lens", label: "Lens", element: this.lens.panel() },
      { name: "guides", label: "Guides", element: this.guides.panel() },
      { name: "compare", label: "Compare", element: this.compare.panel() },
      { name: "things", label: "Light", element: this.things.panel() },
      { name: "time", label: "Time", element: this.time.panel() },
      { name: "history", label: "History", element: this.history.panel() },
      { name: "out", label: "Save", element: this.out.panel() },
    ];
  }

  /** Without a connection nothing acts, and what is shown is old: that is said over the picture until it is back. */
  connection(state, words) {
    this.isDead = state === "lost" || state === "refused" || (state === "connecting" && Boolean(this.isDead));
    this.foot.inert = this.side.inert = this.isDead;
    this.stage.bury(this.isDead, state === "connecting" ? null : words);
    this.pausing = null;
  }

  /** After each hello, also of a server that came back: say again what this page shows. */
  opened() {
    this.stage.tellSize(true);
    this.link.tell("view", { overlays: { ...this.overlays.on } });
    this.wanted();
    if (this.magnifier.on) this.magnifier.ask();
  }

  /** Ask for the data of the panels in sight; those that are not cost nothing. */
  wanted() {
    this.time.offer(this.tabs?.name === "time");
    const panels = ["histogram", "meter", ...(this.tabs?.name === "lens" ? ["lens"] : [])];
    if (this.link.isOpen) this.link.tell("view", { panels });
  }

  pointed(point) {
    this.pointer = point;
    this.link.soon("pointer", "pointer", point ? { x: point.x, y: point.y } : { x: null, y: null });
    this.magnifier.at(point);
    if (!point) this.tag.hidden = true;
  }

  clicked(point) {
    this.stage.element.focus({ preventScroll: true });
    if (this.gestures.tool === "select") {
      this.tabs.select("things");
      this.things.select(point);
    } else {
      this.focus.at(point);
    }
  }

  /** The meter's reading, beside the pointer. */
  meterTag() {
    this.tag = h("div", { class: "vf-tag vf-meter-tag", "aria-hidden": "true", hidden: true });
    this.stage.over.append(this.tag);
    this.link.on("meter", (reading) => {
      this.tag.hidden = !this.pointer || reading.ev === null || reading.ev === undefined;
      if (this.tag.hidden) return;
      this.tag.textContent = meterText(reading);
      const { x, y } = this.pointer;
      this.tag.style.left = `${100 * x}%`;
      this.tag.style.top = `${100 * y}%`;
      this.tag.classList.toggle("vf-before", x > 0.6);
      this.tag.classList.toggle("vf-above", y > 0.85);
    });
  }

  /** The scale of false colour, while it is on. */
  scaleKey() {
    const key = h("div", { class: "vf-scale-key", hidden: true, "aria-label": "Scale of false colour, zones of a stop" });
    this.stage.over.append(key);
    this.link.on("hello", ({ false_colour: bands = [] }) => key.replaceChildren(...bands.map(({ name, colour }) => {
      const band = h("span", {}, name);
      const [r, g, b] = colour;
      band.style.background = `rgb(${r} ${g} ${b})`;
      band.style.color = 0.2126 * r + 0.7152 * g + 0.0722 * b > 110 ? "#000" : "#fff";
      return band;
    })));
    this.overlays.changed = () => { key.hidden = !this.overlays.on.false_colour; };
  }

  /** What an electronic viewfinder writes into the picture, while nothing else is in sight. */
  inFinder() {
    const words = h("span", { "data-name": "evf" });
    const back = button("Panels", () => this.bare(false), { key: "h", name: "panels" });
    back.addEventListener("pointerdown", (event) => event.stopPropagation()); // it is no drag on the picture
    this.stage.over.append(h("div", { class: "vf-evf", role: "group", "aria-label": "Settings" }, words, back));
    this.link.on("state", ({ dials, focus }) => {
      const text = (name) => dials.find((dial) => dial.name === name)?.text;
      const mode = dials.find((dial) => dial.name === "mode")?.value;
      words.replaceChildren(...[mode?.length === 1 && mode, text("shutter_s"), text("f_number"), text("iso"), text("ev"), text("focus_m"), text("zoom")].filter(Boolean).map((each) => h("span", {}, each)));
      if (focus !== undefined) this.dials.hint("focus_m", focus?.hyperfocal_m ? `H\u00a0${distance(Number(focus.hyperfocal_m.toPrecision(2)))}` : "");
    });
    document.addEventListener("fullscreenchange", () => {
      if (!document.fullscreenElement) this.bare(false);
    });
  }

  /** Hide the panels, or show them again. */
  bare(hidden = !this.root.classList.contains("vf-bare")) {
    this.root.classList.toggle("vf-bare", hidden);
    if (!hidden && document.fullscreenElement) document.exitFullscreen();
    this.stage.element.focus({ preventScroll: true });
  }

  /** Fill the screen with the picture, or end that. */
  fill() {
    const wanted = !document.fullscreenElement;
    if (wanted) this.root.requestFullscreen?.().catch(() => {}); // without leave of the browser the panels hide all the same
    this.bare(wanted);
  }

  use(number) {
    const tool = TOOLS[number].value;
    this.tools.show(tool);
    this.gestures.use(tool);
  }

  /** Show pictures without their noise until they are clean, or as they are. */
  denoise(wanted = !this.link.last.state?.denoise) {
    this.link.tell("denoise", { on: wanted });
  }

  pause() {
    this.pausing = !(this.pausing ?? this.link.last.state?.paused);
    this.link.ask(this.pausing ? "pause" : "resume").catch(() => { this.pausing = null; });
  }
}
