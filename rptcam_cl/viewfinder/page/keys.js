/** Keys for everything, and the sheet that lists them. */

import { h } from "./dom.js";

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
    ["p", "Peaking", (finder) => finder.overlays.set("peaking")],
    ["x", "Magnifier", (finder) => finder.magnifier.set()],
  ]],
  ["Look", [
    ["z", "Zebra", (finder) => finder.overlays.set("zebra")],
    ["v", "False colour", (finder) => finder.overlays.set("false_colour")],
    ["g", "Thirds", (finder) => finder.guides.thirds()],
    ["c", "Compare: off, side by side, wipe", (finder) => finder.compare.next()],
    ["Space", "Pause, go on", (finder) => finder.pause()],
    ["Ctrl+S", "Save the picture"],
    ["t", "Next panel", (finder) => finder.tabs.next()],
    ["?", "This sheet", (finder) => finder.help.open()],
  ]],
];

const ACTIONS = new Map(GROUPS.flatMap(([, rows]) => rows).filter(([, , action]) => action)
  .flatMap(([keys, , action]) => (keys === "Space" ? [" "] : keys.split(" ")).map((key) => [key, action])));
const TYPED = "input:not([type=radio]):not([type=range]), textarea, select";

/** Keys of the keyboard, from where they are pressed, go to the finder. */
export function listen(target, finder) {
  target.addEventListener("keydown", (event) => {
    if (pressed(event, finder)) {
      event.preventDefault();
      event.stopPropagation();
    }
  });
  target.addEventListener("keyup", () => finder.gestures.rest());
}

function pressed(event, finder) {
  if (finder.help.element.open || event.target.closest?.(TYPED) || event.altKey || event.metaKey) return false;
  if (event.ctrlKey) {
    if (event.key.toLowerCase() !== "s") return false;
    finder.out.picture();
    return true;
  }
  if (event.target.closest?.("button, summary, a, [role=tab], input") && [" ", "Enter", "ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"].includes(event.key)) return false;
  const action = ACTIONS.get(event.key);
  if (action) action(finder, event.key);
  else if (event.key === "+" || event.key === "=") finder.gestures.zoom(1);
  else if (event.key === "-") finder.gestures.zoom(-1);
  else if (/^[1-5]$/.test(event.key)) finder.use(Number(event.key) - 1);
  else return finder.gestures.key(event);
  return true;
}

function caps(keys) {
  return keys.split(" ").map((key) => h("kbd", {}, key));
}

/** The sheet of keys, a dialog. */
export function helpSheet() {
  const close = h("button", { type: "button", class: "vf-button", on: { click: () => element.close() } }, "Close");
  const element = h("dialog", { class: "vf-help", "aria-label": "Keys" },
    h("div", { class: "vf-help-head" }, h("h2", {}, "Keys"), close),
    h("div", { class: "vf-help-body" }, GROUPS.map(([name, rows]) => h("section", {}, h("h3", {}, name),
      h("dl", {}, rows.map(([keys, words]) => h("div", {}, h("dt", {}, caps(keys)), h("dd", {}, words))))))),
    h("p", { class: "vf-note" }, "Pointer: click focuses, drag moves as chosen, right button orbits, Shift or the middle button pans, wheel zooms. ",
      "Fingers: one moves as chosen, two pan and zoom. Dials: drag, turn the wheel, arrow keys, or Enter to type a value."));
  return { element, open: () => element.showModal() };
}
