/* The page on convolution and pooling: grids of numbers, in which a selected number is explained by a formula. */

import { byId, element, reportHeight } from "./elements.js";
import { factors, slide } from "./sliding.js";
import { factor, short } from "./common.js";

const data = JSON.parse(byId("data").textContent);
const GRIDS = ["x", "w", "b", "y", "dx", "dw", "db", "dy"], cells = {};
const EDITABLE = ["x", "w", "b", "dy"], LIMIT = 1e4, PAUSE_MS = 700;
const choice = byId("layer");
let layer, result, selected = ["y", 0], timer = 0; // timer: 0 while the page does not play
let backwardCount; // number of outputs whose dy has been passed back; undefined for all of them

const width = () => layer.columns.x;
const copy = (value) => JSON.parse(JSON.stringify(value));

const isPadding = (j) => {
  const { pad, x } = layer, rows = x.length / width(), row = Math.floor(j / width()), column = j % width();
  return row < pad || column < pad || row >= rows - pad || column >= width() - pad;
};

/* "row, column" of an element, counted without the padding. */
function coordinates(name, i) {
  const columns = layer.columns[name.replace("d", "")], pad = name.endsWith("x") ? layer.pad : 0;
  return `${Math.floor(i / columns) - pad}, ${(i % columns) - pad}`;
}
const nameOf = (name, i) => (name.endsWith("b") ? name : `${name}[${coordinates(name, i)}]`);
const valueOf = (name, i) => (name in layer ? layer : result)[name][i];

/* ------------------------------------------------------------------------------------------------ the grids */

function build() {
  layer = copy(data.layers[choice.value]);
  stop();
  result = slide(layer);
  for (const figure of document.querySelectorAll(".kernel")) figure.hidden = !layer.w;
  for (const name of GRIDS) {
    const values = layer[name] ?? result[name] ?? [], columns = layer.columns[name.replace("d", "")] ?? 1;
    cells[name] = values.map((_, i) => element("button", {
      type: "button", tabindex: -1, onmouseenter: () => timer || select(name, i), onfocus: () => select(name, i),
      onclick: () => select(name, i), onkeydown: (event) => moveFocus(event, name, i, columns),
    }));
    byId(name).style.gridTemplateColumns = `repeat(${columns}, max-content)`;
    byId(name).replaceChildren(...cells[name]);
  }
  update();
  for (const name of GRIDS) {
    const first = cells[name].find((cell) => !cell.disabled);
    if (first) first.tabIndex = 0; // Tab stops once in each grid; the arrow keys move within it
  }
  select("y", layer.dy.indexOf(2)); // an output whose dy is not 0
}

/* Write the numbers of all grids. */
function update() {
  result = slide(layer, backwardCount);
  for (const name of GRIDS) {
    cells[name].forEach((cell, i) => {
      const padded = name.endsWith("x") && isPadding(i), value = valueOf(name, i);
      cell.disabled = padded;
      cell.classList.toggle("padding", padded);
      cell.ariaLabel = padded ? "padding, 0" : `${nameOf(name, i)} is ${short(value)}`;
      cell.textContent = padded ? (name === "x" ? "0" : "") : short(value, 2);
    });
  }
}

/* Move the focus with the arrow keys. */
function moveFocus(event, name, i, columns) {
  const step = { ArrowLeft: -1, ArrowRight: 1, ArrowUp: -columns, ArrowDown: columns }[event.key];
  if (!step) return;
  event.preventDefault();
  const wraps = Math.abs(step) === 1 && Math.floor((i + step) / columns) !== Math.floor(i / columns);
  const next = cells[name][i + step];
  if (next && !wraps && !next.disabled) next.focus();
}

/* ------------------------------------------------------------------------------------------------ the selection */

function select(name, i) {
  if (cells[name][i]?.disabled) return;
  selected = [name, i];
  for (const cell of Object.values(cells).flat()) cell.classList.remove("marked", "chosen", "winner");
  for (const cell of cells[name]) cell.tabIndex = -1;
  cells[name][i].tabIndex = 0;
  if (name.endsWith("y")) showOutput(i);
  else if (name.endsWith("x")) showInput(i);
  else if (name.endsWith("w")) showWeight(i);
  else showBias();
  // For y the editor changes dy; for dx, dw and db it changes x, w and b.
  const target = EDITABLE.includes(name) ? name : name === "y" ? "dy" : name.slice(1);
  byId("edited").textContent = `${nameOf(target, i)} =`;
  byId("value").value = layer[target][i];
  byId("value").dataset.grid = target;
}

const mark = (kind, ...list) => list.forEach((cell) => cell?.classList.add(kind));

function showOutput(i) {
  const window = layer.windows[i], given = factors(layer, layer.x, i), { x, w, dy } = layer;
  mark("chosen", cells.y[i], cells.dy[i]);
  window.forEach(([j, weight], n) => {
    mark("marked", cells.x[j], cells.dx[j], cells.w[weight], cells.dw[weight]);
    if (layer.maximum && given[n]) mark("winner", cells.x[j], cells.dx[j]);
  });
  const list = window.map(([j]) => short(x[j])).join(", ");
  const sum = window.map(([j], n) => `${factor(given[n])} · ${factor(x[j])}`).join(" + ");
  const formula = w ? sum + (layer.b[0] ? ` + ${factor(layer.b[0])}` : "") : layer.maximum ? `max(${list})`
    : `(${list.replaceAll(", ", " + ")}) / ${window.length}`;
  const d = short(dy[i]);
  const back = w ? `each x of the window gets its w · ${d}, each w its x · ${d}, and b gets ${d}`
    : layer.maximum ? `the winner alone gets ${d}` : `each of the ${window.length} gets ${d} / ${window.length}`;
  const forward = `${nameOf("y", i)} = ${formula} = ${short(result.y[i])}`;
  showFormula(forward, `Backward, ${nameOf("dy", i)} = ${d}: ${back}.`);
}

/* [output, factor, entry] for each entry [input, element] of a window that `accepts` it. */
function readersOf(accepts) {
  return layer.windows.flatMap((window, i) => window.flatMap((entry, n) => (
    accepts(entry) ? [[i, factors(layer, layer.x, i)[n], entry]] : []
  )));
}

function showInput(j) {
  const readers = readersOf(([input]) => input === j), won = readers.filter(([, given]) => given);
  mark("chosen", cells.x[j], cells.dx[j]);
  for (const [i, given, [, weight]] of readers) {
    mark("marked", cells.y[i], cells.dy[i], cells.w[weight]);
    if (layer.maximum && given) mark("winner", cells.y[i], cells.dy[i]);
  }
  const terms = (layer.w ? readers : won).map(([i, given]) => `${factor(given)} · ${factor(layer.dy[i])}`);
  const read = `${nameOf("x", j)} is read by ${readers.length} output${readers.length === 1 ? "" : "s"}`;
  const places = readers.map(([i]) => nameOf("y", i)).join(", ");
  const largest = layer.maximum && readers.length ? `; it is the winner in ${won.length} of them` : "";
  showGradientFormula("dx", j, terms, `${read}${places && `: ${places}`}${largest}.`);
}

function showWeight(e) {
  const readers = readersOf(([, weight]) => weight === e);
  mark("chosen", cells.w[e], cells.dw[e]);
  for (const [i, , [j]] of readers) mark("marked", cells.x[j], cells.y[i], cells.dy[i]);
  const terms = readers.filter(([i]) => layer.dy[i])
    .map(([i, , [j]]) => `${factor(layer.x[j])} · ${factor(layer.dy[i])}`);
  showGradientFormula("dw", e, terms, "Every output uses this weight, each with another x: dw is the sum of x · dy.");
}

function showBias() {
  mark("chosen", cells.b[0], cells.db[0]);
  mark("marked", ...cells.y, ...cells.dy);
  const terms = layer.dy.filter((d) => d).map(factor);
  showGradientFormula("db", 0, terms, "Every output has the bias once: db is the sum of dy.");
}

function showGradientFormula(name, i, terms, words) {
  const value = short(slide(layer)[name][i]);
  showFormula(`${nameOf(name, i)} = ${terms.length ? `${terms.join(" + ")} = ${value}` : value}`, words);
}

function showFormula(formula, words) {
  byId("formula").replaceChildren(element("b", {}, formula), element("br"), words);
}

/* ------------------------------------------------------------------------------------------------ editing, playing */

function edit(value) {
  if (!(Math.abs(value) <= LIMIT)) return;
  layer[byId("value").dataset.grid][selected[1]] = value;
  stop();
  update();
  const text = byId("value").value;
  select(...selected);
  if (Number(text) === value) byId("value").value = text; // keeps "1." while it is being typed
}

byId("value").addEventListener("input", () => byId("value").value !== "" && edit(Number(byId("value").value)));
for (const [id, step] of [["less", -1], ["more", 1]]) {
  byId(id).addEventListener("click", () => {
    const { grid } = byId("value").dataset;
    edit(layer[grid][selected[1]] + step);
    byId("value").value = layer[grid][selected[1]];
  });
}

function stop() {
  clearInterval(timer);
  timer = 0;
  backwardCount = undefined;
  byId("play").textContent = "▶ Play";
}

/* Show step n: first the outputs one by one, then each dy that is passed back. */
function step(n) {
  const total = layer.windows.length;
  backwardCount = Math.max(0, n + 1 - total);
  if (n >= 2 * total) stop();
  update();
  if (n < 2 * total) select(n < total ? "y" : "dy", n % total);
}

byId("play").addEventListener("click", () => {
  if (timer) {
    stop();
    update();
    return;
  }
  let n = 0;
  step(n);
  byId("play").textContent = "■ Stop";
  timer = setInterval(() => step(++n), PAUSE_MS);
});
byId("reset").addEventListener("click", build);
choice.append(...data.layers.map(({ title }, i) => element("option", { value: i }, title)));
choice.addEventListener("change", build);
build();

reportHeight();

globalThis.page = { slide, step, layer: () => layer }; // for the console and the tests
