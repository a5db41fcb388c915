/** Light and things: what is selected with its dials, and the lamps with mute and solo. */

import { button, h, toggle } from "./dom.js";
import { capital } from "./numbers.js";

const ADDED = {
  lamp: "A soft lamp to the right and above, turned to what is in focus", card: "A white card to the left of what is in focus",
  backdrop: "A grey backdrop behind what is in focus",
};
const HALF = 0.015; // of the picture's width: half the square at what is selected

export class Things {
  constructor(link, stage, dials) {
    Object.assign(this, { link, stage, dials, known: new Map() });
    this.title = h("p", { class: "vf-note", role: "status", "data-name": "selected" });
    this.none = button("Deselect", () => this.select({}), { name: "deselect" });
    this.lamps = h("ul", { class: "vf-lamps", "data-name": "lamps", "aria-label": "Lamps" });
    link.on("state", ({ things }) => things && this.show(things));
  }

  /** Select what is seen at a point of the picture, or a thing by its name. */
  async select(what) {
    try {
      const { name, superseded } = await this.link.ask("select", what.x === undefined ? what : { x: what.x, y: what.y });
      if (what.x === undefined || superseded) return;
      if (!name) this.title.textContent = "Nothing is there.";
      const zone = { x0: what.x - HALF, x1: what.x + HALF, y0: what.y - 1.6 * HALF, y1: what.y + 1.6 * HALF, state: name ? "found" : "failed" };
      this.stage.show({ zones: [zone] });
      clearTimeout(this.fading);
      this.fading = setTimeout(() => this.stage.show({ zones: [] }), 2500);
    } catch { /* the message shows why */ }
  }

  show({ selected, title, lamps }) {
    if (selected !== this.selected || selected) this.title.textContent = selected ? capital(title) : "Nothing is selected: choose Select below the picture (6) and click a thing, or press a lamp's name.";
    this.selected = selected;
    this.none.hidden = !selected;
    const names = lamps.map(({ name }) => name).join("\n");
    if (names !== this.names) this.lamps.replaceChildren(...lamps.map((lamp) => this.row(lamp)));
    this.names = names;
    for (const { name, label, mute, solo, lit } of lamps) {
      const row = this.known.get(name);
      row.name.textContent = capital(label);
      row.name.setAttribute("aria-pressed", String(name === selected));
      row.mute.show(mute);
      row.solo.show(solo);
      row.element.classList.toggle("vf-dark", !lit);
    }
    this.empty.hidden = lamps.length > 0;
  }

  row({ name, label }) {
    const tell = (what) => (on) => this.link.ask("lamp", { name, [what]: on }).catch(() => {}); // the message shows why
    const row = { name: h("button", { type: "button", class: "vf-button vf-lamp-name", "data-lamp": name, on: { click: () => this.select({ name }) } }) };
    for (const what of ["mute", "solo"]) {
      row[what] = toggle(capital(what), tell(what), { name: `${what} ${name}` });
      row[what].setAttribute("aria-label", `${capital(what)} ${label}`);
    }
    row.element = h("li", {}, row.name, row.mute, row.solo);
    this.known.set(name, row);
    return row.element;
  }

  panel() {
    this.empty = h("p", { class: "vf-note", hidden: true }, "Nothing in this scene shines.");
    const add = ["lamp", "card", "backdrop"].map((what) => button(capital(what), () => this.link.ask("add", { what }).catch(() => {}), { name: `add_${what}`, title: ADDED[what] }));
    return h("div", { class: "vf-panel" }, h("h2", {}, "Selected"), this.title, this.dials.things, this.none, h("h2", {}, "Lamps"), this.lamps, this.empty,
      h("h2", {}, "Mix"), this.dials.mix,
      h("p", { class: "vf-note" }, "Lamps that are kept apart are mixed at once, with all samples. Pictures and the command have the mix; the scene keeps the lamps as they are."),
      h("h2", {}, "Add"), h("div", { class: "vf-row", role: "group", "aria-label": "Add to the scene" }, ...add));
  }
}
