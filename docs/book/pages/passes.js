/* Forward and backward passes of a net of six layer types, computed as in layers/. Each array is a flat list. The page
   computes the passes itself because the reader can change the numbers. */

const sum = (values) => values.reduce((total, value) => total + value, 0);
const dot = (a, b) => sum(a.map((value, i) => value * b[i]));

/* forward(layer, bottoms, inputs) returns the tops. backward(layer, bottoms, tops, diffs of the tops, dparams) returns
   the diffs of the bottoms and adds to dparams. For a layer in place, the bottoms are the values before it. */
const TYPES = {
  Input: { forward: (layer, bottoms, inputs) => layer.top.map((name) => inputs[name]) },
  InnerProduct: {
    forward: ({ params: [w, b] }, [x]) => [w.map((row, o) => dot(row, x) + (b ? b[o] : 0))],
    backward({ params: [w] }, [x], tops, [dy], [dw, db]) {
      dy.forEach((d, o) => {
        x.forEach((value, i) => (dw[o][i] += d * value));
        if (db) db[o] += d;
      });
      return [x.map((_, i) => sum(dy.map((d, o) => d * w[o][i])))];
    },
  },
  ReLU: {
    forward: (layer, [x]) => [x.map((value) => Math.max(value, 0))],
    backward: (layer, [x], tops, [dy]) => [dy.map((d, i) => (x[i] > 0 ? d : 0))],
  },
  Split: {
    forward: (layer, [x]) => layer.top.map(() => [...x]),
    backward: (layer, [x], tops, diffs) => [x.map((_, i) => sum(diffs.map((diff) => diff[i])))],
  },
  Reduction: {
    forward: ({ operation }, [x]) => [[operation === "MEAN" ? sum(x) / x.length : dot(x, x)]],
    backward: ({ operation }, [x], tops, [[d]]) => [
      x.map((value) => (operation === "MEAN" ? d / x.length : 2 * value * d)),
    ],
  },
  EuclideanLoss: {
    forward: (layer, [x, t]) => [[sum(x.map((value, i) => (value - t[i]) ** 2)) / 2]],
    backward: (layer, [x, t], tops, [[d]]) => [x.map((value, i) => (value - t[i]) * d), null],
  },
};

const zeros = (value) => (Array.isArray(value) ? value.map(zeros) : 0);

/* Run a forward and a backward pass. `steps` has the bottoms, tops, diffs and gradients of parameters of each layer. */
export function pass({ layers, inputs, losses }) {
  const values = {}, diffs = {};
  const steps = layers.map((layer) => {
    const bottoms = layer.bottom.map((name) => values[name]);
    const tops = TYPES[layer.type].forward(layer, bottoms, inputs);
    layer.top.forEach((name, i) => (values[name] = tops[i]));
    const topDiffs = layer.top.map(() => null);
    return { layer, bottoms, tops, dparams: layer.params.map(zeros), topDiffs, bottomDiffs: [] };
  });
  for (const [name, value] of Object.entries(values)) diffs[name] = zeros(value);
  for (const [name, weight] of Object.entries(losses)) diffs[name] = [weight];
  for (const step of [...steps].reverse()) {
    const { layer, bottoms, tops, dparams } = step;
    if (!layer.backward) continue;
    step.topDiffs = layer.top.map((name) => diffs[name]);
    const found = TYPES[layer.type].backward(layer, bottoms, tops, step.topDiffs, dparams);
    step.bottomDiffs = layer.bottom.map((_, i) => (layer.down[i] ? found[i] : null));
    layer.bottom.forEach((name, i) => {
      if (layer.down[i]) diffs[name] = found[i];
    });
  }
  const loss = sum(Object.entries(losses).map(([name, weight]) => weight * values[name][0]));
  return { steps, values, diffs, loss };
}
