/** Elements of HTML and SVG, made in one expression. */

const SVG = "http://www.w3.org/2000/svg";

function filled(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "on") {
      for (const [event, listener] of Object.entries(value)) element.addEventListener(event, listener);
    } else if (value !== null && value !== undefined && value !== false) {
      element.setAttribute(name, value === true ? "" : value);
    }
  }
  element.append(...children.flat(2).filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

/** An element of HTML. `on` maps events to listeners; attributes that are null or false are left out. */
export function h(tag, attributes = {}, ...children) {
  return filled(document.createElement(tag), attributes, children);
}

/** An element of SVG. */
export function s(tag, attributes = {}, ...children) {
  return filled(document.createElementNS(SVG, tag), attributes, children);
}

let made = 0;

/** A new identifier for an element that others refer to. */
export function newId(stem) {
  made += 1;
  return `vf-${stem}-${made}`;
}

/** A button that stays pressed. `changed(pressed)` is called after a press. */
export function toggle(label, changed, { pressed = false, key = null, name = null } = {}) {
  const button = h("button", {
    type: "button",
    class: "vf-button",
    "aria-pressed": String(pressed),
    "aria-keyshortcuts": key,
    "data-name": name,
    on: { click: () => set(button.getAttribute("aria-pressed") !== "true", true) },
  }, label, key && h("kbd", { "aria-hidden": "true" }, key));
  function set(value, tell) {
    button.setAttribute("aria-pressed", String(value));
    if (tell) changed(value);
  }
  button.show = (value) => set(value, false);
  return button;
}

/** A push button. */
export function button(label, pressed, { key = null, name = null, title = null } = {}) {
  return h("button", {
    type: "button", class: "vf-button", "aria-keyshortcuts": key, "data-name": name, title, on: { click: pressed },
  }, label, key && h("kbd", { "aria-hidden": "true" }, key));
}

/** One of several values, as buttons in a row. `choices` are {value, label}; `chosen(value)` is called after a press. */
export function choice(label, choices, chosen, { value = null, name = null } = {}) {
  const group = newId("choice");
  const inputs = choices.map((each) => h("input", {
    type: "radio", name: group, value: each.value, checked: each.value === value, "aria-keyshortcuts": each.key,
    on: { change: () => chosen(each.value) },
  }));
  const labels = choices.map((each, i) => h("label", { title: each.title }, inputs[i], h("span", {}, each.label)));
  const element = h("fieldset", { class: "vf-choice", "data-name": name }, h("legend", { class: "vf-hidden" }, label), labels);
  element.offer = (values) => labels.forEach((each, i) => { each.hidden = !values.includes(choices[i].value); });
  element.show = (wanted) => inputs.forEach((input, i) => { input.checked = choices[i].value === wanted; });
  element.enable = (enabled) => { element.disabled = !enabled; };
  return element;
}

/** A labelled list to select from. */
export function select(label, choices, chosen, { value = null, name = null } = {}) {
  const id = newId("select");
  const list = h("select", { id, "data-name": name, on: { change: () => chosen(list.value) } });
  const element = h("div", { class: "vf-field" }, h("label", { for: id }, label), list);
  element.fill = (those, wanted) => {
    list.replaceChildren(...those.map((each) => h("option", { value: each.value }, each.label)));
    element.show(wanted);
  };
  element.show = (wanted) => { list.value = wanted ?? ""; };
  element.enable = (enabled) => { list.disabled = !enabled; };
  element.fill(choices, value);
  return element;
}

/** A labelled range with its value beside it. */
export function range(label, { min, max, step, value, text, changed, name = null }) {
  const id = newId("range");
  const shown = h("output", { for: id }, text(value));
  const input = h("input", {
    id, type: "range", min, max, step, value, "data-name": name, "aria-valuetext": text(value),
    on: { input: () => { show(Number(input.value)); changed(Number(input.value)); } },
  });
  function show(number) {
    input.value = number;
    input.setAttribute("aria-valuetext", text(number));
    shown.textContent = text(number);
  }
  const element = h("div", { class: "vf-field vf-range" }, h("label", { for: id }, label), shown, input);
  element.show = show;
  return element;
}

const PIXELS = 100; // [CSS pixels] that a trackpad slides for a notch of a wheel
const COARSE = 40; // [CSS pixels] of an event from which it may be a notch, whatever the page's zoom makes of it
const TOUCH = 0.04; // [notches] of the first event of a hand that turn a step at once
const LET_GO = 600; // [ms] without an event, after which a hand begins anew
const LINES = 3; // of a notch, where a browser counts lines
const TICK = 120; // what a notch is in `wheelDelta`

/** How far an event turns a wheel towards larger values [notches]; a trackpad turns it by parts of one. */
export function wheelTurn(event) {
  const { deltaMode, deltaX, deltaY, wheelDeltaX = 0, wheelDeltaY = 0 } = event;
  const [delta, ticks] = deltaY || !event.shiftKey ? [deltaY, wheelDeltaY] : [deltaX, wheelDeltaX]; // Shift turns a wheel sideways
  if (deltaMode === 2) return -Math.sign(delta);
  if (deltaMode === 1) return -delta / LINES;
  const isWheel = Math.abs(delta) >= COARSE && ticks !== 0 && ticks % TICK === 0 && ticks !== -3 * delta; // trackpads count three a pixel
  return isWheel ? ticks / TICK : -delta / PIXELS;
}

/** Whole notches of a wheel; what a trackpad slides less than one is kept until the hand lets go or turns back. */
export class Notches {
  constructor() {
    this.part = 0;
    this.last = -LET_GO;
  }

  of(event) {
    const turn = wheelTurn(event);
    const begins = event.timeStamp - this.last >= LET_GO;
    this.last = event.timeStamp;
    if (begins || turn * this.part < 0) this.part = 0;
    if (begins && Math.abs(turn) >= TOUCH && Math.abs(turn) < 1) return Math.sign(turn);
    this.part += turn;
    const whole = Math.trunc(this.part + Math.sign(this.part) * 1e-9);
    this.part -= whole;
    return whole;
  }
}
