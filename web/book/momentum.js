/* A valley and a start to choose, the path of SGD with momentum, its loss, and the roots that say how it goes. */

import { askForHeight } from "./embedding.js";
import { byId, element } from "./elements.js";
import { CHOICES, errors, outlook, roots, size } from "./descent.js";
import { shape, short } from "./common.js";

const data = JSON.parse(byId("data").textContent);
const KAPPAS = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 15, 20, 25, 30, 40, 50, 70, 100, 150, 200, 300, 500, 700, 1000];
const IDS = ["kappa", "rate", "momentum", "steps", "start-x", "start-y"];
const control = Object.fromEntries(IDS.map((id) => [id, byId(id)]));
const state = { kappa: data.kappa, rate: 0, momentum: 0, steps: data.steps, start: [...data.start], choice: "plain" };
const loss = (x, y) => (x * x + state.kappa * y * y) / 2;

/* ---------------------------------------------------------------------------------------------- the three pictures */

const VALLEY = { width: 600, height: 270, left: -11.5, right: 11.5 }; // as many px to a unit along x and y
const scale = VALLEY.width / (VALLEY.right - VALLEY.left);
const place = (x, y) => [(x - VALLEY.left) * scale, VALLEY.height / 2 - y * scale];

const path = shape("polyline", { class: "line" }), dots = shape("g", { class: "dots" }), levels = shape("g", {});
const ticks = [-10, -5, 5, 10].map((x) => shape("text", { x: place(x, 0)[0] - 8, y: VALLEY.height - 6, class: "small" },
  short(x)));
const [middleX, middleY] = place(0, 0);
const valley = shape(
  "svg", { class: "wide", viewBox: `0 0 ${VALLEY.width} ${VALLEY.height}`, role: "img", "aria-label": "The path" },
  levels, ...ticks, path, dots,
  shape("path", { class: "axis", d: `M${middleX - 7} ${middleY}h14M${middleX} ${middleY - 7}v14` }),
);
byId("valley").append(valley);
valley.addEventListener("click", (event) => {
  const box = valley.getBoundingClientRect(), unit = VALLEY.width / box.width / scale;
  const at = [(event.clientX - box.left) * unit + VALLEY.left,
    (VALLEY.height / 2 / scale) - (event.clientY - box.top) * unit];
  state.start = at.map((value) => Number(value.toFixed(1)));
  update();
});

const LOSS = { width: 600, height: 190, left: 70, top: 10, bottom: 30, low: -12, high: 6 };
const across = (step) => LOSS.left + (step / Math.max(state.steps, 1)) * (LOSS.width - LOSS.left - 14);
const down = (value) => {
  const share = (Math.log10(Math.max(value, 1e-300)) - LOSS.low) / (LOSS.high - LOSS.low);
  return LOSS.height - LOSS.bottom - share * (LOSS.height - LOSS.top - LOSS.bottom);
};
const curve = shape("polyline", { class: "line" }), columns = shape("g", {});
const rows = [-12, -8, -4, 0, 4].flatMap((power) => [
  shape("path", { class: "grid", d: `M${LOSS.left} ${down(10 ** power)}H${LOSS.width}` }),
  shape("text", { x: 4, y: down(10 ** power) + 4, class: "small" }, power ? `1e${short(power)}` : "1"),
]);
byId("loss").append(shape(
  "svg", { class: "wide", viewBox: `0 0 ${LOSS.width} ${LOSS.height}`, role: "img", "aria-label": "Loss by step" },
  ...rows, columns, curve,
));

const ROOTS = { size: 300, unit: 88 };
const onPlane = ([re, im]) => [ROOTS.size / 2 + re * ROOTS.unit, ROOTS.size / 2 - im * ROOTS.unit];
const marks = shape("g", {});
const half = ROOTS.size / 2;
byId("roots").append(shape(
  "svg", { viewBox: `0 0 ${ROOTS.size} ${ROOTS.size}`, role: "img", "aria-label": "Roots in the unit circle" },
  shape("path", { class: "axis", d: `M0 ${half}H${ROOTS.size}M${half} 0V${ROOTS.size}` }),
  shape("circle", { cx: half, cy: half, r: ROOTS.unit, class: "grid", "stroke-width": 2 }),
  shape("text", { x: half + ROOTS.unit + 4, y: half - 5, class: "small" }, "1"),
  shape("text", { x: half - ROOTS.unit - 17, y: half - 5, class: "small" }, "−1"), marks,
));

/* ------------------------------------------------------------------------------------------------ what they show */

const clamp = (px) => Math.min(Math.max(px, -1e4), 1e4); // of what diverges
const scientific = (value) => (
  (value >= 0.01 && value < 1e4 ? short(value, 2) : value.toExponential(1)).replace("-", "−")
);
const significant = (value) => String(Number(value.toPrecision(3)));

/* One coordinate in words: the larger root, and by how much the error grows before it shrinks. */
function told(name, curvature, pair) {
  const words = `${name} (λ = ${short(curvature)}): |z| = ${short(size(pair[0]), 3)}; ${outlook(pair)}`;
  const relative = errors(curvature, state.rate, state.momentum, 1, 2000).map(Math.abs), most = Math.max(...relative);
  return size(pair[0]) < 1 && most > 1.005
    ? `${words}. At first it grows, to ${short(most, 2)} times its start in step ${relative.indexOf(most)}` : words;
}

function update() {
  if (state.choice) [state.rate, state.momentum] = CHOICES[state.choice].of(state.kappa);
  const { kappa, rate, momentum, steps, start } = state;
  control.kappa.value = KAPPAS.indexOf(kappa);
  control.rate.value = rate * kappa;
  control.momentum.value = momentum;
  control.steps.value = steps;
  [control["start-x"].value, control["start-y"].value] = start;
  byId("kappa-value").textContent = short(kappa);
  byId("rate-value").textContent = significant(rate);
  byId("momentum-value").textContent = short(momentum, 3);
  byId("steps-value").textContent = String(steps);
  byId("limit").textContent = `With m = ${short(momentum, 3)} a path converges for r < 2 (1 + m) / κ = ${
    significant((2 * (1 + momentum)) / kappa)}.`;
  for (const button of byId("choices").children) button.setAttribute("aria-pressed", button.value === state.choice);

  const [cx, cy] = place(0, 0), radius = (level, steep) => Math.sqrt((2 * level) / steep) * scale;
  levels.replaceChildren(...[1, 4, 10, 20, 35, 55, 80, 120].map((level) => shape("ellipse", {
    cx, cy, rx: radius(level, 1), ry: radius(level, kappa), class: "grid",
  })));
  const xs = errors(1, rate, momentum, start[0], steps), ys = errors(kappa, rate, momentum, start[1], steps);
  const shown = xs.map((x, n) => place(x, ys[n]).map(clamp));
  path.setAttribute("points", shown.map((at) => at.join()).join(" "));
  dots.replaceChildren(...shown.map(([x, y]) => shape("circle", { cx: x, cy: y, r: 3, class: "dot" })));
  const losses = xs.map((x, n) => loss(x, ys[n]));
  curve.setAttribute("points", losses.map((value, n) => `${across(n)},${clamp(down(value))}`).join(" "));
  columns.replaceChildren(...[0, 1, 2, 3].map((part) => Math.round((part * steps) / 3)).map((step, part) => shape(
    "text", { x: across(step), y: LOSS.height - 8, class: "small", "text-anchor": part < 3 ? "middle" : "end" },
    String(step),
  )));
  byId("loss").previousElementSibling.textContent = `The loss after ${steps} steps: ${scientific(losses[steps])}`;

  const pairs = [["x", 1, roots(1, rate, momentum)], ["y", kappa, roots(kappa, rate, momentum)]];
  marks.replaceChildren(...pairs.flatMap(([name, , pair]) => pair.map((root) => {
    const [x, y] = onPlane(root).map((px) => Math.min(Math.max(px, 6), ROOTS.size - 6));
    return shape("circle", { cx: x, cy: y, r: 6, class: `dot ${name}`, "fill-opacity": 0.85 });
  })));
  for (const [name, curvature, pair] of pairs) {
    byId(`root-${name}`).textContent = told(name, curvature, pair);
    byId(`root-${name}`).classList.toggle("bad", outlook(pair) === "diverges");
  }
}

/* ------------------------------------------------------------------------------------------------ the controls */

function listen(id, take) {
  control[id].addEventListener("input", () => {
    const value = Number(control[id].value);
    if (control[id].value === "" || !Number.isFinite(value)) return;
    take(value);
    update();
  });
}
control.kappa.max = KAPPAS.length - 1;
listen("kappa", (value) => (state.kappa = KAPPAS[value]));
listen("rate", (value) => Object.assign(state, { rate: value / state.kappa, choice: "" }));
listen("momentum", (value) => Object.assign(state, { momentum: value, choice: "" }));
listen("steps", (value) => (state.steps = value));
listen("start-x", (value) => (state.start[0] = value));
listen("start-y", (value) => (state.start[1] = value));
byId("choices").append(...Object.entries(CHOICES).map(([value, { title }]) => element("button", {
  type: "button", value, onclick: () => {
    state.choice = value;
    update();
  },
}, title)));
update();

askForHeight();

// For the console, and for tests.
globalThis.page = { errors, roots, state };
