/* The flesh of a skeleton: capsules, which are round cones between two joints, as handpose/flesh/flesh.py has them.

   Where a capsule ends beside its joint j, the offset o_j says how far, along axes that turn with a joint f:
   E_j = X_j + size R_f o_j */

import { PrototxtError } from "./prototxt.js";
import { placeOf } from "./messages.js";
import { indexOf, LENGTHS, LONGEST, MOST, said } from "./skeleton.js";
import { toWorld } from "./kinematics.js";
import { add, times } from "./vectors.js";

export class Flesh {
  /* capsules  {from, to: joints of the whole body, radii: at both, limb: it ends at a joint that only the flesh has}
     offsets   {joint, axes: joints of the whole body, vector} */
  constructor(skeleton, whole) {
    const { flesh } = skeleton.param, joint = (owner, field) => indexOf(whole.joints, owner, field, "joint");
    if (!flesh.capsule.length) throw new PrototxtError(placeOf(flesh), "no capsule and no wedge in the flesh");
    for (const [many, what] of [[flesh.capsule, "capsules"], [flesh.offset, "offsets"]]) {
      if (many.length > MOST) {
        throw new PrototxtError(placeOf(many[MOST]), `${many.length} ${what}; this page shows at most ${MOST}`);
      }
    }
    this.capsules = flesh.capsule.map((c) => {
      const [from, to, radii] = [joint(c, "from"), joint(c, "to"), c.radius];
      if (![1, 2].includes(radii.length) || !radii.every((r) => r > 0 && r <= LONGEST)) {
        const found = `radius ${radii.map(said).join(", ")}`;
        throw new PrototxtError(placeOf(c), `${found}; expected one or two > 0, in ${LENGTHS}`);
      }
      return { from, to, radii: [...radii, ...radii].slice(0, 2), limb: to >= skeleton.joints.length };
    });
    for (const o of flesh.offset) {
      if (![o.x, o.y, o.z].every((length) => Math.abs(length) <= LONGEST)) {
        const found = `offset ${[o.x, o.y, o.z].map(said).join(", ")}`;
        throw new PrototxtError(placeOf(o), `${found}; expected lengths in ${LENGTHS}`);
      }
    }
    this.offsets = flesh.offset.map((o) => (
      { axes: joint(o, "axes"), joint: joint(o, "joint"), vector: [o.x, o.y, o.z] }
    ));
  }

  /* The capsules {a, b, ra, rb, from, to, limb} in a pose of the whole body, in the unit of its bones. */
  posed(pose, size = 1, girth = 1) {
    const ends = [...pose.joints];
    for (const { joint, axes, vector } of this.offsets) {
      ends[joint] = add(ends[joint], times(toWorld(pose, axes, vector), size));
    }
    return this.capsules.map(({ from, to, radii, limb }) => (
      { a: ends[from], b: ends[to], ra: radii[0] * size * girth, rb: radii[1] * size * girth, from, to, limb }
    ));
  }
}
