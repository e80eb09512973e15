/* A skeleton and its surface as tables, built from the JSON values that content.py describes.

   theta[d] = input[d] + initial[d]        (a fixed DoF: theta[d] = initial[d]) */

import { toWorld } from "./kinematics.js";
import { add, times } from "./vectors.js";

export class Skeleton {
  /* joints, dofs             names
     initial, lower, upper    per DoF; limits are of the input, and infinite where there is none
     fixed, turns             per DoF: whether it ignores its input; whether it is an angle instead of a length
     parents                  per joint: the index of its parent, -1 for a root
     order                    the indices of the joints, parents before children
     motions                  per joint: {turns, axis, sign, dof} in the order in which they are applied
     bones, boneAxes          per joint: the signed length; the axis 0, 1, 2, or -1 without a bone */
  constructor({ name, joints, dofs }) {
    this.name = name;
    this.joints = joints.map((joint) => joint.name);
    this.dofs = dofs.map((dof) => dof.name);
    this.initial = dofs.map((dof) => dof.initial);
    this.lower = dofs.map((dof) => dof.lower ?? -Infinity);
    this.upper = dofs.map((dof) => dof.upper ?? Infinity);
    this.fixed = dofs.map((dof) => dof.fixed);
    this.parents = joints.map((joint) => joint.parent ?? -1);
    this.bones = joints.map((joint) => joint.bone?.length ?? 0);
    this.boneAxes = joints.map((joint) => joint.bone?.axis ?? -1);
    this.motions = joints.map((joint) => joint.motions.map(
      ({ kind, axis, sign, dof }) => ({ turns: kind === "rotate", axis, sign, dof }),
    ));
    this.turns = this.dofs.map((_, d) => this.motions.flat().some((motion) => motion.dof === d && motion.turns));
    const depth = (j) => (j < 0 ? 0 : depth(this.parents[j]) + 1);
    this.order = [...joints.keys()].sort((i, j) => depth(i) - depth(j));
  }

  /* The value of every DoF for these inputs. */
  theta(inputs) {
    return this.initial.map((initial, d) => (this.fixed[d] ? initial : inputs[d] + initial));
  }

  /* How far each input is above its upper limit, or, as a negative number, below its lower one; 0 within the limits. */
  beyond(inputs) {
    return this.dofs.map((_, d) => {
      if (this.fixed[d]) return 0;
      return Math.max(inputs[d] - this.upper[d], 0) - Math.max(this.lower[d] - inputs[d], 0);
    });
  }
}

export class Surface {
  /* capsules  round cones {from, to, radii} between two joints of the whole body
     offsets   {joint, axes, vector}: capsules end at X_joint + size R_axes vector instead of X_joint. The edges of
               wedges are capsules; the facets between them are not drawn. */
  constructor({ capsules, offsets }) {
    Object.assign(this, { capsules, offsets });
  }

  /* The capsules {a, b, ra, rb, from, to} in a pose of the whole body, in the unit of its bones. */
  posed(pose, size = 1, thickness = 1) {
    const ends = [...pose.joints], scale = size * thickness;
    for (const { joint, axes, vector } of this.offsets) {
      ends[joint] = add(ends[joint], times(toWorld(pose, axes, vector), size));
    }
    return this.capsules.map(({ from, to, radii }) => (
      { a: ends[from], b: ends[to], ra: radii[0] * scale, rb: radii[1] * scale, from, to }
    ));
  }
}
