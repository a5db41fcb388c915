/** Words that come and go: what was refused, what was saved. What stays wrong stays in sight. */

import { h } from "./dom.js";

const SHOWN = 7000; // [ms]
const MOST = 4;

/** What is wrong and where, without the folder and without saying the place twice. */
function parted(text, where) {
  const rest = where && text.startsWith(`${where}: `) ? text.slice(where.length + 2) : text;
  return [rest, where && where.replace(/^.*[\\/]/, "")];
}

export class Toasts {
  constructor() {
    this.element = h("div", { class: "vf-toasts", role: "log", "aria-live": "polite", "aria-label": "Messages" });
    this.fault = h("div", { class: "vf-fault", role: "alert", hidden: true });
  }

  /** Show words for a while. `kind` is "good", "info" or "bad". */
  show(text, kind = "info", where = null) {
    [text, where] = parted(text, where);
    const close = h("button", { type: "button", class: "vf-close", "aria-label": "Close", on: { click: () => toast.remove() } }, "×");
    const toast = h("div", { class: `vf-toast vf-toast-${kind}`, role: kind === "bad" ? "alert" : null },
      h("div", {}, where && h("code", {}, where), h("span", {}, text)), close);
    this.element.append(toast);
    while (this.element.children.length > MOST) this.element.firstChild.remove();
    setTimeout(() => toast.remove(), SHOWN);
  }

  /** Show an error of the scene file until it is mended; null ends it. */
  stay(text, where = null) {
    this.fault.hidden = text === null;
    if (text !== null) [text, where] = parted(text, where);
    this.fault.replaceChildren(...(text === null ? [] : [h("strong", {}, "The scene file has an error; the picture is the last good one."),
      where ? h("code", {}, where) : "", h("span", {}, text)]));
  }

  /** Follow what the server reports. */
  follow(link) {
    link.on("error", ({ message, where, source }) => {
      if (source === "scene") this.stay(message, where);
      else this.show(message, "bad", where);
    });
    link.on("notice", ({ kind, text, ok }) => {
      if (kind === "watch" && ok !== false) this.stay(null);
      if (text) this.show(text, ok === false ? "bad" : "info");
    });
    link.on("bye", ({ text }) => this.show(text || "The server has ended.", "info"));
  }
}
