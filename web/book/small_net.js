/* The net as a graph, a pass through it step by step, and its numbers to be edited. */

import { askForHeight } from "./embedding.js";
import { byId, element } from "./elements.js";
import { pass } from "./passes.js";
import { shape, short } from "./common.js";

const data = JSON.parse(byId("data").textContent);
const copy = (value) => JSON.parse(JSON.stringify(value));
let net = copy(data), made = pass(net), at = 0; // steps that are done: forwards, then backwards
const COUNT = data.layers.length, LETTERS = ["w", "b"];
const list = (values) => (values.length === 1 ? short(values[0]) : `[${values.map((v) => short(v)).join(", ")}]`);
const factor = (number) => (number < 0 ? `(${short(number)})` : short(number));
const brief = (name) => name.replace("h_relu_0_split_", "h"); // copies of h are h0, h1, h2

/* ------------------------------------------------------------------------------------------------ the graph */

const WIDE = 372, TALL = 88, BOX = [100, 32];
const depth = {}, writer = {}, places = [];
data.layers.forEach((layer, n) => {
  depth[n] = Math.max(-1, ...layer.bottom.map((name) => depth[writer[name]])) + 1;
  layer.top.forEach((name) => (writer[name] = n));
});
data.layers.forEach((_, n) => {
  const same = data.layers.map((_, other) => other).filter((other) => depth[other] === depth[n]);
  places.push([(WIDE * (same.indexOf(n) + 0.5)) / same.length, TALL * depth[n] + 26]);
});
for (const [n, layer] of data.layers.entries()) { // a layer below a column of its own stands under what it reads
  if (layer.type === "EuclideanLoss") places[n][0] = places[writerOf(n, layer.bottom[0])][0];
}

/* The layer that wrote a bottom of layer n: the last one before it. */
function writerOf(n, name) {
  return data.layers.findLastIndex((layer, before) => before < n && layer.top.includes(name));
}

const boxes = [], labels = [], svg = shape("svg", {
  viewBox: `-12 0 ${WIDE + 12} ${TALL * Math.max(...Object.values(depth)) + 86}`, role: "img", "aria-label": "The net",
});
data.layers.forEach((layer, n) => {
  layer.bottom.forEach((name) => {
    const from = writerOf(n, name), [x0, y0] = places[from], [x1, y1] = places[n];
    const aside = y1 - y0 > 1.5 * TALL; // t goes around the layers between
    const way = aside ? `M${x0 - BOX[0] / 2} ${y0}H-6V${y1}H${x1 - BOX[0] / 2}`
      : `M${x0} ${y0 + BOX[1] / 2}L${x1} ${y1 - BOX[1] / 2}`;
    svg.append(shape("path", { class: "wire", d: way }));
  });
});
data.layers.forEach((layer, n) => {
  const [x, y] = places[n], kind = layer.backward ? "box" : "box idle";
  boxes[n] = shape("rect", { class: kind, x: x - BOX[0] / 2, y: y - BOX[1] / 2, width: BOX[0], height: BOX[1], rx: 6 });
  const name = layer.type === "Split" ? "split" : layer.name;
  svg.append(
    boxes[n], shape("text", { x, y: y - 2, "text-anchor": "middle", class: "name" }, name),
    shape("text", { x, y: y + 11, "text-anchor": "middle", class: "small" }, layer.type),
  );
  layer.top.forEach((top, i) => {
    // Under the box of its writer; the copies of a Split over the boxes of their readers.
    const reader = data.layers.findIndex((other, m) => m > n && other.bottom.includes(top));
    const split = layer.type === "Split", side = top === "t";
    const [lx, ly] = split ? [places[reader][0], places[reader][1] - 34] : side ? [4, y + 20]
      : [Math.min(x + 6, WIDE - 76), y + 28];
    const anchor = split ? "middle" : "start";
    const attributes = { x: lx, "text-anchor": anchor, "data-blob": `${n}.${i}` };
    const value = shape("text", { ...attributes, y: ly, class: "label data" });
    const diff = shape("text", { ...attributes, y: ly + 14, class: "label diff" });
    labels.push({ n, i, top, value, diff });
    svg.append(value, diff);
  });
});
byId("graph").append(svg);

/* ------------------------------------------------------------------------------------------------ one step in words */

const forwards = {
  Input: ({ tops }, layer) => layer.top.map((name, i) => `${name} = ${list(tops[i])}`).join(", "),
  InnerProduct({ bottoms: [x], tops: [y] }, { params: [w, b], bottom, top }) {
    const rows = w.map((row, o) => {
      const terms = row.map((value, i) => `${factor(value)} · ${factor(x[i])}`);
      return `${[...terms, ...(b ? [factor(b[o])] : [])].join(" + ")} = ${short(y[o])}`;
    });
    return `${brief(top[0])} = ${brief(bottom[0])} wᵀ${b ? " + b" : ""}: ${rows.join("; ")}`;
  },
  ReLU: ({ bottoms: [x], tops: [y] }) => `h = max(h, 0): ${list(x)} becomes ${list(y)}, in the same memory`,
  Split: ({ tops }) => `three readers, three copies: h0 = h1 = h2 = ${list(tops[0])}`,
  Reduction({ bottoms: [x], tops: [y] }, { operation, top }) {
    const terms = x.map((v) => (operation === "MEAN" ? factor(v) : `${factor(v)}²`)).join(" + ");
    return `${top[0]} = ${operation === "MEAN" ? `(${terms}) / ${x.length}` : terms} = ${list(y)}`;
  },
  EuclideanLoss: ({ bottoms: [y, t], tops: [l] }) =>
    `loss = (y − t)² / 2 = (${short(y[0])} − ${factor(t[0])})² / 2 = ${list(l)}`,
};

const backwards = {
  InnerProduct({ topDiffs: [dy], bottomDiffs: [dx], dparams: [dw, db] }, { bottom, top }) {
    const name = brief(bottom[0]), given = `d${brief(top[0])} = ${list(dy)}`;
    const passed = dx ? `; d${name} = dy w = ${list(dx)}` : `; d${name} is not computed, because first is frozen`;
    return `${given}: dw += dyᵀ x = ${list(dw.flat())}${db ? `, db += dy = ${list(db)}` : ""}${passed}`;
  },
  ReLU: ({ topDiffs: [dy], bottomDiffs: [dx] }) => `dh = ${list(dy)} becomes ${list(dx)}: 0 where forward set 0`,
  Split: ({ topDiffs, bottomDiffs: [dx] }) => `dh = dh0 + dh1 + dh2 = ${topDiffs.map(list).join(" + ")} = ${list(dx)}`,
  Reduction: ({ bottoms: [x], topDiffs: [dy], bottomDiffs: [dx] }, { bottom }) =>
    `d${brief(bottom[0])} = 2 h · ${list(dy)} = ${list(dx)}, with the loss weight ${list(dy)}`,
  EuclideanLoss: ({ bottoms: [y, t], topDiffs: [d], bottomDiffs: [dy] }) =>
    `dy = ${list(d)} · (y − t) = ${short(y[0])} − ${factor(t[0])} = ${list(dy)}; t needs no gradient`,
};

function told() {
  if (at === 0) return ["Nothing has run yet", "press Step: the layers run in the order of the file."];
  const forward = at <= COUNT, n = forward ? at - 1 : 2 * COUNT - at, step = made.steps[n], { layer } = step;
  const name = layer.type === "Split" ? "split" : layer.name;
  if (forward) return [`Forward, ${name}`, forwards[layer.type](step, layer)];
  const idle = layer.type === "Input" ? "data has no gradient to compute" : layer.name === "mean"
    ? "does not run: no loss depends on it, and dh1 stays 0" : "does not run: nothing in it or before it learns";
  return [`Backward, ${name}`, layer.backward ? backwards[layer.type](step, layer) : idle];
}

/* ------------------------------------------------------------------------------------------------ what is shown */

function show() {
  const [title, words] = told();
  byId("told").replaceChildren(element("b", {}, `${title}: `), words);
  byId("step").value = at;
  for (const id of ["first", "back"]) byId(id).disabled = at === 0;
  for (const id of ["next", "last"]) byId(id).disabled = at === 2 * COUNT;
  boxes.forEach((box, n) => {
    box.classList.toggle("runs", at <= COUNT && n === at - 1);
    box.classList.toggle("runs-back", at > COUNT && n === 2 * COUNT - at && data.layers[n].backward);
  });
  const done = (n) => n >= 2 * COUNT - at; // the layer has run backwards
  for (const { n, i, top, value, diff } of labels) {
    const name = brief(top), step = made.steps[n];
    value.textContent = at > n ? `${name} ${list(step.tops[i])}` : "";
    // The diff of a top is there when its reader has run, or when it is a loss.
    const reader = data.layers.findIndex((other, m) => m > n && other.bottom.includes(top));
    const there = at > COUNT && (reader < 0 || done(reader)) && step.topDiffs[i];
    diff.textContent = there ? `d${name} ${list(step.topDiffs[i])}` : "";
  }
  for (const { diff, of, layer } of rows) {
    diff.textContent = layer !== null && at > COUNT && done(layer) && data.layers[layer].backward ? short(of()) : "";
  }
  byId("loss").textContent = `L = ${Object.entries(net.losses).map(([name, weight]) =>
    `${short(weight)} · ${short(made.values[name][0])}`).join(" + ")} = ${short(made.loss, 5)}`;
}

function go(step) {
  at = Math.min(Math.max(step, 0), 2 * COUNT);
  show();
}

/* ------------------------------------------------------------------------------------------------ numbers to edit */

const rows = [];

/* A row of the table: an element `of` a list, that `layer` has a gradient of; null for inputs. */
function addRow(name, owner, key, layer, of) {
  const input = element("input", { type: "number", step: "any", "aria-label": name, "data-name": name });
  const diff = element("td", { class: "diff" });
  input.value = owner()[key];
  input.addEventListener("input", () => {
    const value = Number(input.value);
    if (input.value === "" || !(Math.abs(value) < 1e6)) return;
    owner()[key] = value;
    made = pass(net);
    show();
  });
  rows.push({ input, diff, of, layer, write: () => (input.value = Number(owner()[key].toFixed(6))) });
  byId("numbers").append(element("tr", {}, element("th", { scope: "row" }, name), element("td", {}, input), diff));
}

for (const name of Object.keys(data.inputs)) addRow(name, () => net.inputs[name], 0, null, null);
data.layers.forEach((layer, n) => layer.params.forEach((param, p) => param.forEach((row, o) => {
  const name = `${layer.name} ${LETTERS[p]}`;
  const own = () => net.layers[n].params[p], diff = () => made.steps[n].dparams[p];
  if (!Array.isArray(row)) addRow(`${name}[${o}]`, own, o, n, () => diff()[o]);
  else row.forEach((_, i) => addRow(`${name}[${o}, ${i}]`, () => own()[o], i, n, () => diff()[o][i]));
})));

byId("update").addEventListener("click", () => {
  const rate = Number(byId("rate").value);
  if (!(rate >= 0 && rate < 1e3)) return;
  const changed = (value, diff) => (
    Array.isArray(value) ? value.map((v, i) => changed(v, diff[i])) : value - rate * diff
  );
  made.steps.forEach(({ layer, dparams }) => {
    if (layer.backward) layer.params = layer.params.map((param, p) => changed(param, dparams[p]));
  });
  renew();
});
byId("reset").addEventListener("click", () => {
  net = copy(data);
  renew();
});

function renew() {
  made = pass(net);
  for (const { write } of rows) write();
  show();
}

byId("step").max = 2 * COUNT;
byId("step").addEventListener("input", (event) => go(Number(event.target.value)));
byId("first").addEventListener("click", () => go(0));
byId("back").addEventListener("click", () => go(at - 1));
byId("next").addEventListener("click", () => go(at + 1));
byId("last").addEventListener("click", () => go(2 * COUNT));
go(0);

askForHeight();

// For the console, and for tests.
globalThis.page = { net: () => net, pass, go, made: () => made };
