/** Time: the bar of frames below the picture, playing, recording, and the panel with the keys of each channel. */

import { button, choice, h, newId, range, s, toggle } from "./dom.js";
import { digits, distance } from "./numbers.js";

const SPEEDS = [{ value: "1", label: "1×" }, { value: "0.5", label: "½" }, { value: "0.25", label: "¼" }];
const CHANNELS = ["camera", "focus", "f_number", "zoom", "exposure"];
const HEIGHT = 20; // of the track of keys

export class Time {
  constructor(link, dials) {
    Object.assign(this, { link, dials, frame: 1, frames: 2, rate: 24, speed: 1, marks: { A: null, B: null } });
    this.play = button("▶", () => this.run(), { key: "o", name: "play", title: "Play, stop" });
    this.record = toggle("● Record", (on) => this.link.ask("time", { do: "record", on }).catch(() => {}), { key: "u", name: "record" });
    this.record.title = "On: what is turned sets keys here, in each frame while it plays. Off: it carries all keys along.";
    this.track = s("svg", { class: "vf-track", preserveAspectRatio: "none", "aria-hidden": "true" });
    this.words = h("output", { class: "vf-frame-words", "data-name": "frame-words" });
    this.slider = h("input", {
      type: "range", min: 1, max: 2, step: 1, value: 1, "aria-label": "Frame", "data-name": "frame",
      on: { input: () => this.scrub(), change: () => this.go(Number(this.slider.value)) },
    });
    this.strip = h("div", { class: "vf-time", role: "group", "aria-label": "Time", hidden: true },
      this.play, this.record, h("div", { class: "vf-scrub" }, this.track, this.slider), this.words);
    link.on("state", ({ time, answers }) => time && this.standing(time, answers ?? 0));
    link.on("link", () => { this.stop(false); this.after = 0; });
  }

  /** Show the bar where something has keys, or its panel is open. */
  offer(open = this.open) {
    this.open = open;
    this.strip.hidden = !(open || this.keyed || this.recording);
  }

  standing({ frame, frames, frames_per_second: rate, record, channels, others }, answers) {
    Object.assign(this, { rate, frames, recording: record });
    this.keyed = others.length > 0 || channels.some(({ keys }) => keys.length > 0);
    this.record.show(record);
    this.slider.max = frames;
    if (document.activeElement !== this.length) this.length.value = frames;
    if (!this.running && !this.scrubbing && answers >= (this.after ?? 0)) this.show(frame);
    const at = (key) => digits((1000 * (key - 1)) / Math.max(1, frames - 1), 5);
    this.track.setAttribute("viewBox", `0 0 1000 ${HEIGHT}`);
    this.track.replaceChildren(...[{ name: "others", keys: others }, ...channels].flatMap(({ name, keys }, i) => keys
      .filter((key) => key >= 1 && key <= frames).map((key) => s("path", { class: `vf-key-mark vf-key-${name}`, d: `M${at(key)} ${3 * i}v4` }))));
    for (const { name, keys } of channels) {
      const row = this.rows[name];
      const here = keys.some((key) => Math.abs(key - frame) < 1e-4);
      row.count.textContent = keys.length ? `${keys.length} ${keys.length === 1 ? "key" : "keys"}${here ? ", one here" : ""}` : "no keys";
      row.unkey.disabled = !here;
      row.clear.disabled = keys.length === 0;
    }
    this.offer();
  }

  show(frame) {
    this.frame = frame;
    this.slider.value = frame;
    const seconds = digits((Math.max(frame, 1) - 1) / this.rate, 3);
    this.words.textContent = frame ? `${frame} / ${this.frames} · ${seconds}\u00a0s` : "as it stands";
    this.slider.setAttribute("aria-valuetext", frame ? `frame ${frame} of ${this.frames}, ${seconds} seconds` : "the scene as it stands");
  }

  scrub() {
    this.stop(false);
    this.scrubbing = true;
    this.show(Number(this.slider.value));
    this.link.soon("time", "time", { do: "go", frame: this.frame, transient: true });
  }

  go(frame) {
    this.stop(false);
    this.scrubbing = false;
    this.show(Math.min(this.frames, Math.max(1, frame)));
    this.link.flush();
    this.tell({ do: "go", frame: this.frame });
    this.after = this.link.number; // states before that one show where it was
  }

  /** Play from here, or from the first frame at the end; stop where it plays. */
  run() {
    if (this.running) {
      this.stop(true);
      return;
    }
    const begun = performance.now();
    const first = this.frame >= this.frames ? 1 : Math.max(this.frame, 1);
    this.running = true;
    this.play.firstChild.data = "■";
    const tick = () => {
      const count = Math.floor(((performance.now() - begun) / 1000) * this.rate * this.speed);
      const ends = first + count > this.frames && (!this.loops.isOn() || this.recording);
      const frame = ends ? this.frames : ((first - 1 + count) % this.frames) + 1;
      if (frame !== this.frame || count === 0) {
        this.show(frame);
        this.link.soon("time", "time", { do: "go", frame, playing: true, transient: true });
      }
      if (ends) this.stop(true);
      else this.due = requestAnimationFrame(tick);
    };
    tick();
  }

  stop(tells) {
    if (!this.running) return;
    cancelAnimationFrame(this.due);
    this.running = false;
    this.play.firstChild.data = "▶";
    if (tells) this.go(this.frame);
  }

  tell(keys) {
    return this.link.ask("time", keys).catch(() => {}); // the message shows why
  }

  row(name, label) {
    const count = h("span", { class: "vf-soft", "data-name": `keys-${name}` }, "no keys");
    const act = (what, words, title) => button(words, () => this.tell({ do: what, channel: name }), { name: `${what}-${name}`, title: `${label}: ${title}` });
    const [key, unkey, clear] = [act("key", "Key", "set a key in this frame"), act("unkey", "Delete", "delete the key in this frame"), act("clear", "All", "delete all keys")];
    for (const each of [key, unkey, clear]) each.setAttribute("aria-label", each.title);
    this.rows[name] = { count, unkey, clear };
    return h("div", { class: "vf-key-row" }, h("b", {}, h("i", { class: `vf-key-dot vf-key-${name}` }), label), count, key, unkey, clear);
  }

  mark(name) {
    const element = button(`Mark ${name}`, () => {
      const value = this.dials.latest.get("focus_m")?.value;
      if (typeof value !== "number") return;
      this.marks[name] = value;
      element.firstChild.data = `${name}: ${distance(value)}`;
      this.pull.disabled = this.marks.A === null || this.marks.B === null;
    }, { name: `mark-${name}`, title: `Keep the distance in focus as mark ${name}` });
    return element;
  }

  rack() {
    const { A, B } = this.marks;
    return this.tell({ do: "rack", from_m: A, to_m: B, seconds: this.seconds });
  }

  panel() {
    this.rows = {};
    this.seconds = 1;
    const id = newId("length");
    this.length = h("input", { id, type: "text", inputmode: "numeric", value: 2, "data-name": "frames", on: { change: () => this.lengthen() } });
    this.loops = toggle("Loop", () => {}, { name: "loop" });
    this.loops.isOn = () => this.loops.getAttribute("aria-pressed") === "true";
    this.pull = button("Pull from A to B", () => this.rack(), { name: "rack" });
    this.pull.disabled = true;
    const labels = { camera: "Camera", focus: "Focus", f_number: "f-number", zoom: "Zoom", exposure: "Exposure" };
    return h("div", { class: "vf-panel" },
      h("h2", {}, "Playing"),
      h("div", { class: "vf-row" }, choice("Speed", SPEEDS, (value) => { this.speed = Number(value); }, { value: "1", name: "speed" }), this.loops),
      h("div", { class: "vf-field" }, h("label", { for: id }, "Frames"), this.length),
      h("h2", {}, "Keys in this frame"), CHANNELS.map((name) => this.row(name, labels[name])),
      h("p", { class: "vf-note" }, "While Record is on, what you turn sets keys: drag the focus dial while it plays. While it is off, it carries all keys along. Saved as YAML, the keys are the scene's own."),
      h("h2", {}, "Focus pull"), h("div", { class: "vf-row" }, this.mark("A"), this.mark("B"), this.pull),
      range("Takes", { min: 0.25, max: 6, step: 0.25, value: 1, name: "seconds", text: (value) => `${digits(value)}\u00a0s`, changed: (value) => { this.seconds = value; } }));
  }

  lengthen() {
    const frame = Number(this.length.value);
    const good = Number.isInteger(frame) && frame >= 2 && frame <= 1e6;
    this.length.setAttribute("aria-invalid", String(!good));
    this.length.title = good ? "" : "Type a whole number of frames, 2 or more";
    if (good) this.tell({ do: "length", frame });
  }
}
