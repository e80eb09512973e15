/* A skeleton and its surface as tables, built from the JSON values that assembly.py describes.

   theta[d] = input[d] + initial[d]        (a fixed DoF: theta[d] = initial[d]) */

import { add, apply, column, compose, cross, dot, IDENTITY, minus, rotation, times } from "./vectors.js";

export class Skeleton {
  /* joints, dofs             names
     initial, lower, upper    per DoF; limits are of the input, and infinite where there is none
     fixed, turns             per DoF: whether it ignores its input; whether it is an angle instead of a length
     parents                  per joint: the index of its parent, -1 for a root
     order                    the indices of the joints, parents before children
     motions                  per joint: {turns, axis, sign, dof} in the order in which they are applied
     bones, boneAxes          per joint: the signed length; the axis 0, 1, 2, or -1 without a bone */
  constructor({ bone_axes: boneAxes, lower, upper, ...values }) {
    Object.assign(this, values, { boneAxes });
    this.lower = lower.map((limit) => limit ?? -Infinity);
    this.upper = upper.map((limit) => limit ?? Infinity);
    this.turns = this.dofs.map((_, d) => this.motions.flat().some((motion) => motion.dof === d && motion.turns));
    const depth = (j) => (j < 0 ? 0 : depth(this.parents[j]) + 1);
    this.order = [...this.joints.keys()].sort((i, j) => depth(i) - depth(j));
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
      ends[joint] = add(ends[joint], times(apply(pose.frames[axes], vector), size));
    }
    return this.capsules.map(({ from, to, radii }) => (
      { a: ends[from], b: ends[to], ra: radii[0] * scale, rb: radii[1] * scale, from, to }
    ));
  }
}

/* Forward kinematics of a skeleton, and its gradient by torques, as in layers/hand/kinematics.py.

   From parents to children, each joint j starts at its parent's position p and frame F, and in this order
   translates  p <- p + F e_axis theta, turns  F <- F R_axis(theta), moves  X_j = p + F e_axis length.

   From children to parents, with a force f on every joint:
     force_j  = f_j + sum of force_c                                over the children c of j
     torque_j = sum of (torque_c + (X_c - X_j) x force_c)           about X_j
     dL/dtheta = a . (torque_j + (X_j - P) x force_j)               of a rotation about a through P
     dL/dtheta = a . force_j                                        of a translation along a */

/* The pose for some inputs: per joint its position in `joints`, its frame (world_from_joint) in `frames`, {axis, pivot}
   of each of its motions in `axes`, and the start of its bone in `starts`. `size` is a factor of all bones. */
export function forward(skeleton, inputs, size = 1) {
  const theta = skeleton.theta(inputs), pose = { joints: [], frames: [], axes: [], starts: [] };
  for (const j of skeleton.order) {
    const parent = skeleton.parents[j];
    let p = parent < 0 ? [0, 0, 0] : pose.joints[parent];
    let F = parent < 0 ? IDENTITY : pose.frames[parent];
    pose.axes[j] = skeleton.motions[j].map((motion) => {
      const found = { axis: times(column(F, motion.axis), motion.sign), pivot: p };
      if (motion.turns) F = compose(F, rotation(motion.axis, motion.sign * theta[motion.dof]));
      else p = add(p, times(found.axis, theta[motion.dof]));
      return found;
    });
    const bone = skeleton.boneAxes[j];
    pose.joints[j] = bone < 0 ? p : add(p, times(column(F, bone), skeleton.bones[j] * size));
    pose.starts[j] = p;
    pose.frames[j] = F;
  }
  return pose;
}

/* The gradient at the inputs for a gradient `forces` at the joints: the torque about the axis of each DoF, or the force
   along it for a translation; 0 for a fixed DoF. */
export function backward(skeleton, pose, forces) {
  const force = forces.map((f) => [...f]), torque = forces.map(() => [0, 0, 0]);
  const gradient = skeleton.dofs.map(() => 0), X = pose.joints;
  for (const j of [...skeleton.order].reverse()) {
    skeleton.motions[j].forEach((motion, m) => {
      if (skeleton.fixed[motion.dof]) return;
      const { axis, pivot } = pose.axes[j][m];
      const push = motion.turns ? add(torque[j], cross(minus(X[j], pivot), force[j])) : force[j];
      gradient[motion.dof] += dot(axis, push);
    });
    const parent = skeleton.parents[j];
    if (parent < 0) continue;
    torque[parent] = add(torque[parent], add(torque[j], cross(minus(X[j], X[parent]), force[j])));
    force[parent] = add(force[parent], force[j]);
  }
  return gradient;
}
