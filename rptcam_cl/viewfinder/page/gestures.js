/** Moving the camera by pointer, wheel, touch and keys, and what the pointer points at. */

import { wheelTurn } from "./dom.js";

const CLICK = 5; // [CSS pixels] that a click may slip
const REST = 200; // [ms] after the last turn of the wheel
const DEPTH = 20; // steps of dolly for a drag over the height of the picture
const KEY_TURN = 0.02; // of the picture for a press of an arrow
const FINE = 0.2;
const STILL = 0.002; // of the picture, that a device may tremble

/** What a drag and the arrow keys do. */
export const TOOLS = [
  { value: "tilt", label: "Turn", key: "1", title: "Drag turns the camera where it stands" },
  { value: "orbit", label: "Orbit", key: "2", title: "Drag moves the camera around its target" },
  { value: "pan", label: "Pan", key: "3", title: "Drag moves the camera sideways" },
  { value: "dolly", label: "Dolly", key: "4", title: "Drag moves the camera to and fro" },
  { value: "point", label: "Point", key: "5", title: "Arrow keys move the crosshair, Enter focuses there" },
  { value: "select", label: "Select", key: "6", title: "A click, or Enter at the crosshair, selects a thing" },
];

const AIMS = ["point", "select"]; // what moves a crosshair, and no camera

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const STEPS = { w: [0, 1, 0], s: [0, -1, 0], a: [-1, 0, 0], d: [1, 0, 0], q: [0, 0, -1], e: [0, 0, 1] };

function added(before, later) {
  if (before.kind !== later.kind) return later;
  const sum = (name) => (before[name] ?? 0) + (later[name] ?? 0);
  return { ...later, dx: sum("dx"), dy: sum("dy"), dz: sum("dz") };
}

/** Where the back of a device points: clockwise from north and up [degrees], by the angles of W3C's Device Orientation. */
export function heading({ alpha, beta, gamma }) {
  if (alpha === null || beta === null || gamma === null) return null;
  const [a, b, c] = [alpha, beta, gamma].map((each) => (each * Math.PI) / 180);
  const x = -Math.sin(c) * Math.cos(a) - Math.cos(c) * Math.sin(b) * Math.sin(a);
  const y = -Math.sin(c) * Math.sin(a) + Math.cos(c) * Math.sin(b) * Math.cos(a);
  const up = Math.asin(Math.max(-1, Math.min(1, -Math.cos(c) * Math.cos(b))));
  return { around: (Math.atan2(x, y) * 180) / Math.PI, up: (up * 180) / Math.PI };
}

export class Gestures {
  /** `pointed(point)` and `clicked(point)` get fractions of the picture. */
  constructor(stage, link, { pointed, clicked }) {
    Object.assign(this, { stage, link, pointed, clicked, tool: "tilt", crosshair: null, held: new Map() });
    const listeners = {
      pointerdown: (event) => this.down(event),
      pointermove: (event) => this.move(event),
      pointerup: (event) => this.up(event),
      pointercancel: (event) => this.up(event),
      pointerleave: () => this.pointed(null),
      contextmenu: (event) => event.preventDefault(),
    };
    link.on("state", ({ camera }) => { this.across = camera?.across_degrees; });
    for (const [name, listener] of Object.entries(listeners)) stage.element.addEventListener(name, listener);
    stage.element.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
  }

  /** Move the camera; a movement that goes on is transient. */
  send(kind, keys, transient = true) {
    const message = { kind, dx: 0, dy: 0, dz: 0, ...keys, transient };
    this.link.soon(`move ${kind}`, "move", message, added);
    this.moving = kind;
  }

  rest() {
    if (!this.moving) return;
    this.link.flush();
    this.link.tell("move", { kind: this.moving, dx: 0, dy: 0, dz: 0, transient: false });
    this.moving = null;
  }

  down(event) {
    const point = this.stage.at(event);
    if (!point) return;
    this.stage.element.setPointerCapture(event.pointerId);
    const kind = event.button === 2 ? "orbit" : event.button === 1 || event.shiftKey ? "pan" : this.tool;
    this.held.set(event.pointerId, { x: event.clientX, y: event.clientY, way: 0, kind, point, button: event.button });
    if (event.button === 1) event.preventDefault();
  }

  move(event) {
    const held = this.held.get(event.pointerId);
    const point = this.stage.at(event);
    if (!held) {
      this.pointed(point);
      return;
    }
    const dx = event.clientX - held.x;
    const dy = event.clientY - held.y;
    held.way += Math.hypot(dx, dy);
    if (held.way < CLICK) return;
    if (this.held.size === 2) this.pinch(event, held, dx, dy);
    else this.drag(held, dx / held.point.width, dy / held.point.height);
    held.x = event.clientX;
    held.y = event.clientY;
  }

  drag(held, dx, dy) {
    this.stage.element.classList.add("vf-dragging");
    if (held.kind === "dolly") this.send("dolly", { dy: -dy * DEPTH });
    else if (!AIMS.includes(held.kind)) this.send(held.kind, { dx, dy });
  }

  pinch(event, held, dx, dy) {
    const [other] = [...this.held.values()].filter((each) => each !== held);
    const before = Math.hypot(held.x - other.x, held.y - other.y);
    const after = Math.hypot(event.clientX - other.x, event.clientY - other.y);
    other.way = CLICK;
    this.send("zoom", { dy: 8 * Math.log2(after / Math.max(1, before)) });
    this.send("pan", { dx: dx / held.point.width / 2, dy: dy / held.point.height / 2 });
  }

  up(event) {
    const held = this.held.get(event.pointerId);
    this.held.delete(event.pointerId);
    this.stage.element.classList.remove("vf-dragging");
    if (!held) return;
    if (held.way < CLICK && held.button === 0 && event.type === "pointerup") this.clicked(held.point);
    else if (this.held.size === 0) this.rest();
  }

  wheel(event) {
    if (!this.stage.at(event)) return;
    event.preventDefault();
    this.zoom(wheelTurn(event));
  }

  zoom(clicks) {
    this.send("zoom", { dy: Math.max(-10, Math.min(10, clicks)) });
    clearTimeout(this.resting);
    this.resting = setTimeout(() => this.rest(), REST);
  }

  /** Do what a key means; return whether it means anything. */
  key(event) {
    const fine = event.shiftKey ? FINE : 1;
    const arrow = ARROWS[event.key];
    const step = STEPS[event.key.toLowerCase()];
    if (arrow && AIMS.includes(this.tool)) this.point(arrow, fine);
    else if (arrow && this.tool === "dolly") this.send("dolly", { dy: -arrow[1] * fine, dx: 0 });
    else if (arrow) this.send(this.tool, { dx: -arrow[0] * KEY_TURN * fine, dy: -arrow[1] * KEY_TURN * fine });
    else if (step) this.send("walk", { dx: step[0] * fine, dy: step[1] * fine, dz: step[2] * fine });
    else if (event.key === "Enter" && AIMS.includes(this.tool)) this.clicked(this.crosshair ?? { x: 0.5, y: 0.5 });
    else return false;
    return true;
  }

  /** Turn the camera as the device is turned in the hand, where the browser tells its orientation. */
  async turnWithDevice(on) {
    window.removeEventListener("deviceorientation", this.turning);
    this.turned = null;
    if (!on) return;
    await window.DeviceOrientationEvent.requestPermission?.();
    this.turning = (event) => this.device(event);
    window.addEventListener("deviceorientation", this.turning);
  }

  device(event) {
    const before = this.turned;
    this.turned = heading(event);
    if (!before || !this.across || !this.turned) return;
    const around = ((this.turned.around - before.around + 540) % 360) - 180;
    const [width, height] = this.stage.full ?? [3, 2];
    const turn = { dx: -around / this.across, dy: (this.turned.up - before.up) / this.across / (height / width) };
    if (Math.hypot(turn.dx, turn.dy) < STILL) this.turned = before; // trembling adds up to nothing
    else this.send("tilt", turn);
    clearTimeout(this.resting);
    this.resting = setTimeout(() => this.rest(), REST);
  }

  point([dx, dy], fine) {
    const { x, y } = this.crosshair ?? { x: 0.5, y: 0.5 };
    const within = (value) => Math.min(1, Math.max(0, value));
    this.aim({ x: within(x + dx * KEY_TURN * fine), y: within(y + dy * KEY_TURN * fine) });
  }

  aim(point) {
    this.crosshair = point;
    this.stage.show({ crosshair: point });
    this.pointed(point);
  }

  use(tool) {
    this.tool = tool;
    this.aim(AIMS.includes(tool) ? this.crosshair ?? { x: 0.5, y: 0.5 } : null);
  }
}
