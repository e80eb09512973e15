/* A picture, what a layer makes of it, and which input has which share in which output. */

import { askForHeight } from "./embedding.js";
import { byId, element } from "./elements.js";
import { factors, slide } from "./sliding.js";
import { short } from "./common.js";

const data = JSON.parse(byId("data").textContent);
const GRIDS = ["x", "w", "b", "y", "dx", "dw", "db", "dy"], cells = {};
const EDITABLE = ["x", "w", "b", "dy"], LIMIT = 1e4, PAUSE_MS = 700;
const choice = byId("layer");
let layer, made, chosen = ["y", 0], playing = 0, count; // outputs whose dy has been handed back; all if not playing

const width = () => layer.columns.x;
const factor = (number) => (number < 0 ? `(${short(number)})` : short(number));
const copy = (value) => JSON.parse(JSON.stringify(value));

const isPadding = (j) => {
  const { pad, x } = layer, rows = x.length / width(), row = Math.floor(j / width()), column = j % width();
  return row < pad || column < pad || row >= rows - pad || column >= width() - pad;
};

/* "row, column" of an element, counted without the padding. */
function where(name, i) {
  const columns = layer.columns[name.replace("d", "")], pad = name.endsWith("x") ? layer.pad : 0;
  return `${Math.floor(i / columns) - pad}, ${(i % columns) - pad}`;
}
const place = (name, i) => (name.endsWith("b") ? name : `${name}[${where(name, i)}]`);
const valueOf = (name, i) => (name in layer ? layer : made)[name][i];

/* ------------------------------------------------------------------------------------------------ the grids */

function build() {
  layer = copy(data.layers[choice.value]);
  stop();
  made = slide(layer);
  for (const figure of document.querySelectorAll(".kernel")) figure.hidden = !layer.w;
  for (const name of GRIDS) {
    const values = layer[name] ?? made[name] ?? [], columns = layer.columns[name.replace("d", "")] ?? 1;
    cells[name] = values.map((_, i) => element("button", {
      type: "button", tabindex: -1, onmouseenter: () => playing || choose(name, i), onfocus: () => choose(name, i),
      onclick: () => choose(name, i), onkeydown: (event) => walk(event, name, i, columns),
    }));
    byId(name).style.gridTemplateColumns = `repeat(${columns}, max-content)`;
    byId(name).replaceChildren(...cells[name]);
  }
  show();
  for (const name of GRIDS) {
    const first = cells[name].find((cell) => !cell.disabled);
    if (first) first.tabIndex = 0; // one stop for Tab, arrow keys within
  }
  choose("y", layer.dy.indexOf(2)); // one that has something to hand back
}

/* The numbers of all grids. */
function show() {
  made = slide(layer, count);
  for (const name of GRIDS) {
    cells[name].forEach((cell, i) => {
      const away = name.endsWith("x") && isPadding(i), value = valueOf(name, i);
      cell.disabled = away;
      cell.classList.toggle("padding", away);
      cell.ariaLabel = away ? "padding, 0" : `${place(name, i)} is ${short(value)}`;
      cell.textContent = away ? (name === "x" ? "0" : "") : short(value, 2);
    });
  }
}

function walk(event, name, i, columns) {
  const step = { ArrowLeft: -1, ArrowRight: 1, ArrowUp: -columns, ArrowDown: columns }[event.key];
  if (!step) return;
  event.preventDefault();
  const wraps = Math.abs(step) === 1 && Math.floor((i + step) / columns) !== Math.floor(i / columns);
  const next = cells[name][i + step];
  if (next && !wraps && !next.disabled) next.focus();
}

/* ------------------------------------------------------------------------------------------------ the choice */

function choose(name, i) {
  if (cells[name][i]?.disabled) return;
  chosen = [name, i];
  for (const cell of Object.values(cells).flat()) cell.classList.remove("marked", "chosen", "winner");
  for (const cell of cells[name]) cell.tabIndex = -1;
  cells[name][i].tabIndex = 0;
  if (name.endsWith("y")) showOutput(i);
  else if (name.endsWith("x")) showInput(i);
  else if (name.endsWith("w")) showWeight(i);
  else showBias();
  const target = EDITABLE.includes(name) ? name : name === "y" ? "dy" : name.slice(1); // what the editor changes
  byId("edited").textContent = `${place(target, i)} =`;
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
  say(`${place("y", i)} = ${formula} = ${short(made.y[i])}`, `Backward, ${place("dy", i)} = ${d}: ${back}.`);
}

/* For each output that reads what `reads([input, element])` accepts: [output, its factor, the input]. */
function readersOf(reads) {
  return layer.windows.flatMap((window, i) => window.flatMap((entry, n) => (
    reads(entry) ? [[i, factors(layer, layer.x, i)[n], entry]] : []
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
  const read = `${place("x", j)} is read by ${readers.length} output${readers.length === 1 ? "" : "s"}`;
  const places = readers.map(([i]) => place("y", i)).join(", ");
  const largest = layer.maximum && readers.length ? `; it is the winner in ${won.length} of them` : "";
  sayGradient("dx", j, terms, `${read}${places && `: ${places}`}${largest}.`);
}

function showWeight(e) {
  const readers = readersOf(([, weight]) => weight === e);
  mark("chosen", cells.w[e], cells.dw[e]);
  for (const [i, , [j]] of readers) mark("marked", cells.x[j], cells.y[i], cells.dy[i]);
  const terms = readers.filter(([i]) => layer.dy[i])
    .map(([i, , [j]]) => `${factor(layer.x[j])} · ${factor(layer.dy[i])}`);
  sayGradient("dw", e, terms, "Every output uses this weight, each with another x: dw is the sum of x · dy.");
}

function showBias() {
  mark("chosen", cells.b[0], cells.db[0]);
  mark("marked", ...cells.y, ...cells.dy);
  sayGradient("db", 0, layer.dy.filter((d) => d).map(factor), "Every output has the bias once: db is the sum of dy.");
}

function sayGradient(name, i, terms, words) {
  const value = short(slide(layer)[name][i]);
  say(`${place(name, i)} = ${terms.length ? `${terms.join(" + ")} = ${value}` : value}`, words);
}

function say(formula, words) {
  byId("formula").replaceChildren(element("b", {}, formula), element("br"), words);
}

/* ------------------------------------------------------------------------------------------------ editing, playing */

function edit(value) {
  if (!(Math.abs(value) <= LIMIT)) return;
  layer[byId("value").dataset.grid][chosen[1]] = value;
  stop();
  show();
  const text = byId("value").value;
  choose(...chosen);
  if (Number(text) === value) byId("value").value = text; // "1." while it is typed
}

byId("value").addEventListener("input", () => byId("value").value !== "" && edit(Number(byId("value").value)));
for (const [id, step] of [["less", -1], ["more", 1]]) {
  byId(id).addEventListener("click", () => {
    const { grid } = byId("value").dataset;
    edit(layer[grid][chosen[1]] + step);
    byId("value").value = layer[grid][chosen[1]];
  });
}

function stop() {
  clearInterval(playing);
  playing = 0;
  count = undefined;
  byId("play").textContent = "▶ Play";
}

/* One step: an output forwards, or the next dy backwards. */
function step(n) {
  const total = layer.windows.length;
  count = Math.max(0, n + 1 - total);
  if (n >= 2 * total) stop();
  show();
  if (n < 2 * total) choose(n < total ? "y" : "dy", n % total);
}

byId("play").addEventListener("click", () => {
  if (playing) {
    stop();
    show();
    return;
  }
  let n = 0;
  step(n);
  byId("play").textContent = "■ Stop";
  playing = setInterval(() => step(++n), PAUSE_MS);
});
byId("reset").addEventListener("click", build);
choice.append(...data.layers.map(({ title }, i) => element("option", { value: i }, title)));
choice.addEventListener("change", build);
build();

askForHeight();

// For the console, and for tests.
globalThis.page = { slide, step, layer: () => layer };
