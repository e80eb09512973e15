/* The surface of a skeleton: capsules, which are round cones between two joints, as handpose/body/model.py has them.

   A wedge is drawn as its three edges, which are capsules; the facets between them are left out.
   Where a capsule ends beside its joint j, the offset o_j says how far, along axes that turn with a joint f:
   E_j = X_j + size R_f o_j */

import { PrototxtError } from "./prototxt.js";
import { placeOf } from "./messages.js";
import { indexOf, LENGTHS, MAX_LENGTH, MAX_EACH, formatNumber } from "./skeleton.js";
import { toWorld } from "./kinematics.js";
import { add, times } from "./vectors.js";

export class Surface {
  /* capsules  {from, to: joints of the whole body, radii: at both, limb: it ends at a joint of the surface alone}
     offsets   {joint, axes: joints of the whole body, vector} */
  constructor(skeleton, whole) {
    const { flesh } = skeleton.param, joint = (owner, field) => indexOf(whole.joints, owner, field, "joint");
    if (!flesh.capsule.length && !flesh.wedge.length) {
      throw new PrototxtError(placeOf(flesh), "no capsule and no wedge in the flesh");
    }
    for (const [many, what] of [[flesh.capsule, "capsules"], [flesh.wedge, "wedges"], [flesh.offset, "offsets"]]) {
      if (many.length > MAX_EACH) {
        throw new PrototxtError(placeOf(many[MAX_EACH]), `${many.length} ${what}; this page shows at most ${MAX_EACH}`);
      }
    }
    const own = skeleton.joints.length, capsules = flesh.capsule.map((c) => {
      const [from, to, radii] = [joint(c, "from"), joint(c, "to"), c.radius];
      if (![1, 2].includes(radii.length) || !radii.every((r) => r > 0 && r <= MAX_LENGTH)) {
        const found = `radius ${radii.map(formatNumber).join(", ")}`;
        throw new PrototxtError(placeOf(c), `${found}; expected one or two > 0, in ${LENGTHS}`);
      }
      return { from, to, radii: [...radii, ...radii].slice(0, 2), limb: to >= own };
    });
    this.capsules = [...edges(flesh.wedge, whole.joints, own), ...capsules];
    for (const o of flesh.offset) {
      if (![o.x, o.y, o.z].every((length) => Math.abs(length) <= MAX_LENGTH)) {
        const found = `offset ${[o.x, o.y, o.z].map(formatNumber).join(", ")}`;
        throw new PrototxtError(placeOf(o), `${found}; expected lengths in ${LENGTHS}`);
      }
    }
    this.offsets = flesh.offset.map((o) => (
      { axes: joint(o, "axes"), joint: joint(o, "joint"), vector: [o.x, o.y, o.z] }
    ));
  }

  /* The capsules {a, b, ra, rb, from, to, limb} in a pose of the whole body, in the unit of its bones. */
  posed(pose, size = 1, thickness = 1) {
    const ends = [...pose.joints];
    for (const { joint, axes, vector } of this.offsets) {
      ends[joint] = add(ends[joint], times(toWorld(pose, axes, vector), size));
    }
    return this.capsules.map(({ from, to, radii, limb }) => (
      { a: ends[from], b: ends[to], ra: radii[0] * size * thickness, rb: radii[1] * size * thickness, from, to, limb }
    ));
  }
}

/* The edges of wedges as capsules, each once. */
function edges(wedges, joints, own) {
  const found = new Map();
  for (const w of wedges) {
    const radii = w.radius.length === 1 ? [w.radius[0], w.radius[0], w.radius[0]] : w.radius;
    if (radii.length !== 3 || !radii.every((r) => r > 0 && r <= MAX_LENGTH)) {
      const text = `radius ${w.radius.map(formatNumber).join(", ")}`;
      throw new PrototxtError(placeOf(w), `${text}; expected one or three > 0, in ${LENGTHS}`);
    }
    if (w.joint.length !== 3 || new Set(w.joint).size !== 3) {
      throw new PrototxtError(placeOf(w), `joints ${w.joint.join(", ")}; expected three different ones`);
    }
    const corners = w.joint.map((name) => joints.indexOf(name));
    if (corners.includes(-1)) {
      throw new PrototxtError(placeOf(w), `unknown joint '${w.joint[corners.indexOf(-1)]}'`);
    }
    for (const [i, j] of [[0, 1], [0, 2], [1, 2]]) {
      const ends = [[corners[i], radii[i]], [corners[j], radii[j]]];
      const key = ends.map(String).sort().join(" ");
      const [[from, ra], [to, rb]] = ends;
      if (!found.has(key)) found.set(key, { from, to, radii: [ra, rb], limb: to >= own });
    }
  }
  return [...found.values()];
}
