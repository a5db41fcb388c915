/** One dial of the camera: drawn like a ring with its marks, turned by drag, wheel, arrow keys or by typing a value. */

import { h, newId, Notches } from "./dom.js";
import { capital, dialText, typed } from "./numbers.js";

const NOTCH = 12; // [CSS pixels] of a drag from step to step
const REST = 250; // [ms] after the last turn of the wheel
const ON_STEP = 0.05; // of the way to the next step, within which a value is the step's
const SMOOTH = 120; // steps over the reach of a dial without steps of its own

/** The values that a dial clicks through. */
export function stepsOf(dial) {
  if (dial.steps?.length) return dial.steps;
  const { min, max } = dial;
  if (!Number.isFinite(min) || !Number.isFinite(max)) return [dial.value];
  if (dial.step) {
    const count = Math.min(2000, Math.round((max - min) / dial.step));
    return Array.from({ length: count + 1 }, (_, i) => Number((min + i * dial.step).toPrecision(12)));
  }
  const even = min > 0 && max / min > 4; // by ratio, where the reach is wide
  return Array.from({ length: SMOOTH + 1 }, (_, i) => (even ? min * (max / min) ** (i / SMOOTH) : min + ((max - min) * i) / SMOOTH));
}

function nearest(steps, value) {
  let found = 0;
  steps.forEach((step, i) => {
    if (Math.abs(step - value) < Math.abs(steps[found] - value)) found = i;
  });
  return found;
}

export class Dial {
  /** `turned(name, value, transient)` is called with each new value; transient while more will come at once. */
  constructor(description, turned) {
    this.send = turned;
    this.notches = new Notches();
    this.label = h("span", { class: "vf-dial-label", id: newId("dial") });
    this.value = h("span", { class: "vf-dial-value" });
    this.ring = h("span", { class: "vf-dial-ring" });
    this.knob = h("div", {
      class: "vf-knob", role: "slider", tabindex: 0, "aria-labelledby": this.label.id, "data-dial": description.name,
      on: {
        keydown: (event) => this.key(event),
        pointerdown: (event) => this.down(event),
        dblclick: () => this.type(),
      },
    }, this.label, this.value, this.ring);
    this.knob.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    this.element = h("div", { class: "vf-dial" }, this.knob);
    this.show(description);
  }

  /** Show what the server says of the dial, or what the hand has turned it to meanwhile. */
  show(description, inHand = undefined) {
    this.dial = description;
    this.steps = stepsOf(description);
    this.showLabel();
    this.element.classList.toggle("vf-linked", Boolean(description.linked));
    this.knob.setAttribute("aria-disabled", String(!description.enabled));
    this.knob.title = `${capital(description.label)}: ${description.linked || "drag, turn the wheel or press Enter to type"}`;
    if (inHand === undefined) this.display(description.value, description.text);
    else this.display(inHand);
  }

  showLabel() {
    this.label.replaceChildren(capital(this.dial.label), this.hint ? h("span", { class: "vf-dial-hint" }, this.hint) : "");
  }

  display(value, text = null) {
    this.current = value;
    this.at = nearest(this.steps, value ?? this.dial.start ?? this.steps[0]);
    const written = text || dialText(this.dial, value);
    const { label } = this.dial;
    const shown = written.startsWith(`${label} `) ? written.slice(label.length + 1) : written;
    this.value.textContent = shown;
    this.ring.style.backgroundPositionX = `calc(50% - ${this.at * 6}px)`;
    this.knob.setAttribute("aria-valuetext", shown);
    this.knob.setAttribute("aria-valuemin", 0);
    this.knob.setAttribute("aria-valuemax", this.steps.length - 1);
    this.knob.setAttribute("aria-valuenow", this.at);
  }

  /** The place of the step that so many clicks lead to. The first click from between two steps goes to one of them. */
  reached(by) {
    const { at, current, steps } = this;
    const off = current === null ? -by : current - steps[at];
    const next = steps[at + Math.sign(off)] ?? steps[at];
    const begins = current === null || (Math.abs(off) > ON_STEP * Math.abs(next - steps[at]) && off * by < 0);
    return Math.min(steps.length - 1, Math.max(0, at + by - (begins ? Math.sign(by) : 0)));
  }

  /** Turn by so many steps; return whether it turns. */
  turn(by, transient = false) {
    if (!this.dial.enabled || !by) return false;
    const value = this.steps[this.reached(by)];
    if (value === this.current) return false;
    this.display(value);
    this.send(this.dial.name, value, transient);
    return true;
  }

  key(event) {
    const by = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -3, PageUp: 3, Home: -1e6, End: 1e6 }[event.key];
    if (event.altKey || event.ctrlKey || event.metaKey) return;
    if (by !== undefined) this.turn(by);
    else if (event.key === "Enter") this.type();
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  down(event) {
    if (event.button !== 0 || !this.dial.enabled) return;
    this.knob.setPointerCapture(event.pointerId);
    let clicks = 0;
    let turned = false;
    const move = (later) => {
      const by = Math.round((later.clientX - event.clientX) / NOTCH) - clicks;
      clicks += by;
      turned = this.turn(by, true) || turned;
    };
    const end = () => {
      this.knob.removeEventListener("pointermove", move);
      if (turned) this.send(this.dial.name, this.current, false);
    };
    this.knob.addEventListener("pointermove", move);
    this.knob.addEventListener("lostpointercapture", end, { once: true });
  }

  wheel(event) {
    if (!this.dial.enabled || event.ctrlKey) return; // with Ctrl the page is made larger
    event.preventDefault();
    this.wheeled = this.turn(this.notches.of(event), true) || this.wheeled;
    clearTimeout(this.resting);
    this.resting = setTimeout(() => {
      if (this.wheeled) this.send(this.dial.name, this.current, false);
      this.wheeled = false;
    }, REST);
  }

  /** Let the user type a value: Enter or leaving takes it, Escape does not; what cannot be read stays to be mended. */
  type() {
    if (!this.dial.enabled || this.typing) return;
    const before = this.value.textContent;
    const input = h("input", { class: "vf-dial-input", type: "text", inputmode: "text", "aria-label": `${this.dial.label}: type a value` });
    input.value = before;
    this.typing = true;
    const close = (value) => {
      if (!this.typing) return; // removing an input takes its focus, which closes it
      this.typing = false;
      const focused = document.activeElement === input;
      input.remove();
      if (focused) this.knob.focus();
      if (value === null) return;
      this.display(value);
      this.send(this.dial.name, value, false);
    };
    const accept = () => {
      const value = input.value.trim() === before ? null : typed(input.value, this.dial.unit);
      if (value === null && input.value.trim() !== before) refuse();
      else close(value);
    };
    const refuse = () => {
      input.setAttribute("aria-invalid", "true");
      input.title = `This is no value of ${this.dial.label}`;
      input.select();
    };
    input.addEventListener("keydown", (event) => {
      event.stopPropagation();
      if (event.key === "Enter") accept();
      if (event.key === "Escape") close(null);
    });
    input.addEventListener("input", () => input.removeAttribute("aria-invalid"));
    input.addEventListener("blur", () => close(input.value.trim() === before ? null : typed(input.value, this.dial.unit)));
    this.element.append(input);
    input.focus();
    input.select();
  }
}
