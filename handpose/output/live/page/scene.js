/* All hands of a frame as one body, in the form that body_view.js draws. */

import { unproject } from "./render.js";
import { boundingSphere } from "./vectors.js";

const MIN_RADIUS = 130; // mm, of the bounds of the hands
const EMPTY_DISTANCE = 600; // mm, depth of the centre of the view without a hand
const GUESS_MM = 30; // a finger with a larger expected error is drawn as a guess
const MAX_POINTS = 100; // depth points of a hand along each axis

export class Scene {
  /* camera    of the frames
     skeleton  of one hand, as assembly.py describes it */
  constructor({ camera, skeleton: { own: { joints, parents }, whole, capsules } }) {
    Object.assign(this, { camera, parents, listeners: [], forces: [], origin: [0, 0, 0], unit: 1e3 });
    Object.assign(this, { names: joints, whole, ends: capsules });
    this.handTips = [...joints.keys()].filter((j) => !parents.includes(j));
    this.show({ record: { hands: [] }, surfaces: [] });
  }

  /* Show the hands of a frame. Returns whether there are any. */
  show({ record, surfaces, depth, grid }) {
    const { names } = this, hands = record.hands.filter((hand) => hand.positions_mm);
    this.joints = hands.flatMap((hand) => hand.positions_mm);
    this.skeleton = { joints: hands.flatMap(() => names) };
    this.tips = hands.flatMap((_, h) => this.handTips.map((j) => j + h * names.length));
    const errors = hands.flatMap((hand) => names.map((name) => hand.finger_error_mm[name.split("_")[0]]));
    this.guesses = new Set([...errors.keys()].filter((j) => errors[j] > GUESS_MM));
    this.capsules = surfaces.flatMap((own) => own.map((capsule, i) => {
      const { from, to } = this.ends[i];
      return { ...capsule, from, to };
    }));
    this.points = hands.flatMap((hand) => this.pointsOf(hand, depth, grid));
    for (const listener of this.listeners) listener("pose");
    return hands.length > 0;
  }

  boneStart(joint) {
    const count = this.names.length, parent = this.parents[joint % count];
    return parent < 0 ? null : this.joints[joint - (joint % count) + parent];
  }

  /* The centre and the radius in mm of a sphere around all joints. */
  get bounds() {
    if (!this.joints.length) return { center: [0, 0, EMPTY_DISTANCE], radius: MIN_RADIUS };
    return boundingSphere(this.joints, MIN_RADIUS);
  }

  /* The depth in a hand's cube as points: x, y, z in mm, one after the other. */
  pointsOf({ crop: { center_uvd: [u, v, d], cube_mm: cube } }, depth, grid) {
    const { camera } = this, { step, columns, rows } = grid;
    const [left, right] = sampleRange(u - grid.left, (camera.fx * cube) / 2 / d, step, columns);
    const [top, bottom] = sampleRange(v - grid.top, (camera.fy * cube) / 2 / d, step, rows), points = [];
    const stride = Math.max(1, Math.ceil(Math.max(right - left, bottom - top) / MAX_POINTS));
    for (let row = top; row < bottom; row += stride) {
      for (let column = left; column < right; column += stride) {
        const mm = depth[row * columns + column];
        if (!mm || Math.abs(mm - d) >= cube / 2) continue;
        points.push(...unproject(camera, [grid.left + column * step, grid.top + row * step, mm]));
      }
    }
    return points;
  }
}

/* The first sample and the end of the samples within `reach` px of a pixel; samples are `step` px apart. */
const sampleRange = (pixel, reach, step, count) => [pixel - reach, pixel + reach].map((edge) => (
  Math.min(Math.max(Math.round(edge / step), 0), count)
));
