/* Forward kinematics of a skeleton, and its gradient by torques, as in layers/hand/kinematics.py.

   From parents to children, each joint j starts at its parent's position p and frame F, and in this order
   translates  p <- p + F e_axis theta, turns  F <- F R_axis(theta), moves  X_j = p + F e_axis length.

   From children to parents, with a force f on every joint:
     force_j  = f_j + sum of force_c                                over the children c of j
     torque_j = sum of (torque_c + (X_c - X_j) x force_c)           about X_j
     dL/dtheta = a . (torque_j + (X_j - P) x force_j)               of a rotation about a through P
     dL/dtheta = a . force_j                                        of a translation along a */

import { add, apply, column, compose, cross, dot, IDENTITY, minus, rotation, times } from "./vectors.js";

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

/* The gradient at the inputs for a gradient at the joints. In other words: for forces on the joints, the torque about
   the axis of each DoF, or the force along it for a translation. It is 0 for a fixed DoF. */
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

/* Convert a vector from the axes of a joint to those of the world. */
export const toWorld = (pose, joint, vector) => apply(pose.frames[joint], vector);
