/* A pose as text, and back: inputs as HandModel reads them, or the DoFs of a skeleton file that begins in this pose.
   Read are also the angles_rad of the first hand in JSON of predict or track. */

import { parse, PrototxtError } from "./prototxt.js";
import { read } from "./messages.js";
import { formatNumber } from "./skeleton.js";

export const MAX_INPUT = 1e6; // of an input; larger ones are outside any picture
const DIGITS = 9; // significant: a joint is where it was to 1e-8

const written = (number) => formatNumber(Number(number.toPrecision(DIGITS)));

/* The inputs of the skeleton, its fixed DoFs 0: a list in JSON, Python and what np.array takes. */
export function asInputs(body) {
  const { skeleton, inputs } = body;
  return `[${skeleton.dofs.map((_, d) => (skeleton.fixed[d] ? "0" : written(inputs[d]))).join(", ")}]`;
}

/* The skeleton's `dof { ... }` with this pose as the initial one, where all inputs are 0; limits move along. */
export function asDofs(body) {
  const { skeleton, inputs } = body, theta = skeleton.theta(inputs);
  return skeleton.param.dof.map((dof, d) => {
    const name = JSON.stringify(dof.name), start = `dof { name: ${name} initial: ${written(theta[d])}`;
    if (dof.fixed) return `${start} fixed: true }`;
    const [lower, upper] = [dof.lower, dof.upper].map((limit) => written(limit - inputs[d]));
    const deviation = Number.isFinite(dof.deviation) ? ` deviation: ${written(dof.deviation)}` : "";
    return `${start} lower: ${lower} upper: ${upper}${deviation} }`;
  }).join("\n");
}

/* The inputs {index: value} that a text says, in any form. Throws an Error with one line. */
export function inputsOf(text, body) {
  const angles = /"angles_rad"\s*:\s*(\{[^{}]*\})/.exec(text)?.[1], isDofs = /\bdof\s*[{<]/.test(text);
  const read = angles ? fromAngles : isDofs ? fromDofs : fromList, inputs = read(angles ?? text, body.skeleton);
  for (const [d, value] of Object.entries(inputs)) {
    if (Math.abs(value) <= MAX_INPUT) continue; // NaN is not
    throw new Error(`${body.skeleton.dofs[d]}: ${formatNumber(value)} is no pose; expected numbers up to ${MAX_INPUT}`);
  }
  return inputs;
}

function fromList(text, skeleton) {
  const inside = /\[([^[\]]*)\]/.exec(text)?.[1] ?? text;
  const words = inside.split(/[\s,]+/).filter(Boolean), count = skeleton.dofs.length;
  const bad = words.find((word) => !Number.isFinite(Number(word)));
  if (bad !== undefined) {
    throw new Error(`'${bad.slice(0, 40)}' is not a number; expected ${count} inputs or dof { ... }`);
  }
  if (words.length !== count) {
    throw new Error(`${words.length} numbers; skeleton '${skeleton.name}' has ${count} inputs`);
  }
  return Object.fromEntries(words.map((word, d) => [d, skeleton.fixed[d] ? 0 : Number(word)]));
}

function fromDofs(text, skeleton) {
  const dofs = read(onlyDofs(parse(text, "pose")), "skeleton", "the pose").dof;
  return byName(dofs.map(({ name, initial }) => [name, initial]), skeleton);
}

function fromAngles(text, skeleton) {
  let angles = null;
  try {
    angles = JSON.parse(text);
  } catch {
    throw new Error("angles_rad is not whole JSON");
  }
  return byName(Object.entries(angles), skeleton);
}

/* The inputs for values of DoFs by name. */
function byName(values, skeleton) {
  const found = {};
  for (const [name, value] of values) {
    const d = skeleton.dofs.indexOf(name);
    if (d < 0) {
      const some = skeleton.dofs.slice(0, 3).join(", ");
      throw new Error(`unknown DoF '${name}'; skeleton '${skeleton.name}' has ${some} ...`);
    }
    if (!skeleton.fixed[d]) found[d] = value - skeleton.initial[d];
  }
  return found;
}

function onlyDofs(tree) {
  const other = tree.fields.find((field) => field.name !== "dof");
  if (other) throw new PrototxtError(other.place, `found '${other.name}'; expected dof { ... } alone`);
  return tree;
}
