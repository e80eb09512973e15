/* A pose as text: the inputs of HandModel, in order, as a list in JSON, Python and np.array. */

export const MAX_INPUT = 1e6; // larger inputs are rejected
const DIGITS = 9; // significant digits, which keep the joints to 1e-8

/* The inputs of the skeleton; those of fixed DoFs are 0. */
export function textOfPose({ skeleton, inputs }) {
  const numbers = skeleton.dofs.map((_, d) => (skeleton.fixed[d] ? 0 : Number(inputs[d].toPrecision(DIGITS))));
  return `[${numbers.join(", ")}]`;
}

/* The inputs {index: value} in a text, which is a list or the `angles_rad` of the first hand in the JSON of predict or
   track. Throws an Error with one line. */
export function inputsOfText(text, { skeleton }) {
  const angles = /"angles_rad"\s*:\s*(\{[^{}]*\})/.exec(text)?.[1];
  const inputs = angles ? inputsOfAngles(angles, skeleton) : inputsOfList(text, skeleton);
  for (const [d, value] of Object.entries(inputs)) {
    if (Math.abs(value) <= MAX_INPUT) continue; // false for NaN
    throw new Error(`${skeleton.dofs[d]}: found ${value}; expected a number up to ${MAX_INPUT}`);
  }
  return inputs;
}

function inputsOfList(text, skeleton) {
  const inside = /\[([^[\]]*)\]/.exec(text)?.[1] ?? text;
  const words = inside.split(/[\s,]+/).filter(Boolean), count = skeleton.dofs.length;
  const bad = words.find((word) => !Number.isFinite(Number(word)));
  if (bad !== undefined) throw new Error(`'${bad.slice(0, 40)}' is not a number; expected ${count} inputs`);
  if (words.length !== count) {
    throw new Error(`found ${words.length} numbers; skeleton '${skeleton.name}' has ${count} inputs`);
  }
  return Object.fromEntries(words.map((word, d) => [d, skeleton.fixed[d] ? 0 : Number(word)]));
}

function inputsOfAngles(text, skeleton) {
  let angles = null;
  try {
    angles = JSON.parse(text);
  } catch {
    throw new Error("angles_rad is not complete JSON");
  }
  const inputs = {};
  for (const [name, value] of Object.entries(angles)) {
    const d = skeleton.dofs.indexOf(name);
    if (d < 0) {
      const some = skeleton.dofs.slice(0, 3).join(", ");
      throw new Error(`unknown DoF '${name}'; skeleton '${skeleton.name}' has ${some} ...`);
    }
    if (!skeleton.fixed[d]) inputs[d] = value - skeleton.initial[d];
  }
  return inputs;
}
