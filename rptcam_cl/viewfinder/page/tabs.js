/** Panels behind tabs, of which one is in sight. */

import { h, newId } from "./dom.js";

export class Tabs {
  /** `panels`: [{name, label, element}]; `shown(name)` is called when another comes into sight. */
  constructor(label, panels, shown) {
    this.shown = shown;
    this.panels = panels.map((panel) => {
      const id = newId("panel");
      const tab = h("button", {
        type: "button", role: "tab", id: `${id}-tab`, "aria-controls": id, "data-tab": panel.name, on: { click: () => this.select(panel.name) },
      }, panel.label);
      const body = h("div", { id, role: "tabpanel", "aria-labelledby": `${id}-tab`, class: "vf-tabpanel", tabindex: 0 }, panel.element);
      return { ...panel, tab, body };
    });
    this.list = h("div", { class: "vf-tabs", role: "tablist", "aria-label": label, on: { keydown: (event) => this.key(event) } }, this.panels.map(({ tab }) => tab));
    this.element = h("div", { class: "vf-tabbed" }, this.list, this.panels.map(({ body }) => body));
    this.select(panels[0].name);
  }

  select(name) {
    this.name = name;
    for (const { name: each, tab, body } of this.panels) {
      tab.setAttribute("aria-selected", String(each === name));
      tab.tabIndex = each === name ? 0 : -1;
      body.hidden = each !== name;
    }
    this.shown(name);
  }

  next(by = 1) {
    const at = this.panels.findIndex(({ name }) => name === this.name);
    this.select(this.panels[(at + by + this.panels.length) % this.panels.length].name);
  }

  key(event) {
    const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (!by) return;
    event.preventDefault();
    event.stopPropagation();
    this.next(by);
    this.panels.find(({ name }) => name === this.name).tab.focus();
  }
}
