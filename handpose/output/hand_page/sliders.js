/* A slider, a number field and a torque bar for every degree of freedom, grouped by the first part of its name. */

import { element, formatNumber } from "./elements.js";
import { MAX_INPUT } from "./pose_text.js";

const DEGREES = 180 / Math.PI;
const BEYOND = 0.15; // a slider extends beyond both limits by this part of the range between them
const OPEN_ANGLE = Math.PI, OPEN_LENGTH = 1.5; // ends of a slider without limits

export class Sliders {
  constructor(container, body) {
    Object.assign(this, { container, body, withFixed: false, rows: [] });
    body.listeners.push((what) => (what === "skeleton" ? this.build() : this.update()));
    this.build();
  }

  showFixed(withFixed) {
    this.withFixed = withFixed;
    this.build();
  }

  build() {
    const { container, body } = this, { whole, skeleton } = body, groups = new Map();
    whole.dofs.forEach((name, d) => {
      const [group] = name.split("_");
      if (!whole.fixed[d] || this.withFixed) groups.set(group, [...(groups.get(group) ?? []), d]);
    });
    this.rows = [];
    const closed = [...container.querySelectorAll("details:not([open])")].map((details) => details.dataset.name);
    container.replaceChildren(...[...groups].map(([group, dofs]) => {
      const owner = dofs.every((d) => d >= skeleton.dofs.length) ? " (of the surface)" : "";
      const rows = dofs.map((d) => (whole.fixed[d] ? this.fixedRow(d, group) : this.sliderRow(d, group)));
      const summary = element("summary", {}, group + owner);
      return element("details", { open: !closed.includes(group), "data-name": group }, summary, ...rows);
    }));
    this.update();
  }

  /* The factor from a DoF, in rad or half-cubes, to the unit on the page, degrees or mm. */
  scale(d) {
    return this.body.whole.turns[d] ? DEGREES : this.body.unit;
  }

  unit(d) {
    return this.body.whole.turns[d] ? "°" : "mm";
  }

  label(d, group) {
    const name = this.body.whole.dofs[d], text = name.slice(group.length + 1).replaceAll("_", " ") || name;
    return element("label", { for: `dof-${d}`, title: name }, text);
  }

  fixedRow(d, group) {
    const value = `${formatNumber(this.body.whole.initial[d] * this.scale(d), 1)} ${this.unit(d)}, fixed`;
    return element("div", { class: "dof fixed" }, this.label(d, group), element("output", { id: `dof-${d}` }, value));
  }

  sliderRow(d, group) {
    const { whole } = this.body, name = whole.dofs[d], scale = this.scale(d), unit = this.unit(d);
    const low = whole.lower[d], high = whole.upper[d], hasLow = low > -Infinity, hasHigh = high < Infinity;
    const open = whole.turns[d] ? OPEN_ANGLE : OPEN_LENGTH, margin = hasLow && hasHigh ? BEYOND * (high - low) : 0;
    const min = (hasLow ? low : -open) - margin, max = (hasHigh ? high : open) + margin;
    const change = (event) => {
      const value = Number(event.target.value);
      if (event.target.value === "" || !(Math.abs(value) <= MAX_INPUT * scale)) return;
      this.body.setInputs({ [d]: value / scale });
    };
    const slider = element("input", {
      id: `dof-${d}`, type: "range", min: min * scale, max: max * scale, step: "any", oninput: change,
      "data-dof": name,
    });
    const percent = (value) => `${(100 * (value - min)) / (max - min)}%`;
    slider.style.setProperty("--low", hasLow ? percent(low) : "0%");
    slider.style.setProperty("--high", hasHigh ? percent(high) : "100%");
    const number = element("input", {
      type: "number", step: "any", onchange: change, "aria-label": `${name}, in ${unit === "°" ? "degrees" : "mm"}`,
    });
    const bar = element("span", { class: "bar" }, element("i"));
    const torque = element("output", { class: "torque", for: `dof-${d}` });
    const limits = hasLow || hasHigh ? `${formatNumber(low * scale, 0)} to ${formatNumber(high * scale, 0)}` : "free";
    this.rows.push({ d, slider, number, bar, torque, unit });
    return element(
      "div", { class: "dof" }, this.label(d, group), slider, number, element("span", { class: "unit" }, unit),
      element("span", { class: "limits" }, limits), bar, torque,
    );
  }

  update() {
    const { whole, inputs, torques } = this.body, beyond = whole.beyond(inputs);
    const largest = (turns) => Math.max(...torques.map((t, d) => (whole.turns[d] === turns ? Math.abs(t) : 0)));
    const largestTorque = largest(true), largestForce = largest(false);
    this.container.classList.toggle("with-torques", torques.some((torque) => torque !== 0));
    for (const row of this.rows) {
      this.updateValue(row, inputs[row.d], beyond[row.d]);
      this.updateTorque(row, torques[row.d], whole.turns[row.d] ? largestTorque : largestForce);
    }
  }

  updateValue({ d, slider, number, unit }, input, beyond) {
    const { whole, inputs } = this.body, scale = this.scale(d), row = slider.parentElement;
    slider.value = input * scale;
    if (document.activeElement !== number) number.value = formatNumber(input * scale, 1);
    row.classList.toggle("beyond", beyond !== 0);
    const past = beyond ? `; ${formatNumber(Math.abs(beyond) * scale, 1)} ${unit} beyond its limit` : "";
    const limits = [whole.lower[d], whole.upper[d]].map((limit) => formatNumber(limit * scale, 1)).join(" to ");
    const [inputUnit, shownUnit] = unit === "°" ? ["rad", "degrees"] : ["units", "mm"];
    const value = `input ${input.toFixed(4)} ${inputUnit}, value ${whole.theta(inputs)[d].toFixed(4)}`;
    row.title = `${value}; limits ${limits} ${unit}${past}`;
    slider.setAttribute("aria-valuetext", `${formatNumber(input * scale, 1)} ${shownUnit}${past}`);
  }

  updateTorque({ d, bar, torque, unit }, value, largest) {
    const part = largest ? value / largest : 0, text = formatNumber(value, Math.abs(value) < 100 ? 1 : 0);
    bar.firstChild.style.setProperty("--part", part);
    bar.classList.toggle("negative", part < 0);
    torque.textContent = Math.abs(part) > 1e-9 ? `${text} ${unit === "°" ? "N mm" : "N"}` : "";
  }
}
