/* A skeleton file as a table, as layers/hand/skeleton.py has it.

   theta[d] = input[d] + initial[d]        (a fixed DoF: theta[d] = initial[d]) */

import { parse, PrototxtError } from "./prototxt.js";
import { placeOf, read } from "./messages.js";

const FAR = 1000; // a limit that is farther away is none
export const MAX_LENGTH = 10;
export const LENGTHS = `half-cubes, at most ${MAX_LENGTH}` +
  " (half the edge of the cube around the body: of 300 mm, 1 is 150 mm)";
export const MAX_EACH = 1000; // joints, and DoFs, because of the number of sliders

export class Skeleton {
  /* dofs, joints             names in file order
     initial, lower, upper    per DoF; limits are of the input
     fixed, turns             per DoF: it ignores its input; it turns something (else it is a length)
     parents                  per joint, -1 for a root
     order                    the joints, parents first
     motions                  per joint {turns, axis, sign, dof} in the order in which they are applied
     bones, boneAxes          per joint: signed length, and the axis 0, 1, 2; -1 without a bone */
  constructor(param) {
    this.param = param;
    this.name = param.name;
    if (!param.joint.length) throw new PrototxtError(placeOf(param), "this file has no joints; expected a skeleton");
    for (const [many, what] of [[param.joint, "joints"], [param.dof, "DoFs"]]) {
      if (many.length > MAX_EACH) {
        throw new PrototxtError(placeOf(many[MAX_EACH]), `${many.length} ${what}; this page shows at most ${MAX_EACH}`);
      }
    }
    this.dofs = unique(param.dof, "DoF");
    this.joints = unique(param.joint, "joint");
    this.checkNumbers();
    for (const name of ["initial", "lower", "upper", "fixed"]) this[name] = param.dof.map((dof) => dof[name]);
    this.parents = param.joint.map((j) => (j.parent === null ? -1 : indexOf(this.joints, j, "parent")));
    this.bones = param.joint.map((j) => (j.bone ? signed(j.bone.axis).sign * j.bone.length : 0));
    this.boneAxes = param.joint.map((j) => (j.bone ? signed(j.bone.axis).axis : -1));
    this.order = this.parentsFirst();
    const motion = (turns) => (m) => ({ turns, ...signed(m.axis), dof: indexOf(this.dofs, m, "dof") });
    this.motions = param.joint.map((j) => [...j.translate.map(motion(false)), ...j.rotate.map(motion(true))]);
    this.turns = this.dofs.map(() => false);
    for (const own of this.motions) for (const m of own) this.turns[m.dof] ||= m.turns;
  }

  /* The value of every DoF. */
  theta(inputs) {
    return this.initial.map((initial, d) => (this.fixed[d] ? initial : inputs[d] + initial));
  }

  /* The limits of an input, -Infinity or Infinity where it has none. */
  limits(d) {
    return [this.lower[d] < -FAR ? -Infinity : this.lower[d], this.upper[d] > FAR ? Infinity : this.upper[d]];
  }

  /* How far each input is beyond its limits: above the upper one, or, negative, below the lower one. */
  beyond(inputs) {
    return this.dofs.map((_, d) => {
      if (this.fixed[d]) return 0;
      return Math.max(inputs[d] - this.upper[d], 0) - Math.max(this.lower[d] - inputs[d], 0);
    });
  }

  /* The body with the joints and DoFs of its surface alone, after its own. */
  withSurface() {
    const { param } = this, { flesh } = param;
    if (!flesh) return this;
    const whole = { ...param, dof: [...param.dof, ...flesh.dof], joint: [...param.joint, ...flesh.joint] };
    Object.defineProperty(whole, "tree", { value: param.tree });
    return new Skeleton(whole);
  }

  checkNumbers() {
    for (const { bone } of this.param.joint) {
      if (bone && !(Math.abs(bone.length) <= MAX_LENGTH)) {
        throw new PrototxtError(placeOf(bone), `a bone of length ${formatNumber(bone.length)}; expected ${LENGTHS}`);
      }
    }
    for (const dof of this.param.dof) {
      if (!Number.isFinite(dof.initial)) {
        throw new PrototxtError(placeOf(dof), `${formatNumber(dof.initial)} is not a length or an angle`);
      }
      if (dof.lower > dof.upper) {
        const limits = `lower limit ${formatNumber(dof.lower)} is above ${formatNumber(dof.upper)}`;
        throw new PrototxtError(placeOf(dof), `DoF '${dof.name}': ${limits}`);
      }
    }
  }

  parentsFirst() {
    const depth = new Map([[-1, 0]]);
    for (const joint of this.parents.keys()) {
      const way = []; // up from the joint, as far as depths are not known
      for (let at = joint; !depth.has(at); at = this.parents[at]) {
        if (way.includes(at)) {
          const stuck = this.param.joint[at];
          throw new PrototxtError(placeOf(stuck), `joint '${stuck.name}' is its own ancestor`);
        }
        way.push(at);
      }
      for (const at of way.reverse()) depth.set(at, depth.get(this.parents[at]) + 1);
    }
    return [...this.parents.keys()].sort((i, j) => depth.get(i) - depth.get(j));
  }
}

/* The skeleton of a file's text. Throws PrototxtError. */
export function skeletonOf(text, source) {
  return new Skeleton(read(parse(text, source), "skeleton", `skeleton ${source}`));
}

/* The index of the name that a field of `owner` says, among `names`. */
export function indexOf(names, owner, field, what = field) {
  const index = names.indexOf(owner[field]);
  if (index < 0) throw new PrototxtError(placeOf(owner, field), `unknown ${what} '${owner[field]}'`);
  return index;
}

/* A number as a skeleton file says it. */
export const formatNumber = (number) => String(number).replace("Infinity", "inf").replace("NaN", "nan");

function unique(params, what) {
  const seen = new Set();
  for (const param of params) {
    if (seen.has(param.name)) throw new PrototxtError(placeOf(param), `${what} '${param.name}' is defined twice`);
    seen.add(param.name);
  }
  return [...seen];
}

function signed(axis) {
  return { axis: "XYZ".indexOf(axis.at(-1)), sign: axis.startsWith("NEG_") ? -1 : 1 };
}
