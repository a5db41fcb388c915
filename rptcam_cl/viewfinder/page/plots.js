/** Small plots as SVG: lines over an axis, and a histogram. */

import { s } from "./dom.js";
import { digits } from "./numbers.js";

const LEFT = 34;
const RIGHT = 10;
const TOP = 8;
const BOTTOM = 30;

/** Four or five round values between two ends. */
export function ticks(from, to, wanted = 4) {
  const rough = (to - from) / wanted;
  if (!(rough > 0)) return [from];
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((each) => each * power).find((each) => each >= rough * 0.999);
  const found = [];
  for (let at = Math.ceil(from / step - 1e-9) * step; at <= to + step * 1e-9; at += step) found.push(Math.abs(at) < step / 1e6 ? 0 : at);
  return found;
}

function axes(box, x, y) {
  const marks = [];
  for (const at of x.ticks ?? ticks(x.from, x.to)) {
    marks.push(s("path", { class: "vf-grid", d: `M${box.x(at)} ${TOP}V${box.bottom}` }));
    marks.push(s("text", { class: "vf-tick", x: box.x(at), y: box.bottom + 13, "text-anchor": "middle" }, (x.text ?? digits)(at)));
  }
  for (const at of y.ticks ?? ticks(y.from, y.to)) {
    marks.push(s("path", { class: "vf-grid", d: `M${LEFT} ${box.y(at)}H${box.right}` }));
    marks.push(s("text", { class: "vf-tick", x: LEFT - 5, y: box.y(at) + 4, "text-anchor": "end" }, (y.text ?? digits)(at)));
  }
  marks.push(s("text", { class: "vf-axis", x: (LEFT + box.right) / 2, y: box.bottom + 27, "text-anchor": "middle" }, x.label));
  return marks;
}

function line(box, { points, kind = "", dots = false }) {
  const d = points.map(([x, y], i) => `${i ? "L" : "M"}${box.x(x).toFixed(1)} ${box.y(y).toFixed(1)}`).join("");
  const marks = dots ? points.map(([x, y]) => s("circle", { class: `vf-dot ${kind}`, cx: box.x(x), cy: box.y(y), r: 3 })) : [];
  return [dots ? null : s("path", { class: `vf-line ${kind}`, d }), ...marks];
}

/** Lines and dots in axes. `x`, `y`: {from, to, label, text, ticks}; `series`: [{points, kind, dots}]; `marks`: [{x, label}]. */
export function plot({ title, width = 352, height = 150, x, y, series, marks = [] }) {
  const box = { right: width - RIGHT, bottom: height - BOTTOM };
  box.x = (value) => LEFT + ((box.right - LEFT) * (value - x.from)) / (x.to - x.from || 1);
  box.y = (value) => box.bottom - ((box.bottom - TOP) * (value - y.from)) / (y.to - y.from || 1);
  return s("svg", { class: "vf-plot", viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": title },
    axes(box, x, y),
    marks.map((mark) => s("path", { class: "vf-mark", d: `M${box.x(mark.x)} ${TOP}V${box.bottom}` })),
    series.flatMap((each) => line(box, each)));
}

function area(counts, width, height, most) {
  const step = width / counts.length;
  const heights = counts.map((count) => height - height * Math.min(1, Math.sqrt(count / most)));
  return `M0 ${height}${heights.map((y, i) => `L${((i + 0.5) * step).toFixed(1)} ${y.toFixed(1)}`).join("")}L${width} ${height}Z`;
}

/** A histogram with the square root of its counts upwards, so that small ones are seen. The ends do not set its height.
 *  `marks`: places from 0 to 1. */
export function histogramPlot(channels, { width = 352, height = 104, label, marks = [] }) {
  const inner = Object.values(channels).flatMap((counts) => counts.slice(1, -1));
  const most = Math.max(1, ...inner);
  return s("svg", { class: "vf-histogram", viewBox: `0 0 ${width} ${height}`, preserveAspectRatio: "none", role: "img", "aria-label": label },
    [1, 2, 3].map((i) => s("path", { class: "vf-grid", d: `M${(i * width) / 4} 0V${height}` })),
    Object.entries(channels).map(([name, counts]) => s("path", { class: `vf-area vf-area-${name}`, d: area(counts, width, height, most) })),
    marks.map((at) => s("path", { class: "vf-mark", d: `M${at * width} 0V${height}` })));
}
