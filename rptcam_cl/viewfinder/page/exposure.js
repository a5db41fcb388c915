/** Histogram, clipping counts, spot meter, zebra and false colour. */

import { h, range, toggle } from "./dom.js";
import { digits, percent, signed } from "./numbers.js";
import { histogramPlot } from "./plots.js";

const CHANNELS = ["luminance", "red", "green", "blue"];

/** The histogram with the counts of what is clipped; always in sight. */
export function histogramView(link) {
  const chart = h("div", { class: "vf-chart" });
  const low = h("span", { class: "vf-clip" });
  const high = h("span", { class: "vf-clip vf-clip-high" });
  const raw = rawView();
  const element = h("figure", { class: "vf-exposure" }, chart, h("figcaption", {}, low, high), raw.element);
  const words = (counts, name) => {
    const most = Math.max(0, ...Object.values(counts ?? {}));
    return `${name} ${most ? digits(most, 6) : "none"}`;
  };
  function show(message) {
    if (message.slot && message.slot !== "A") return;
    const channels = Object.fromEntries(CHANNELS.filter((name) => message[name]).map((name) => [name, message[name]]));
    const { low: lost = {}, high: burnt = {} } = message.clipped ?? {};
    low.textContent = words(lost, "Black:");
    high.textContent = words(burnt, "Clipped:");
    low.title = "Pixels shown as black, in the worst channel";
    high.title = "Pixels at or above white, in the worst channel";
    high.classList.toggle("vf-warn", Math.max(0, ...Object.values(burnt)) > 0);
    chart.replaceChildren(histogramPlot(channels, { label: `Histogram. ${low.textContent}, ${high.textContent} pixels.` }));
    raw.show(message);
  }
  link.on("histogram", show);
  return element;
}

/** The numbers of the sensor, of pictures at rest; hidden where the scene has none. */
function rawView() {
  const chart = h("div", { class: "vf-chart" });
  const words = h("span");
  const full = h("span", { class: "vf-clip" });
  const element = h("div", { class: "vf-raw", "data-name": "raw", hidden: true }, chart, h("p", {}, words, full));
  function show({ raw }) {
    if (raw === undefined) {
      element.classList.toggle("vf-older", !element.hidden);
      return;
    }
    element.hidden = raw === null;
    element.classList.remove("vf-older");
    if (raw === null) return;
    const channels = Object.fromEntries(CHANNELS.filter((name) => raw[name]).map((name) => [name, raw[name]]));
    words.textContent = `Raw ${digits(raw.black_dn, 5)} to ${digits(raw.white_dn, 5)}`;
    full.textContent = `Saturated: ${raw.saturated ? digits(raw.saturated, 6) : "none"}`;
    full.title = "Numbers at the sensor's white level";
    full.classList.toggle("vf-warn", raw.saturated > 0);
    const marks = [raw.black_dn, raw.white_dn].map((dn) => dn / raw.edges[1]);
    chart.replaceChildren(histogramPlot(channels, { height: 52, marks, label: `Histogram of the sensor. ${words.textContent}, ${full.textContent}.` }));
  }
  return { element, show };
}

function clippingTable(link) {
  const body = h("tbody");
  link.on("histogram", ({ clipped, slot }) => {
    if (!clipped || (slot && slot !== "A")) return;
    body.replaceChildren(...CHANNELS.map((name) => h("tr", {}, h("th", { scope: "row" }, h("i", { class: `vf-key vf-key-${name}` }), name),
      ...["low", "high"].map((end) => h("td", {}, digits(clipped[end]?.[name] ?? 0, 7))))));
  });
  return h("table", { class: "vf-table" }, h("caption", {}, "Clipped pixels"),
    h("thead", {}, h("tr", {}, h("td"), h("th", { scope: "col" }, "black"), h("th", { scope: "col" }, "white"))), body);
}

/** Zebra and false colour are drawn by the server over the picture; this asks for them. */
export class Overlays {
  constructor(link, stage) {
    this.link = link;
    this.stage = stage;
    this.on = {};
    this.buttons = {};
  }

  button(name, label, key) {
    this.buttons[name] = toggle(label, (pressed) => this.set(name, pressed), { key, name });
    return this.buttons[name];
  }

  set(name, wanted = !this.on[name]) {
    this.on[name] = wanted;
    this.buttons[name].show(wanted);
    this.changed?.();
    this.link.ask("view", { overlays: { ...this.on } }).then(() => this.clear(), () => {});
  }

  clear() {
    for (const [name, wanted] of Object.entries(this.on)) {
      if (!wanted) for (const pane of Object.values(this.stage.panes)) pane.clear(`overlay/${name}`);
    }
  }
}

/** What the spot meter reads, in words. */
export function meterText({ ev, cd_m2: luminance, zone }) {
  return [zone && `zone ${zone}`, `EV ${signed(ev).replace("+", "")}`, `${digits(luminance)} cd/m²`].filter(Boolean).join(" · ");
}

function meterTable(link) {
  const list = h("dl", { class: "vf-list" });
  const rows = [
    ["Exposure value, ISO 100", ({ ev }) => digits(ev)],
    ["Luminance", ({ cd_m2: value }) => `${digits(value)} cd/m²`],
    ["From middle grey", ({ stops }) => (stops === undefined ? null : `${signed(stops)} EV`)],
    ["Zone", ({ zone }) => zone],
    ["Signal R G B", ({ rgb }) => rgb?.map((value) => digits(value, 2)).join("  ")],
  ];
  link.on("meter", (reading) => {
    if (reading.ev === null || reading.ev === undefined) return;
    list.replaceChildren(...rows.map(([label, text]) => [label, text(reading)]).filter(([, text]) => text !== null && text !== undefined)
      .map(([label, text]) => h("div", {}, h("dt", {}, label), h("dd", {}, text))));
  });
  list.append(h("div", {}, h("dt", {}, "Point at the picture"), h("dd", {}, "–")));
  return list;
}

const NEEDLE_EV = 3; // either way

/** The needle of the exposure meter: how far the settings bring the metered part off its target; hidden where the camera follows. */
export function meterNeedle(link) {
  const mark = h("i", { class: "vf-needle-mark" });
  const words = h("span", { class: "vf-needle-words" });
  const element = h("div", { class: "vf-needle", role: "img", "data-name": "needle", hidden: true }, h("span", { class: "vf-needle-scale" }, mark), words);
  link.on("state", ({ needle }) => {
    element.hidden = needle === null || needle === undefined;
    if (element.hidden) return;
    const within = Math.min(NEEDLE_EV, Math.max(-NEEDLE_EV, needle));
    mark.style.left = `${50 + (50 * within) / NEEDLE_EV}%`;
    words.textContent = `${signed(needle)} EV`;
    element.classList.toggle("vf-warn", within !== needle);
    element.setAttribute("aria-label", `Exposure meter: ${words.textContent} off its target`);
  });
  return element;
}

export function exposurePanel(link, overlays) {
  const level = range("Zebra from", {
    min: 0.5, max: 1, step: 0.01, value: 0.95, name: "zebra_level", text: (value) => percent(value, 3),
    changed: (value) => link.soon("zebra", "view", { zebra_level: value }),
  });
  return h("div", { class: "vf-panel" },
    h("h2", {}, "Spot meter"), meterTable(link),
    h("h2", {}, "Warnings"),
    h("div", { class: "vf-row" }, overlays.button("zebra", "Zebra", "z"), overlays.button("false_colour", "False colour", "v")),
    level,
    clippingTable(link));
}
