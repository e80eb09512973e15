/* A picture, what a layer makes of it, and which input has which share in which output. */

import { byId, element } from "./elements.js";
import { short } from "./common.js";

const data = JSON.parse(byId("data").textContent);
const GRIDS = ["x", "w", "y", "dx", "dy"], cells = {};
const choice = byId("layer");
let layer;

const flat = (rows) => rows.flat();
const width = () => layer.x[0].length;

/* dx with the padding around it, where there is none. */
function padded(rows) {
  const { pad } = layer, empty = Array(pad).fill(null), blank = () => Array(width()).fill(null);
  return [...Array.from({ length: pad }, blank), ...rows.map((row) => [...empty, ...row, ...empty]),
    ...Array.from({ length: pad }, blank)];
}

const isPadding = (j) => {
  const { pad, x } = layer, row = Math.floor(j / width()), column = j % width();
  return row < pad || column < pad || row >= x.length - pad || column >= width() - pad;
};

function build() {
  layer = data.layers[choice.value];
  byId("kernel").hidden = !layer.w;
  const grids = { x: layer.x, w: layer.w ?? [], y: layer.y, dx: padded(layer.dx), dy: layer.dy };
  for (const name of GRIDS) {
    const rows = grids[name], columns = rows[0]?.length ?? 0, ofPicture = name === "x" || name === "dx";
    cells[name] = flat(rows).map((value, i) => {
      const away = ofPicture && isPadding(i), place = `${name}[${where(i, columns, ofPicture)}]`;
      return element("button", {
        type: "button", tabindex: -1, disabled: name === "w" || away, class: away ? "padding" : "",
        "aria-label": away ? "padding, 0" : `${place} is ${short(value)}`,
        onmouseenter: () => choose(name, i), onfocus: () => choose(name, i), onclick: () => choose(name, i),
        onkeydown: (event) => walk(event, name, i, columns),
      }, away ? (name === "x" ? "0" : "") : short(value, 2));
    });
    byId(name).style.gridTemplateColumns = `repeat(${columns}, max-content)`;
    byId(name).replaceChildren(...cells[name]);
    const first = cells[name].find((cell) => !cell.disabled);
    if (first) first.tabIndex = 0; // one stop for Tab, arrow keys within
  }
  choose("y", flat(layer.dy).indexOf(2)); // one that has something to hand back
}

/* "row, column" of an element, counted without the padding. */
function where(i, columns, ofPicture) {
  const pad = ofPicture ? layer.pad : 0;
  return `${Math.floor(i / columns) - pad}, ${(i % columns) - pad}`;
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
  if (name === "w" || cells[name][i]?.disabled) return;
  for (const cell of Object.values(cells).flat()) cell.classList.remove("marked", "chosen", "winner");
  for (const cell of cells[name]) cell.tabIndex = -1;
  cells[name][i].tabIndex = 0;
  if (name === "y" || name === "dy") showOutput(i);
  else showInput(i);
}

function mark(kind, ...list) {
  for (const cell of list) cell?.classList.add(kind);
}

function showOutput(i) {
  const shares = layer.shares[i], { x, y, dy, w } = layer, values = flat(x);
  mark("chosen", cells.y[i], cells.dy[i]);
  for (const [j, share, element] of shares) {
    mark("marked", cells.x[j], cells.dx[j], cells.w[element]);
    if (layer.maximum && share) mark("winner", cells.x[j], cells.dx[j]);
  }
  const place = where(i, y[0].length, false), value = short(flat(y)[i]);
  const list = shares.map(([j]) => short(values[j])).join(", ");
  const sum = shares.map(([j, share]) => `${factor(share)} · ${short(values[j])}`).join(" + ");
  const made = w ? sum : layer.maximum ? `max(${list})` : `(${list.replaceAll(", ", " + ")}) / ${shares.length}`;
  const given = short(flat(dy)[i]);
  const back = w ? `each x of the window gets its w · ${given}` : layer.maximum ? `the winner alone gets ${given}`
    : `each of the ${shares.length} gets ${given} / ${shares.length}`;
  say(`y[${place}] = ${made} = ${value}`, `Backward, dy[${place}] = ${given}: ${back}.`);
}

function showInput(j) {
  const values = flat(layer.dy), out = layer.y[0].length, terms = [], readers = [];
  mark("chosen", cells.x[j], cells.dx[j]);
  layer.shares.forEach((shares, i) => {
    const found = shares.find(([input]) => input === j);
    if (!found) return;
    readers.push(i);
    mark("marked", cells.y[i], cells.dy[i], cells.w[found[2]]);
    if (layer.maximum && found[1]) mark("winner", cells.y[i], cells.dy[i]);
    if (found[1] || layer.w) terms.push(`${factor(found[1])} · ${factor(values[i])}`);
  });
  const place = where(j, width(), true), dx = short(flat(padded(layer.dx))[j]);
  const read = `x[${place}] is read by ${readers.length} output${readers.length === 1 ? "" : "s"}`;
  const places = readers.map((i) => `y[${where(i, out, false)}]`).join(", ");
  const won = layer.maximum && readers.length ? `; it is the largest in ${terms.length} of them` : "";
  const sum = terms.length ? `${terms.join(" + ")} = ${dx}` : dx;
  say(`dx[${place}] = ${sum}`, `${read}${places && `: ${places}`}${won}.`);
}

const factor = (number) => (number < 0 ? `(${short(number)})` : short(number));

function say(formula, words) {
  byId("formula").replaceChildren(element("b", {}, formula), element("br"), words);
}

choice.append(...data.layers.map(({ title }, i) => element("option", { value: i }, title)));
choice.addEventListener("change", build);
build();
