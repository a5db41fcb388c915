/** Lines over the picture: thirds, centre, aspect masks, safe frames, the lens's image circle, focus zones, crosshair. */

import { s } from "./dom.js";

/** Aspect masks: width over height. */
export const ASPECTS = [
  { value: "", label: "None" },
  { value: String(1), label: "1:1" },
  { value: String(9 / 16), label: "9:16" },
  { value: String(4 / 5), label: "4:5" },
  { value: String(4 / 3), label: "4:3" },
  { value: String(3 / 2), label: "3:2" },
  { value: String(16 / 9), label: "16:9" },
  { value: "1.85", label: "1.85" },
  { value: "2", label: "2:1" },
  { value: "2.39", label: "2.39" },
];
// Shares of the picture's sides, EBU R 95 (2017): action within 93 %, titles within 90 %.
const SAFE = [{ share: 0.93, name: "action" }, { share: 0.9, name: "title" }];

function thirds(w, h) {
  const lines = [1, 2].flatMap((i) => [`M${(i * w) / 3} 0V${h}`, `M0 ${(i * h) / 3}H${w}`]);
  return [s("path", { class: "vf-guide vf-thirds", d: lines.join("") })];
}

function centre(w, h) {
  const arm = Math.min(w, h) / 24;
  return [s("path", { class: "vf-guide vf-centre", d: `M${w / 2 - arm} ${h / 2}h${2 * arm}M${w / 2} ${h / 2 - arm}v${2 * arm}` })];
}

function inner(w, h, aspect) {
  const width = Math.min(w, h * aspect);
  const height = width / aspect;
  return { x: (w - width) / 2, y: (h - height) / 2, width, height };
}

function mask(w, h, aspect, linesOnly) {
  const { x, y, width, height } = inner(w, h, aspect);
  return [
    linesOnly ? "" : s("path", { class: "vf-mask", "fill-rule": "evenodd", d: `M0 0h${w}v${h}h${-w}zM${x} ${y}h${width}v${height}h${-width}z` }),
    s("rect", { class: "vf-guide vf-mask-edge", x, y, width, height }),
  ];
}

function safe(w, h, aspect) {
  const frame = aspect ? inner(w, h, aspect) : { x: 0, y: 0, width: w, height: h };
  return SAFE.flatMap(({ share, name }, i) => {
    const x = frame.x + (frame.width * (1 - share)) / 2;
    const y = frame.y + (frame.height * (1 - share)) / 2;
    return [
      s("rect", { class: "vf-guide vf-safe", x, y, width: frame.width * share, height: frame.height * share }),
      s("text", { class: "vf-guide-text", x: x + 4, y: i ? y + 13 : y + frame.height * share - 4 }, name),
    ];
  });
}

function circle(w, h, found) {
  if (!found) return [];
  return [s("ellipse", { class: "vf-guide vf-circle", cx: found.x * w, cy: found.y * h, rx: found.rx * w, ry: found.ry * h })];
}

const STRAIGHT = 0.25; // degrees, within which the camera is level
const PER_DEGREE = 1 / 60; // of the picture's height, that the line lies lower for each degree that the camera looks up

/** The line is the horizontal: it turns against the camera and sinks as it looks up. */
function level(w, h, { roll, pitch }) {
  const arm = Math.min(w, h) / 5;
  const sunk = Math.max(-0.4, Math.min(0.4, pitch * PER_DEGREE)) * h;
  const state = Math.abs(roll) <= STRAIGHT ? "vf-level-straight" : "";
  const turn = `rotate(${-roll} ${w / 2} ${h / 2})`;
  return [
    s("path", { class: `vf-guide vf-level ${state}`, transform: turn, d: `M${w / 2 - arm} ${h / 2 + sunk}H${w / 2 + arm}` }),
    s("path", { class: "vf-guide vf-level-marks", d: `M${w / 2 - 1.4 * arm} ${h / 2}h${arm / 3}M${w / 2 + 1.4 * arm} ${h / 2}h${-arm / 3}` }),
  ];
}

function zone(w, h, { x0, x1, y0, y1, state }) {
  return s("rect", {
    class: `vf-zone vf-zone-${state}`, x: x0 * w, y: y0 * h, width: (x1 - x0) * w, height: (y1 - y0) * h, rx: 2,
  });
}

function crosshair(w, h, { x, y }) {
  const d = `M${x * w - 14} ${y * h}h9m10 0h9M${x * w} ${y * h - 14}v9m0 10v9`;
  return [s("path", { class: "vf-cross vf-cross-under", d }), s("path", { class: "vf-cross", d })];
}

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => a.map((each) => each / Math.sqrt(dot(a, a)));

/** The axis of the scene that is nearest to a direction. */
export function nearestAxis(direction) {
  const axis = direction.map(Math.abs).indexOf(Math.max(...direction.map(Math.abs)));
  return direction.map((each, i) => (i === axis ? Math.sign(each) : 0));
}

/** How far a camera is turned clockwise about its view, and looks up [degrees]; null where it looks straight up or down. */
export function tiltOf({ eye, target, up }, vertical) {
  const ahead = unit(target.map((each, i) => each - eye[i]));
  const pitch = Math.asin(Math.max(-1, Math.min(1, dot(ahead, vertical))));
  if (Math.abs(pitch) > 1.56) return null;
  const right = unit(cross(ahead, up));
  const roll = Math.atan2(-dot(vertical, right), dot(vertical, cross(right, ahead)));
  return { roll: (roll * 180) / Math.PI, pitch: (pitch * 180) / Math.PI };
}

/** An element with the guides; `show(what)` and `resize` draw it anew. */
export function guidesDrawing() {
  const element = s("svg", { class: "vf-guides", "aria-hidden": "true" });
  let size = { width: 1, height: 1 };
  let shown = {};
  function draw() {
    const { width: w, height: h } = size;
    element.setAttribute("viewBox", `0 0 ${w} ${h}`);
    element.replaceChildren(
      ...(shown.aspect ? mask(w, h, Number(shown.aspect), shown.lines) : []),
      ...(shown.thirds ? thirds(w, h) : []),
      ...(shown.centre ? centre(w, h) : []),
      ...(shown.safe ? safe(w, h, Number(shown.aspect)) : []),
      ...(shown.circle ? circle(w, h, shown.imageCircle) : []),
      ...(shown.level && shown.tilt ? level(w, h, shown.tilt) : []),
      ...(shown.zones ?? []).map((each) => zone(w, h, each)),
      ...(shown.crosshair ? crosshair(w, h, shown.crosshair) : []),
    );
  }
  return {
    element,
    show(what) {
      shown = { ...shown, ...what };
      draw();
    },
    resize(width, height) {
      size = { width, height };
      draw();
    },
  };
}
