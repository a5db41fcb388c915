/** One dial of the camera: drawn like a ring with its marks, turned by drag, wheel, arrow keys or by typing a value. */

import { h, newId } from "./dom.js";
import { capital, dialText, typed } from "./numbers.js";

const NOTCH = 12; // [CSS pixels] of a drag from step to step
const REST = 250; // [ms] after the last turn of the wheel
const PATIENCE = 400; // [ms] for the state that follows an answer
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
  /** `turned(name, value, transient)` is called with each new value; it returns a promise of the answer when that is final. */
  constructor(description, turned) {
    this.send = turned;
    this.unanswered = 0;
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

  /** Show what the server says of the dial, unless it is in the user's hand. */
  show(description) {
    this.dial = description;
    this.steps = stepsOf(description);
    this.label.textContent = capital(description.label);
    this.element.classList.toggle("vf-linked", Boolean(description.linked));
    this.knob.setAttribute("aria-disabled", String(!description.enabled));
    this.knob.title = `${this.label.textContent}: ${description.linked || "drag, turn the wheel or press Enter to type"}`;
    if (!(this.held || this.unanswered) || description.value === this.steps[this.at]) this.display(description.value, description.text);
  }

  display(value, text = null) {
    this.at = value === null ? 0 : nearest(this.steps, value);
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

  /** Send a value. What the server said before it has answered is older than what the dial shows. */
  async turned(name, value, transient) {
    if (transient) {
      this.send(name, value, true);
      return;
    }
    this.unanswered += 1;
    const refused = await this.send(name, value, false).then(() => false, () => true);
    this.unanswered -= 1;
    const again = () => this.held || this.unanswered || this.display(this.dial.value, this.dial.text);
    if (refused) again();
    else setTimeout(again, PATIENCE);
  }

  /** Turn by so many steps. */
  turn(by, transient = false) {
    if (!this.dial.enabled) return;
    const between = this.steps[this.at] !== this.dial.value && Math.abs(by) === 1 && !this.held && !this.unanswered;
    const past = between && Math.sign(this.steps[this.at] - this.dial.value) === Math.sign(by);
    const at = Math.min(this.steps.length - 1, Math.max(0, this.at + (past ? 0 : by)));
    if (at === this.at && !past) return;
    this.display(this.steps[at]);
    this.turned(this.dial.name, this.steps[at], transient);
  }

  key(event) {
    const by = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -3, PageUp: 3, Home: -1e6, End: 1e6 }[event.key];
    if (by !== undefined) this.turn(by);
    else if (event.key === "Enter") this.type();
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  down(event) {
    if (event.button !== 0 || !this.dial.enabled) return;
    this.knob.setPointerCapture(event.pointerId);
    const from = { x: event.clientX, at: this.at };
    const before = this.at;
    const move = (later) => {
      this.held = true;
      const by = Math.round((later.clientX - from.x) / NOTCH) - (this.at - from.at);
      if (by) this.turn(by, true);
    };
    const end = () => {
      this.knob.removeEventListener("pointermove", move);
      if (this.held && this.at !== before) this.turned(this.dial.name, this.steps[this.at], false);
      this.held = false;
    };
    this.knob.addEventListener("pointermove", move);
    this.knob.addEventListener("pointerup", end, { once: true });
    this.knob.addEventListener("pointercancel", end, { once: true });
  }

  wheel(event) {
    if (!this.dial.enabled) return;
    event.preventDefault();
    this.held = true;
    this.turn(event.deltaY < 0 ? 1 : -1, true);
    clearTimeout(this.resting);
    this.resting = setTimeout(() => {
      this.held = false;
      this.turned(this.dial.name, this.steps[this.at], false);
    }, REST);
  }

  /** Let the user type a value. */
  type() {
    if (!this.dial.enabled) return;
    const input = h("input", { class: "vf-dial-input", type: "text", inputmode: "text", "aria-label": `${this.dial.label}: type a value` });
    input.value = this.value.textContent;
    const end = (accept) => {
      if (!input.isConnected) return;
      const value = accept ? typed(input.value) : null;
      input.remove();
      this.knob.focus();
      if (value !== null) this.turned(this.dial.name, value, false);
    };
    input.addEventListener("keydown", (event) => {
      event.stopPropagation();
      if (event.key === "Enter" || event.key === "Escape") end(event.key === "Enter");
    });
    input.addEventListener("blur", () => end(false));
    this.element.append(input);
    input.focus();
    input.select();
  }
}
