/* A slider and a number for every degree of freedom, in groups by the first part of its name; a bar for its torque. */

import { element, shown } from "./elements.js";
import { MAX_INPUT } from "./pose_text.js";

const DEGREES = 180 / Math.PI;
const BEYOND = 0.15; // of the range between the limits, that a slider goes on beyond them
const OPEN_TURN = Math.PI, OPEN_LENGTH = 1.5; // how far a slider without limits goes

export class Sliders {
  constructor(box, body) {
    Object.assign(this, { box, body, withFixed: false, rows: [] });
    body.listeners.push((what) => (what === "skeleton" ? this.build() : this.update()));
    this.build();
  }

  showFixed(shownToo) {
    this.withFixed = shownToo;
    this.build();
  }

  build() {
    const { whole } = this.body, groups = new Map();
    whole.dofs.forEach((name, d) => {
      const [group] = name.split("_");
      if (!whole.fixed[d] || this.withFixed) groups.set(group, [...(groups.get(group) ?? []), d]);
    });
    this.rows = [];
    const closed = new Set([...this.box.querySelectorAll("details:not([open])")].map((group) => group.dataset.name));
    this.box.replaceChildren(...[...groups].map(([group, dofs]) => {
      const own = dofs.every((d) => d >= this.body.skeleton.dofs.length) ? " (of the surface)" : "";
      const rows = dofs.map((d) => this.row(d, group));
      const summary = element("summary", {}, group + own);
      return element("details", { open: !closed.has(group), "data-name": group }, summary, ...rows);
    }));
    this.update();
  }

  /* Units of the page for one of a DoF: degrees, or mm. */
  scale(d) {
    return this.body.whole.turns[d] ? DEGREES : this.body.unit;
  }

  row(d, group) {
    const { whole } = this.body, name = whole.dofs[d], id = `dof-${d}`;
    const turns = whole.turns[d], unit = turns ? "°" : "mm";
    const text = name.slice(group.length + 1).replaceAll("_", " ") || name;
    const label = element("label", { for: id, title: name }, text);
    if (whole.fixed[d]) {
      const value = `${shown(whole.initial[d] * this.scale(d), 1)} ${unit}, fixed`;
      return element("div", { class: "dof fixed" }, label, element("output", { id }, value));
    }
    const [low, high] = whole.limits(d), limited = low > -Infinity && high < Infinity;
    const open = turns ? OPEN_TURN : OPEN_LENGTH, more = limited ? BEYOND * (high - low) : 0;
    const from = (low > -Infinity ? low : -open) - more, to = (high < Infinity ? high : open) + more;
    const scale = this.scale(d), change = (event) => {
      const value = Number(event.target.value);
      if (event.target.value !== "" && Math.abs(value) <= MAX_INPUT * scale) this.body.move({ [d]: value / scale });
    };
    const slider = element("input", {
      id, type: "range", min: from * scale, max: to * scale, step: "any", oninput: change, "data-dof": name,
    });
    slider.style.setProperty("--low", `${low > -Infinity ? (100 * (low - from)) / (to - from) : 0}%`);
    slider.style.setProperty("--high", `${high < Infinity ? (100 * (high - from)) / (to - from) : 100}%`);
    const number = element("input", {
      type: "number", step: "any", onchange: change, "aria-label": `${name}, in ${turns ? "degrees" : "mm"}`,
    });
    const bar = element("span", { class: "bar" }, element("i"));
    const torque = element("output", { class: "torque", for: id });
    this.rows.push({ d, slider, number, bar, torque, unit });
    const free = low === -Infinity && high === Infinity;
    const between = free ? "free" : `${shown(low * scale, 0)} to ${shown(high * scale, 0)}`;
    const limits = element("span", { class: "limits" }, between);
    const unitText = element("span", { class: "unit" }, unit);
    return element("div", { class: "dof" }, label, slider, number, unitText, limits, bar, torque);
  }

  update() {
    const { body } = this, { whole, inputs, torques } = body, beyond = whole.beyond(inputs);
    const most = (turns) => Math.max(...torques.map((torque, d) => (whole.turns[d] === turns ? Math.abs(torque) : 0)));
    const largest = new Map([true, false].map((turns) => [turns, most(turns)]));
    this.box.classList.toggle("pushed", torques.some((torque) => torque !== 0));
    for (const { d, slider, number, bar, torque, unit } of this.rows) {
      const value = inputs[d] * this.scale(d), turns = whole.turns[d], [low, high] = whole.limits(d);
      slider.value = value;
      if (document.activeElement !== number) number.value = shown(value, 1);
      const out = beyond[d] !== 0, row = slider.parentElement, scale = largest.get(turns);
      row.classList.toggle("beyond", out);
      const limits = [low, high].map((limit) => shown(limit * this.scale(d), 1)).join(" to ");
      const natural = turns ? `input ${inputs[d].toFixed(4)} rad, ` : `input ${inputs[d].toFixed(4)} units, `;
      const past = out ? `; ${shown(Math.abs(beyond[d]) * this.scale(d), 1)} ${unit} beyond its limit` : "";
      row.title = `${natural}value ${whole.theta(inputs)[d].toFixed(4)}; limits ${limits} ${unit}${past}`;
      slider.setAttribute("aria-valuetext", `${shown(value, 1)} ${turns ? "degrees" : "mm"}${past}`);
      const part = scale ? torques[d] / scale : 0, strong = Math.abs(part) > 1e-9;
      bar.firstChild.style.setProperty("--part", part);
      bar.classList.toggle("negative", part < 0);
      const size = shown(torques[d], Math.abs(torques[d]) < 100 ? 1 : 0);
      torque.textContent = strong ? `${size} ${turns ? "N mm" : "N"}` : "";
    }
  }
}
