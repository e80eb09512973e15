/* All hands of a frame as one body, for what draws bodies (stage.js, bones.js). */

import { unproject } from "./crop.js";
import { add, length, minus, times } from "./vectors.js";

const REACH = 130; // mm, from the middle of what is shown to its edge, at least
const DISTANCE = 600; // mm, of that middle without a hand
const GUESS = 30; // mm, expected error of a finger, above which it is drawn as a guess
const PER_AXIS = 100; // points of a hand's crop along each axis, at most

export class Scene {
  /* camera         of the frames
     capsuleJoints  [from, to] of each capsule, indices of whole.joints */
  constructor({ camera, skeleton, whole, capsules }) {
    const { joints, parents } = skeleton, children = new Set(parents);
    Object.assign(this, { camera, parents, listeners: [], forces: [], origin: [0, 0, 0], unit: 1e3 });
    Object.assign(this, { names: joints, whole: { joints: whole }, capsuleJoints: capsules });
    this.ownTips = [...joints.keys()].filter((j) => !children.has(j));
    this.show({ record: { hands: [] }, surfaces: [] });
  }

  /* Take the hands of a frame; whether there are any. */
  show({ record, surfaces, depth, grid }) {
    const { hands } = record;
    this.hands = hands;
    this.joints = hands.flatMap((hand) => hand.positions_mm);
    this.skeleton = { joints: hands.flatMap(() => this.names) };
    this.tips = hands.flatMap((_, h) => this.ownTips.map((j) => j + h * this.names.length));
    const errors = hands.flatMap((hand) => this.names.map((name) => hand.finger_error_mm[name.split("_")[0]]));
    this.guesses = new Set([...errors.keys()].filter((j) => errors[j] > GUESS));
    this.capsules = surfaces.flatMap((own) => own.map((capsule, i) => {
      const [from, to] = this.capsuleJoints[i];
      return { ...capsule, from, to };
    }));
    this.points = hands.flatMap((hand) => this.pointsOf(hand, depth, grid));
    for (const listener of this.listeners) listener("pose");
    return hands.length > 0;
  }

  startOf(joint) {
    const count = this.names.length, parent = this.parents[joint % count];
    return parent < 0 ? null : this.joints[joint - (joint % count) + parent];
  }

  /* The middle of all joints, mm, and how far the farthest one is from it. */
  get bounds() {
    if (!this.joints.length) return { middle: [0, 0, DISTANCE], reach: REACH };
    const low = [0, 1, 2].map((i) => this.joints.reduce((least, p) => Math.min(least, p[i]), Infinity));
    const high = [0, 1, 2].map((i) => this.joints.reduce((most, p) => Math.max(most, p[i]), -Infinity));
    const middle = times(add(low, high), 0.5);
    const reach = this.joints.reduce((most, p) => Math.max(most, length(minus(p, middle))), REACH);
    return { middle, reach };
  }

  /* The depth of a hand's cube as points: x, y, z in mm one after the other. */
  pointsOf({ crop: { center_uvd: [u, v, d], cube_mm: cube } }, depth, grid) {
    const { camera } = this, { step, columns, rows } = grid;
    const [left, right] = range(u - grid.left, (camera.fx * cube) / 2 / d, step, columns);
    const [top, bottom] = range(v - grid.top, (camera.fy * cube) / 2 / d, step, rows), found = [];
    const skip = Math.max(1, Math.ceil(Math.max(right - left, bottom - top) / PER_AXIS));
    for (let row = top; row < bottom; row += skip) {
      for (let column = left; column < right; column += skip) {
        const mm = depth[row * columns + column];
        if (!mm || Math.abs(mm - d) >= cube / 2) continue;
        found.push(...unproject(camera, [grid.left + column * step, grid.top + row * step, mm]));
      }
    }
    return found;
  }
}

const range = (middle, reach, step, count) => [middle - reach, middle + reach].map((pixel) => (
  Math.min(Math.max(Math.round(pixel / step), 0), count)
));
