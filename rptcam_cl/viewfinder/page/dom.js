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
  const element = h("fieldset", { class: "vf-choice", "data-name": name }, h("legend", { class: "vf-hidden" }, label),
    choices.map((each, i) => h("label", { title: each.title }, inputs[i], h("span", {}, each.label))));
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
