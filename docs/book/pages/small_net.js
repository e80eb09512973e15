/* The page on a small net: its graph, a pass through it step by step, and a table in which its numbers are edited. */

import { byId, element, reportHeight } from "./elements.js";
import { pass } from "./passes.js";
import { factor, short, svgElement } from "./common.js";

const data = JSON.parse(byId("data").textContent);
const copy = (value) => JSON.parse(JSON.stringify(value));
let net = copy(data), result = pass(net);
let position = 0; // number of steps that have run, first forward, then backward
const COUNT = data.layers.length, LETTERS = ["w", "b"];
const list = (values) => (values.length === 1 ? short(values[0]) : `[${values.map((v) => short(v)).join(", ")}]`);
const brief = (name) => name.replace("h_relu_0_split_", "h"); // the copies of h are h0, h1 and h2

/* ------------------------------------------------------------------------------------------------ the graph */

const WIDTH = 372, ROW = 88, BOX = [100, 32]; // width of the graph, height of a row, size of a layer's box
const depth = {}, writer = {}, places = [];
data.layers.forEach((layer, n) => {
  depth[n] = Math.max(-1, ...layer.bottom.map((name) => depth[writer[name]])) + 1;
  layer.top.forEach((name) => (writer[name] = n));
});
data.layers.forEach((_, n) => {
  const same = data.layers.map((_, other) => other).filter((other) => depth[other] === depth[n]);
  places.push([(WIDTH * (same.indexOf(n) + 0.5)) / same.length, ROW * depth[n] + 26]);
});
for (const [n, layer] of data.layers.entries()) { // the loss is drawn below its first bottom
  if (layer.type === "EuclideanLoss") places[n][0] = places[writerOf(n, layer.bottom[0])][0];
}

/* The layer that wrote a bottom of layer n: the last writer before it. */
function writerOf(n, name) {
  return data.layers.findLastIndex((layer, before) => before < n && layer.top.includes(name));
}

const boxes = [], labels = [], svg = svgElement("svg", {
  viewBox: `-12 0 ${WIDTH + 12} ${ROW * Math.max(...Object.values(depth)) + 86}`, role: "img", "aria-label": "The net",
});
data.layers.forEach((layer, n) => {
  layer.bottom.forEach((name) => {
    const from = writerOf(n, name), [x0, y0] = places[from], [x1, y1] = places[n];
    const isLong = y1 - y0 > 1.5 * ROW; // the wire of t goes around the layers between its ends
    const path = isLong ? `M${x0 - BOX[0] / 2} ${y0}H-6V${y1}H${x1 - BOX[0] / 2}`
      : `M${x0} ${y0 + BOX[1] / 2}L${x1} ${y1 - BOX[1] / 2}`;
    svg.append(svgElement("path", { class: "wire", d: path }));
  });
});
data.layers.forEach((layer, n) => {
  const [x, y] = places[n], kind = layer.backward ? "box" : "box idle";
  const [width, height] = BOX;
  boxes[n] = svgElement("rect", { class: kind, x: x - width / 2, y: y - height / 2, width, height, rx: 6 });
  const name = layer.type === "Split" ? "split" : layer.name;
  svg.append(
    boxes[n], svgElement("text", { x, y: y - 2, "text-anchor": "middle", class: "name" }, name),
    svgElement("text", { x, y: y + 11, "text-anchor": "middle", class: "small" }, layer.type),
  );
  layer.top.forEach((top, i) => {
    // A label is below the box of the writer; for copies of a Split, above the box of the reader.
    const reader = data.layers.findIndex((other, m) => m > n && other.bottom.includes(top));
    const split = layer.type === "Split", side = top === "t";
    const [lx, ly] = split ? [places[reader][0], places[reader][1] - 34] : side ? [4, y + 20]
      : [Math.min(x + 6, WIDTH - 76), y + 28];
    const anchor = split ? "middle" : "start";
    const attributes = { x: lx, "text-anchor": anchor, "data-blob": `${n}.${i}` };
    const value = svgElement("text", { ...attributes, y: ly, class: "label data" });
    const diff = svgElement("text", { ...attributes, y: ly + 14, class: "label diff" });
    labels.push({ n, i, top, value, diff });
    svg.append(value, diff);
  });
});
byId("graph").append(svg);

/* ------------------------------------------------------------------------------------------------ one step as text */

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

/* The title and the text of the last step. */
function stepText() {
  if (position === 0) return ["Nothing has run yet", "press Step: the layers run in the order of the file."];
  const forward = position <= COUNT, n = forward ? position - 1 : 2 * COUNT - position;
  const step = result.steps[n], { layer } = step;
  const name = layer.type === "Split" ? "split" : layer.name;
  if (forward) return [`Forward, ${name}`, forwards[layer.type](step, layer)];
  const idle = layer.type === "Input" ? "data has no gradient to compute" : layer.name === "mean"
    ? "does not run: no loss depends on it, and dh1 stays 0" : "does not run: nothing in it or before it learns";
  return [`Backward, ${name}`, layer.backward ? backwards[layer.type](step, layer) : idle];
}

/* ------------------------------------------------------------------------------------------------ the display */

/* Show the state after the last step: values after the forward pass of a layer, diffs after its backward pass. */
function update() {
  const [title, words] = stepText();
  byId("step-text").replaceChildren(element("b", {}, `${title}: `), words);
  byId("step").value = position;
  for (const id of ["first", "back"]) byId(id).disabled = position === 0;
  for (const id of ["next", "last"]) byId(id).disabled = position === 2 * COUNT;
  boxes.forEach((box, n) => {
    box.classList.toggle("runs", position <= COUNT && n === position - 1);
    box.classList.toggle("runs-back", position > COUNT && n === 2 * COUNT - position && data.layers[n].backward);
  });
  const ranBackward = (n) => n >= 2 * COUNT - position;
  for (const { n, i, top, value, diff } of labels) {
    const name = brief(top), step = result.steps[n];
    value.textContent = position > n ? `${name} ${list(step.tops[i])}` : "";
    // The diff of a top is known when its reader has run backward, and from the beginning for a loss.
    const reader = data.layers.findIndex((other, m) => m > n && other.bottom.includes(top));
    const isKnown = position > COUNT && (reader < 0 || ranBackward(reader)) && step.topDiffs[i];
    diff.textContent = isKnown ? `d${name} ${list(step.topDiffs[i])}` : "";
  }
  for (const { diff, gradient, layer } of rows) {
    const isKnown = layer !== null && position > COUNT && ranBackward(layer) && data.layers[layer].backward;
    diff.textContent = isKnown ? short(gradient()) : "";
  }
  byId("loss").textContent = `L = ${Object.entries(net.losses).map(([name, weight]) =>
    `${short(weight)} · ${short(result.values[name][0])}`).join(" + ")} = ${short(result.loss, 5)}`;
}

function go(step) {
  position = Math.min(Math.max(step, 0), 2 * COUNT);
  update();
}

/* ------------------------------------------------------------------------------------------------ numbers to edit */

const rows = [];

/* Add a row of the table: the number owner()[key] and its gradient(), computed by `layer`, which is null for inputs. */
function addRow(name, owner, key, layer, gradient) {
  const input = element("input", { type: "number", step: "any", "aria-label": name, "data-name": name });
  const diff = element("td", { class: "diff" });
  input.value = owner()[key];
  input.addEventListener("input", () => {
    const value = Number(input.value);
    if (input.value === "" || !(Math.abs(value) < 1e6)) return;
    owner()[key] = value;
    result = pass(net);
    update();
  });
  rows.push({ diff, gradient, layer, write: () => (input.value = Number(owner()[key].toFixed(6))) });
  byId("numbers").append(element("tr", {}, element("th", { scope: "row" }, name), element("td", {}, input), diff));
}

for (const name of Object.keys(data.inputs)) addRow(name, () => net.inputs[name], 0, null, null);
data.layers.forEach((layer, n) => layer.params.forEach((param, p) => param.forEach((row, o) => {
  const name = `${layer.name} ${LETTERS[p]}`;
  const own = () => net.layers[n].params[p], diff = () => result.steps[n].dparams[p];
  if (!Array.isArray(row)) addRow(`${name}[${o}]`, own, o, n, () => diff()[o]);
  else row.forEach((_, i) => addRow(`${name}[${o}, ${i}]`, () => own()[o], i, n, () => diff()[o][i]));
})));

byId("update").addEventListener("click", () => {
  const rate = Number(byId("rate").value);
  if (!(rate >= 0 && rate < 1e3)) return;
  const changed = (value, diff) => (
    Array.isArray(value) ? value.map((v, i) => changed(v, diff[i])) : value - rate * diff
  );
  result.steps.forEach(({ layer, dparams }) => {
    if (layer.backward) layer.params = layer.params.map((param, p) => changed(param, dparams[p]));
  });
  recompute();
});
byId("reset").addEventListener("click", () => {
  net = copy(data);
  recompute();
});

function recompute() {
  result = pass(net);
  for (const { write } of rows) write();
  update();
}

byId("step").max = 2 * COUNT;
byId("step").addEventListener("input", (event) => go(Number(event.target.value)));
byId("first").addEventListener("click", () => go(0));
byId("back").addEventListener("click", () => go(position - 1));
byId("next").addEventListener("click", () => go(position + 1));
byId("last").addEventListener("click", () => go(2 * COUNT));
go(0);

reportHeight();

globalThis.page = { pass }; // for the console and the tests
