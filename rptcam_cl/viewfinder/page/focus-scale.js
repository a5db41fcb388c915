/** Distances as they are engraved on a lens, even in 1 / distance, with the depth of field of several f-numbers. */

import { button, h, s } from "./dom.js";
import { digits, distance } from "./numbers.js";

const WIDTH = 352;
const SIDE = 12;
const UNFOCUSED = "This camera has no focus: everything is as sharp as it can be.";
const APART = 30; // between two texts
const ROW = 15;
const ROWS = 4; // f-numbers that are engraved, beside the one that is set

function marks(scale, at) {
  let last = -APART;
  const end = Math.max(...scale.marks.map(({ position }) => position)); // its text comes before those of its neighbours
  return scale.marks.flatMap(({ text, position }) => {
    const x = at(position);
    const tick = s("path", { class: "vf-scale-tick", d: `M${x} 20v8` });
    if (position !== end && (x - last < APART || at(end) - x < APART)) return [tick];
    last = x;
    return [tick, s("text", { class: "vf-tick", x, y: 14, "text-anchor": "middle" }, text)];
  });
}

/** The f-number that is set, and some of the others. */
function engraved(all, nearest) {
  const every = Math.ceil(all.length / ROWS);
  return all.filter((each, i) => each === nearest || i % every === 0);
}

function rows(scale, at, current) {
  const all = [...scale.depth].sort((a, b) => b.f_number - a.f_number);
  const nearest = all.reduce((best, each) => (Math.abs(Math.log(each.f_number / current)) < Math.abs(Math.log(best.f_number / current)) ? each : best), all[0]);
  return engraved(all, nearest).flatMap((each, i) => {
    const y = 40 + i * ROW;
    const [near, far] = [at(each.near), at(each.far)];
    const label = far > WIDTH - 46 ? { x: near - 5, "text-anchor": "end" } : { x: far + 5 };
    return [
      s("path", { class: `vf-scale-depth${each === nearest ? " vf-scale-now" : ""}`, d: `M${near} ${y}H${Math.max(far, near + 1)}` }),
      s("text", { class: "vf-tick", y: y + 4, ...label }, `f/${digits(each.f_number, 2)}`),
    ];
  });
}

function drawing(scale, current, label) {
  const at = (position) => SIDE + (WIDTH - 2 * SIDE) * position;
  const height = 36 + ROW * (ROWS + 1);
  const x = at(scale.position);
  return s("svg", { class: "vf-plot", viewBox: `0 0 ${WIDTH} ${height}`, role: "img", "aria-label": label },
    s("path", { class: "vf-scale-tick", d: `M${SIDE} 28H${WIDTH - SIDE}` }), marks(scale, at), rows(scale, at, current),
    s("path", { class: "vf-scale-needle", d: `M${x} 20V${height}` }));
}

/** The scale and a sentence of what is sharp. */
export function focusScale(link, turned) {
  const chart = h("div", { class: "vf-chart" });
  const words = h("p", { class: "vf-note", "data-name": "depth" }, UNFOCUSED);
  link.on("state", ({ focus, dials = [] }) => {
    if (focus === null) words.textContent = UNFOCUSED;
    if (focus?.distance_m) {
      const far = focus.hyperfocal_m ? `; hyperfocal ${distance(focus.hyperfocal_m)}` : "";
      words.textContent = `Focus ${distance(focus.distance_m)}; sharp from ${distance(focus.near_m)} to ${distance(focus.far_m)}${far}`;
    }
    const dial = dials.find(({ name }) => name === "focus_m");
    const opening = dials.find(({ name }) => name === "f_number");
    chart.replaceChildren(...(dial?.scale?.marks?.length ? [drawing(dial.scale, opening?.value ?? 1, words.textContent)] : []));
  });
  const go = button("Focus at the hyperfocal distance", () => turned("focus_m", link.last.hyperfocal, false), { name: "hyperfocal" });
  link.on("state", ({ focus }) => {
    if (focus !== undefined) link.last.hyperfocal = focus?.hyperfocal_m;
    go.disabled = !link.last.hyperfocal;
  });
  return [chart, words, go];
}
