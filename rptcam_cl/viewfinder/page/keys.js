/** Keys for everything, and the sheet that lists them. */

import { h, toggle } from "./dom.js";

/** The keys in groups: [keys, what they do, function of the finder]. Keys without a function are handled elsewhere. */
const GROUPS = [
  ["Camera", [
    ["1 2 3 4", "Arrow keys and drags turn, orbit, pan, dolly"],
    ["← → ↑ ↓", "Move so; with Shift finely"],
    ["w a s d", "Walk; q down, e up"],
    ["+ −", "Zoom in, out (the wheel)"],
    ["r", "Camera as in the file", (finder) => finder.out.asked("reset", { what: "camera" })],
  ]],
  ["Exposure", [
    ["[ ]", "f-number", (finder, key) => finder.dials.step("f_number", key === "[" ? -1 : 1)],
    [", .", "Shutter", (finder, key) => finder.dials.step("shutter_s", key === "," ? -1 : 1)],
    ["; '", "ISO", (finder, key) => finder.dials.step("iso", key === ";" ? -1 : 1)],
    ["( )", "Compensation", (finder, key) => finder.dials.step("ev", key === "(" ? -1 : 1)],
    ["m", "Mode M, A, S, P", (finder) => finder.dials.next("mode")],
    ["i", "Auto ISO", (finder) => finder.dials.next("auto_iso")],
    ["l", "Lock the exposure", (finder) => finder.dials.next("lock")],
  ]],
  ["Focus", [
    ["f", "Autofocus", (finder) => finder.focus.auto()],
    ["j k", "Focus nearer, farther", (finder, key) => finder.dials.step("focus_m", key === "j" ? -1 : 1)],
    ["5", "Point: arrows move the crosshair"],
    ["Enter", "Focus at the crosshair"],
    ["6", "Select: a click, or Enter, selects a thing"],
    ["p", "Peaking", (finder) => finder.overlays.set("peaking")],
    ["x", "Magnifier: 1:1, 5×, 10×, off", (finder) => finder.magnifier.next()],
  ]],
  ["Look", [
    ["F", "Full screen", (finder) => finder.fill()],
    ["h", "Hide the panels", (finder) => finder.bare()],
    ["y", "Scope: histogram, waveform, parade, vectorscope", (finder) => finder.scopes.next()],
    ["z", "Zebra", (finder) => finder.overlays.set("zebra")],
    ["v", "False colour", (finder) => finder.overlays.set("false_colour")],
    ["n", "Denoise", (finder) => finder.denoise()],
    ["g", "Thirds", (finder) => finder.guides.thirds()],
    ["c", "Compare: off, side by side, wipe", (finder) => finder.compare.next()],
    ["Space", "Pause, go on", (finder) => finder.pause()],
    ["Ctrl+Z Ctrl+Shift+Z", "Undo, redo"],
    ["o", "Play, stop", (finder) => finder.time.run()],
    ["u", "Record keys", (finder) => finder.time.record.click()],
    ["< >", "Frame before, after", (finder, key) => finder.time.go(finder.time.frame + (key === "<" ? -1 : 1))],
    ["b", "Keep a snapshot", (finder) => finder.history.tell("snap")],
    ["Ctrl+S", "Save the picture"],
    ["t", "Next panel", (finder) => finder.tabs.next()],
    ["?", "This sheet", (finder) => finder.help.open()],
  ]],
];

const ACTIONS = new Map(GROUPS.flatMap(([, rows]) => rows).filter(([, , action]) => action)
  .flatMap(([keys, , action]) => (keys === "Space" ? [" "] : keys.split(" ")).map((key) => [key, action])));
const TYPED = "input:not([type=radio]):not([type=range]), textarea, select";
const OWN = "button, summary, a, [role=tab], input"; // what has a meaning of its own for Space and Enter
const MOVED = "[role=tab], input"; // and for arrows
const KEPT = "rptcam-keys";

function kept() {
  try {
    return localStorage.getItem(KEPT) !== "off";
  } catch {
    return true; // a browser that keeps nothing
  }
}

/** Keys of the keyboard, from where they are pressed, go to the finder. */
export function listen(target, finder) {
  target.addEventListener("keydown", (event) => {
    if (pressed(event, finder)) {
      event.preventDefault();
      event.stopPropagation();
    }
  });
  target.addEventListener("keyup", () => finder.gestures.rest());
  giveBack(finder);
}

/** After a choice by pointer the keys belong to the picture again: arrows would make another choice. */
function giveBack({ root, stage }) {
  const picked = "input[type=radio], select";
  let pointed = null;
  const back = ({ target, type }) => {
    if (target !== pointed || (type === "click" && target.matches("select"))) return;
    pointed = null;
    stage.element.focus({ preventScroll: true });
  };
  root.addEventListener("pointerdown", (event) => { pointed = event.target.closest?.(picked); }, true);
  root.addEventListener("keydown", () => { pointed = null; }, true);
  for (const type of ["click", "change"]) root.addEventListener(type, back);
}

/** Whether a key was pressed with another that makes it mean something else. Characters that need AltGr or Option are themselves. */
function isOther(event) {
  if (event.metaKey) return true;
  const typesSymbol = event.key.length === 1 && !/[\p{L}\p{N}\s]/u.test(event.key);
  if (event.getModifierState?.("AltGraph") || event.altKey) return !typesSymbol;
  return event.ctrlKey;
}

function pressed(event, finder) {
  if (finder.help.element.open || event.target.closest?.(TYPED)) return false;
  if (event.ctrlKey && !event.altKey && event.key.toLowerCase() === "s") {
    finder.out.picture();
    return true;
  }
  if ((event.ctrlKey || event.metaKey) && !event.altKey && ["z", "y"].includes(event.key.toLowerCase())) {
    finder.history.tell(event.shiftKey || event.key.toLowerCase() === "y" ? "redo" : "undo");
    return true;
  }
  if (isOther(event) || (event.key.length === 1 && !finder.help.on)) return false;
  if ([" ", "Enter"].includes(event.key) && event.target.closest?.(OWN)) return false;
  if (event.key.startsWith("Arrow") && (event.target.closest?.(MOVED) || event.target.matches?.("[role=tabpanel]"))) return false; // which scrolls
  const action = ACTIONS.get(event.key) ?? ACTIONS.get(event.key.toLowerCase()); // F is another than f
  if (action) action(finder, event.key);
  else if (event.key === "+" || event.key === "=") finder.gestures.zoom(1);
  else if (event.key === "-" || event.key === "−") finder.gestures.zoom(-1);
  else if (/^[1-6]$/.test(event.key)) finder.use(Number(event.key) - 1);
  else return finder.gestures.key(event);
  return true;
}

function caps(keys) {
  return keys.split(" ").map((key) => h("kbd", {}, key));
}

/** The sheet of keys, a dialog. Keys of one character can be switched off here (WCAG 2.1.4); `on` says whether they act. */
export function helpSheet(root) {
  const close = h("button", { type: "button", class: "vf-button", on: { click: () => element.close() } }, "Close");
  const single = toggle("Keys of one character", (pressed) => turn(pressed), { pressed: true, name: "keys" });
  const element = h("dialog", { class: "vf-help", "aria-label": "Keys" },
    h("div", { class: "vf-help-head" }, h("h2", {}, "Keys"), single, close),
    h("div", { class: "vf-help-body" }, GROUPS.map(([name, rows]) => h("section", {}, h("h2", {}, name),
      h("dl", {}, rows.map(([keys, words]) => h("div", {}, h("dt", {}, caps(keys)), h("dd", {}, words))))))),
    h("p", { class: "vf-note" }, "Pointer: click focuses, drag moves as chosen, right button orbits, Shift or the middle button pans, wheel zooms. ",
      "Fingers: one moves as chosen, two pan and zoom. Dials: drag, turn the wheel, arrow keys, or Enter to type a value. ",
      "Without keys of one character, arrows, Enter, Ctrl+S and Ctrl+Z remain."));
  const sheet = { element, on: kept(), open: () => element.showModal() };
  function turn(on) {
    sheet.on = on;
    root.classList.toggle("vf-quiet", !on);
    single.show(on);
    try {
      localStorage.setItem(KEPT, on ? "on" : "off");
    } catch { /* then they are on again next time */ }
  }
  turn(sheet.on);
  return sheet;
}
