/* A path that was computed for each rate and momentum, its loss, and the roots that say how it goes. */

import { byId, element } from "./elements.js";
import { shape, short } from "./common.js";

const data = JSON.parse(byId("data").textContent);
const [a, b] = data.steep, COUNT = data.paths[0][0][0].length - 1;
const PRESETS = [
  ["plain, r = 0.2", 0.2, 0], ["too fast, r = 0.225", 0.225, 0], ["best: r = 0.25, m = 0.25", 0.25, 0.25],
  ["heavy: r = 0.1, m = 0.9", 0.1, 0.9],
];
const sliders = Object.fromEntries(["rate", "momentum", "steps"].map((name) => [name, byId(name)]));
const loss = (x, y) => (a * x * x + b * y * y) / 2;

/* ---------------------------------------------------------------------------------------------- the three pictures */

const VALLEY = { width: 600, height: 270, left: -11.5, right: 11.5 }; // as many px to a unit along x and y
const scale = VALLEY.width / (VALLEY.right - VALLEY.left);
const place = (x, y) => [(x - VALLEY.left) * scale, VALLEY.height / 2 - y * scale];

const path = shape("polyline", { class: "line" }), dots = shape("g", { class: "dots" });
const levels = [1, 4, 10, 20, 35, 55, 80, 120].map((level) => {
  const [cx, cy] = place(0, 0), radius = (steep) => Math.sqrt((2 * level) / steep) * scale;
  return shape("ellipse", { cx, cy, rx: radius(a), ry: radius(b), class: "grid" });
});
const ticks = [-10, -5, 5, 10].map((x) => shape("text", { x: place(x, 0)[0] - 8, y: VALLEY.height - 6, class: "small" },
  short(x)));
const [middleX, middleY] = place(0, 0);
byId("valley").append(shape(
  "svg", { class: "wide", viewBox: `0 0 ${VALLEY.width} ${VALLEY.height}`, role: "img", "aria-label": "The path" },
  ...levels, ...ticks, path, dots,
  shape("path", { class: "axis", d: `M${middleX - 7} ${middleY}h14M${middleX} ${middleY - 7}v14` }),
));

const LOSS = { width: 600, height: 190, left: 70, top: 10, bottom: 30, low: -12, high: 6 };
const across = (step) => LOSS.left + (step / COUNT) * (LOSS.width - LOSS.left - 14);
const down = (value) => {
  const share = (Math.log10(Math.max(value, 1e-300)) - LOSS.low) / (LOSS.high - LOSS.low);
  return LOSS.height - LOSS.bottom - share * (LOSS.height - LOSS.top - LOSS.bottom);
};
const curve = shape("polyline", { class: "line" }), now = shape("circle", { r: 4, class: "dot" });
const rows = [-12, -8, -4, 0, 4].flatMap((power) => [
  shape("path", { class: "grid", d: `M${LOSS.left} ${down(10 ** power)}H${LOSS.width}` }),
  shape("text", { x: 4, y: down(10 ** power) + 4, class: "small" }, power ? `1e${short(power)}` : "1"),
]);
const columns = [0, 10, 20, 30].map((step) => shape("text", {
  x: across(step) + 6 - step / 1.5, y: LOSS.height - 8, class: "small",
}, String(step)));
byId("loss").append(shape(
  "svg", { class: "wide", viewBox: `0 0 ${LOSS.width} ${LOSS.height}`, role: "img", "aria-label": "Loss by step" },
  ...rows, ...columns, curve, now,
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

const size = ([re, im]) => Math.hypot(re, im);

function told(name, steep, [first, second]) {
  const largest = Math.max(size(first), size(second)), left = `|z| = ${short(largest, 3)}`;
  const kind = Math.abs(first[1]) > 1e-6 ? "a complex pair: it oscillates"
    : Math.min(first[0], second[0]) < -1e-6 && largest === Math.abs(Math.min(first[0], second[0]))
      ? "a negative root: it changes sign in every step" : "real roots: it decays without oscillating";
  const verdict = largest > 1 + 1e-9 ? "diverges" : largest > 1 - 1e-9 ? "does not converge" : kind;
  return `${name} (λ = ${steep}): ${left}; ${verdict}`;
}

function update() {
  const [r, m, steps] = [sliders.rate, sliders.momentum, sliders.steps].map((slider) => Number(slider.value));
  const [xs, ys] = data.paths[m][r], [forX, forY] = data.roots[m][r];
  byId("rate-value").textContent = short(data.rates[r], 3);
  byId("momentum-value").textContent = short(data.momenta[m], 2);
  byId("steps-value").textContent = String(steps);
  const shown = xs.slice(0, steps + 1).map((x, n) => place(x, ys[n]).map((px) => clamp(px)));
  path.setAttribute("points", shown.map((at) => at.join()).join(" "));
  dots.replaceChildren(...shown.map(([cx, cy]) => shape("circle", { cx, cy, r: 3, class: "dot" })));
  const losses = xs.map((x, n) => loss(x, ys[n]));
  curve.setAttribute("points", losses.map((value, n) => `${across(n)},${clamp(down(value))}`).join(" "));
  now.setAttribute("cx", across(steps));
  now.setAttribute("cy", clamp(down(losses[steps])));
  byId("loss").previousElementSibling.textContent = `The loss after ${steps} steps: ${scientific(losses[steps])}`;
  marks.replaceChildren(...[["x", forX], ["y", forY]].flatMap(([name, pair]) => pair.map((root) => {
    const [cx, cy] = onPlane(root).map((px) => Math.min(Math.max(px, 6), ROOTS.size - 6));
    return shape("circle", { cx, cy, r: 6, class: `dot ${name}`, "fill-opacity": 0.85 });
  })));
  byId("root-x").textContent = told("x", a, forX);
  byId("root-y").textContent = told("y", b, forY);
  for (const [name, pair] of [["x", forX], ["y", forY]]) {
    byId(`root-${name}`).classList.toggle("bad", Math.max(...pair.map(size)) > 1 + 1e-9);
  }
}

const clamp = (px) => Math.min(Math.max(px, -1e4), 1e4); // of what diverges
const scientific = (value) => (
  (value >= 0.01 && value < 1e4 ? short(value, 2) : value.toExponential(1)).replace("-", "−")
);

for (const [slider, count] of [[sliders.rate, data.rates.length - 1], [sliders.momentum, data.momenta.length - 1],
  [sliders.steps, COUNT]]) {
  slider.max = count;
  slider.addEventListener("input", update);
}
function choose(rate, momentum) {
  sliders.rate.value = data.rates.indexOf(rate);
  sliders.momentum.value = data.momenta.indexOf(momentum);
  update();
}
sliders.steps.value = COUNT;
byId("presets").append(...PRESETS.map(([title, rate, momentum]) => element("button", {
  type: "button", onclick: () => choose(rate, momentum),
}, title)));
choose(0.2, 0);
