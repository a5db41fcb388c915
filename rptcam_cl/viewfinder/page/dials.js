/** The camera's dials as the server lists them: those of an exposure below the picture, the others in the panel. */

import { h, newId, select, toggle } from "./dom.js";
import { Dial } from "./dial.js";
import { capital } from "./numbers.js";

// In the order of a camera's display; what else the server lists lies in the panel "Camera".
const STRIP = ["mode", "shutter_s", "f_number", "iso", "auto_iso", "ev", "lock", "focus_m", "zoom"];
const TONES = { srgb: "sRGB", aces: "ACES", agx: "AgX" }; // as their makers write them
const MODES = {
  M: "Manual: you set aperture, time and ISO",
  A: "Aperture priority: the camera sets the time",
  S: "Shutter priority: the camera sets the aperture",
  P: "Program: the camera sets aperture and time",
};

function modes(dial, turned) {
  const name = newId("modes");
  const inputs = dial.choices.map(({ value, label }) => h("input", { type: "radio", name, value, "aria-label": MODES[value] ?? label, on: { change: () => turned(dial.name, value, false) } }));
  const element = h("fieldset", { class: "vf-modes", "data-dial": dial.name }, h("legend", { class: "vf-hidden" }, dial.label),
    dial.choices.map(({ value, label }, i) => h("label", { title: MODES[value] ?? label },
      inputs[i], h("span", { class: value.length > 1 ? "vf-word" : null }, value.length > 1 ? capital(label) : value))));
  return {
    element,
    show(latest) {
      inputs.forEach((input) => { input.checked = input.value === latest.value; });
      element.disabled = !latest.enabled;
    },
  };
}

function list(dial, turned) {
  const valueOf = (text) => (text === "" ? null : dial.choices.find((each) => String(each.value) === text)?.value ?? text);
  const element = select(capital(dial.label), [], () => {}, {});
  const field = element.querySelector("select");
  field.dataset.dial = dial.name;
  field.addEventListener("change", () => turned(dial.name, valueOf(field.value), false));
  let filled = "";
  return {
    element,
    show(latest) {
      dial = latest;
      const own = latest.choices.some((each) => each.value === latest.value) ? [] : [{ value: latest.value ?? "", label: latest.text || "–" }];
      const choices = [...own, ...latest.choices].map((each) => ({ value: each.value ?? "", label: TONES[each.value] ?? capital(each.label) }));
      const known = JSON.stringify(choices);
      if (known !== filled) element.fill(choices, latest.value);
      filled = known;
      element.show(latest.value);
      element.enable(latest.enabled);
      element.title = latest.linked ?? "";
    },
  };
}

function onOff(dial, turned) {
  const element = toggle(capital(dial.label), (pressed) => turned(dial.name, pressed, false));
  element.dataset.dial = dial.name;
  return {
    element,
    show(latest) {
      element.show(Boolean(latest.value));
      element.disabled = !latest.enabled;
      element.title = latest.linked ?? latest.text ?? "";
    },
  };
}

function text(dial, turned) {
  const id = newId("text");
  const input = h("input", { id, type: "text", "data-dial": dial.name, on: { change: () => turned(dial.name, input.value, false) } });
  return {
    element: h("div", { class: "vf-field" }, h("label", { for: id }, capital(dial.label)), input),
    show(latest) {
      if (document.activeElement !== input) input.value = latest.value ?? "";
      input.disabled = !latest.enabled;
    },
  };
}

function made(dial, turned) {
  if (dial.kind === "number") return new Dial(dial, turned);
  if (dial.kind === "bool") return onOff(dial, turned);
  if (dial.kind === "text") return text(dial, turned);
  return dial.name === "mode" ? modes(dial, turned) : list(dial, turned);
}

export class Dials {
  constructor(link) {
    this.link = link;
    this.known = new Map();
    this.hands = new Map(); // what dials were turned to, until a state comes that has it
    this.latest = new Map();
    this.strip = h("div", { class: "vf-dials", role: "group", "aria-label": "Dials" });
    this.others = h("div", { class: "vf-others" });
    this.things = h("div", { class: "vf-others" }); // of what is selected
    this.mix = h("div", { class: "vf-others" }); // of the light of lamps
    link.on("link", () => this.hands.clear()); // what was under way is lost
    link.on("hello", (message) => this.show(message.dials ?? []));
    link.on("state", ({ dials = [], answers }) => this.show(dials, answers ?? 0));
  }

  /** Show dials as the server lists them, after the message `answers` of this page; those in the user's hand stay as they are. */
  show(dials, answers = 0) {
    this.latest = new Map(dials.map((each) => [each.name, each]));
    this.answers = answers;
    const turned = (...how) => this.turned(...how);
    for (const dial of dials) {
      if (!this.known.has(dial.name)) this.add(dial.name, made(dial, turned));
      const hand = this.hands.get(dial.name);
      if (hand && !hand.held && !hand.asked && answers >= hand.after) this.hands.delete(dial.name);
      if (this.hands.has(dial.name)) this.known.get(dial.name).show({ ...dial, value: hand.value, text: null }, hand.value);
      else this.known.get(dial.name).show(dial);
    }
    for (const [name, { element }] of this.known) element.hidden = !this.latest.has(name);
  }

  add(name, control) {
    const place = STRIP.indexOf(name);
    control.element.dataset.place = place;
    this.known.set(name, control);
    if (place < 0) {
      (name.startsWith("thing_") ? this.things : name.startsWith("mix") ? this.mix : this.others).append(control.element);
      return;
    }
    const after = [...this.strip.children].find((each) => Number(each.dataset.place) > place);
    this.strip.insertBefore(control.element, after ?? null);
  }

  /** Send a new value; while the control is held at most one for each picture of the screen. */
  async turned(name, value, transient) {
    const hand = this.hands.get(name) ?? { asked: 0, after: 0 };
    this.hands.set(name, Object.assign(hand, { value, held: transient }));
    if (transient) {
      this.link.soon(`dial ${name}`, "dial", { name, value, transient });
      return;
    }
    this.link.flush();
    hand.asked += 1;
    try {
      const { id, superseded } = await this.link.ask("dial", { name, value, transient });
      if (!superseded) hand.after = Math.max(hand.after, id);
    } catch { /* the message shows why */ }
    hand.asked -= 1;
    if (this.hands.get(name) === hand) this.show([...this.latest.values()], this.answers);
  }

  /** Write something small beside a dial's name. */
  hint(name, text) {
    const dial = this.known.get(name);
    if (!(dial instanceof Dial) || dial.hint === text) return;
    dial.hint = text;
    dial.showLabel();
  }

  /** Turn a dial by steps, as keys do. */
  step(name, by) {
    const control = this.known.get(name);
    if (control instanceof Dial && !control.element.hidden) control.turn(by);
  }

  /** Go to the next choice, or press a button, as keys do. */
  next(name) {
    const dial = this.latest.get(name);
    if (!dial?.enabled) return;
    const value = this.hands.get(name)?.value ?? dial.value;
    let wanted = !value;
    if (dial.kind === "choice") wanted = dial.choices[(dial.choices.findIndex((each) => each.value === value) + 1) % dial.choices.length].value;
    else if (dial.kind !== "bool") return;
    this.known.get(name).show({ ...dial, value: wanted, text: null }, wanted);
    this.turned(name, wanted, false);
  }
}
