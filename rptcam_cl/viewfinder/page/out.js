/** What leaves the viewfinder: the picture as a file, the scene as YAML, the command that renders it. */

import { button, choice, h, newId, toggle } from "./dom.js";
import { distance } from "./numbers.js";

const FORMATS = [
  { value: "png", label: "PNG" },
  { value: "jpeg", label: "JPEG" },
  { value: "exr", label: "EXR" },
  { value: "dng", label: "DNG" },
];
const BRACKETS = [
  { value: "1x0", label: "One" },
  { value: "3x1", label: "3 × 1 EV" },
  { value: "3x2", label: "3 × 2 EV" },
  { value: "5x1", label: "5 × 1 EV" },
];
const SUFFIX = { png: "png", jpeg: "jpg", exr: "exr", dng: "dng" };
const STACK = "Stack the focus";
const KEPT_FOR = 60000; // [ms] that a browser has to fetch a download

/** Offer bytes or text as a file. */
export function download(name, content, media) {
  const address = URL.createObjectURL(new Blob([content], { type: media }));
  const link = h("a", { href: address, download: name });
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(address), KEPT_FOR);
}

async function copied(text, area) {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    area.focus();
    area.select(); // without permission the user copies what is selected
    return false;
  }
}

export class Out {
  constructor(link, toast, dials) {
    Object.assign(this, { link, toast, dials, ends: {}, format: "png", scene: "picture", bracket: "1x0" });
    this.formats = choice("Format", FORMATS, (value) => { this.format = value; }, { value: "png", name: "format" });
    this.text = h("textarea", { id: newId("text"), rows: 8, readonly: true, spellcheck: "false", hidden: true, "data-name": "text", "aria-label": "Text to copy" });
    link.on("state", ({ files }) => files && this.offer(files));
    link.on("hello", ({ scene }) => { this.scene = (scene ?? "picture").replace(/\.\w+$/, ""); });
  }

  /** The name of files, without what none may have. */
  get stem() {
    return this.scene.replace(/[^A-Za-z0-9 _.-]/g, "_").slice(0, 60);
  }

  /** Offer the formats that the scene has: raw files are of scenes with a sensor alone. */
  offer(files) {
    if (!files.includes(this.format)) [this.format] = files;
    this.formats.offer(files);
    this.formats.show(this.format);
  }

  /** Save the picture in the format chosen; of a bracket several, exposed by so many stops more and less. */
  async picture() {
    const [count, step] = this.bracket.split("x").map(Number);
    const { stem } = this;
    const evs = Array.from({ length: count }, (_, i) => (i - (count - 1) / 2) * step);
    const names = evs.map((ev) => `${stem}${count > 1 ? ` ${ev < 0 ? "minus" : "plus"} ${Math.abs(ev)} EV` : ""}.${SUFFIX[this.format]}`);
    const files = await Promise.all(evs.map((ev, i) => this.asked("save", { format: this.format, name: names[i], ev })));
    for (const file of files.filter(Boolean)) {
      download(file.name, file.bytes, file.media);
      this.toast.show(`Saved ${file.name}`, "good");
    }
  }

  /** Mark the distance in focus as an end of a stack. */
  mark(name, label) {
    const element = button(label, () => {
      const value = this.dials.latest.get("focus_m")?.value;
      if (typeof value !== "number") return;
      this.ends[name] = value;
      element.firstChild.data = `${label}: ${distance(value)}`;
      this.stacks.disabled = !(this.ends.near < this.ends.far);
      this.stacks.title = this.stacks.disabled ? "Mark a near and a far distance first" : "";
    }, { name: `stack-${name}`, title: `Keep the distance in focus as the ${name} end of the stack` });
    return element;
  }

  /** Have a stack of focuses rendered between the marks; a second press ends it. */
  async stack() {
    const runs = this.stacks.firstChild.data !== STACK;
    this.stacks.firstChild.data = runs ? STACK : "End the stack";
    const keys = { near_m: this.ends.near, far_m: this.ends.far, pictures: this.each.isOn(), name: `${this.stem} stack` };
    const file = await this.asked("stack", runs ? {} : { ...keys, format: this.format === "dng" ? "exr" : this.format });
    if (runs) return;
    this.stacks.firstChild.data = STACK;
    if (!file?.bytes) return;
    download(file.name, file.bytes, file.media);
    this.toast.show(`Saved ${file.name}`, "good");
  }

  async yaml() {
    const answer = await this.asked("scene");
    if (!answer) return;
    this.show(answer.yaml);
    download(answer.name ?? `${this.scene}.yaml`, answer.yaml, "text/yaml");
    this.toast.show(`Saved ${answer.name ?? "the scene"}`, "good");
  }

  async command() {
    const answer = await this.asked("command");
    if (!answer) return;
    this.show(answer.text);
    const done = await copied(answer.text, this.text);
    this.toast.show(done ? "The command line is in the clipboard" : "Copy the command line that is selected", "good");
  }

  show(text) {
    this.text.hidden = false;
    this.text.value = text;
  }

  /** An answer, or null after an error, which is shown by whoever shows errors. */
  async asked(type, keys = {}) {
    try {
      return await this.link.ask(type, keys);
    } catch {
      return null;
    }
  }

  panel() {
    this.stacks = button(STACK, () => this.stack(), { name: "stack", title: "Mark a near and a far distance first" });
    this.stacks.disabled = true;
    this.each = toggle("Each picture, too", () => {}, { name: "stack-each" });
    this.each.isOn = () => this.each.getAttribute("aria-pressed") === "true";
    return h("div", { class: "vf-panel" },
      h("h2", {}, "Picture"), this.formats,
      h("div", { class: "vf-row" }, button("Save the picture", () => this.picture(), { key: "Ctrl+S", name: "save" })),
      choice("Bracket", BRACKETS, (value) => { this.bracket = value; }, { value: "1x0", name: "bracket" }),
      h("p", { class: "vf-note" }, "With the samples that it has now. Warnings and guides are not in the file."),
      h("h2", {}, "Focus stack"),
      h("div", { class: "vf-row" }, this.mark("near", "Near"), this.mark("far", "Far"), this.each),
      h("div", { class: "vf-row" }, this.stacks),
      h("p", { class: "vf-note" }, "One picture that is sharp between the marks, rendered with as many samples as there are now. With each picture it is an archive, a focus bracket."),
      h("h2", {}, "Scene"),
      h("div", { class: "vf-row" },
        button("Save as YAML", () => this.yaml(), { name: "yaml" }), button("Copy the command", () => this.command(), { name: "command" })),
      this.text,
      h("h2", {}, "Back"),
      h("div", { class: "vf-row" },
        button("Camera as in the file", () => this.asked("reset", { what: "camera" }), { name: "reset-camera" }),
        button("All as in the file", () => this.asked("reset", { what: "all" }), { name: "reset" })));
  }
}
