/* What the page is about: a body in a pose before a camera, with forces on it. Whoever shows some of it listens. */

import { backward, forward } from "./kinematics.js";
import { Flesh } from "./flesh.js";
import { skeletonOf } from "./skeleton.js";
import { unproject } from "./crop.js";
import { add, length, minus, product, times } from "./vectors.js";

export class Body {
  /* skeleton, whole   the tables of the file, and with what only its flesh has
     inputs            of the whole body: radians, and lengths in units; of a left hand those of its mirror image
     size, girth       factors of bones, offsets and radii; of the radii alone
     side              "right", or "left": the mirror image of the skeleton
     unit              mm that a length of 1 stands for
     camera, uvd, cube the camera, and where the crop is, which is where the origin of the inputs is
     forces            per joint of the skeleton a force in N, camera axes
     points            what a camera saw, mm from the crop's middle, 3 numbers each; null without */
  constructor(text, source, place) {
    this.listeners = [];
    this.unit = place.unit_mm;
    this.look({ camera: place.camera, uvd: place.center_uvd, cube: place.cube_mm });
    this.open(text, source);
  }

  /* Take the skeleton of a file's text. Throws PrototxtError, and is as before then. */
  open(text, source) {
    const skeleton = skeletonOf(text, source), whole = skeleton.withFlesh();
    const flesh = skeleton.param.flesh ? new Flesh(skeleton, whole) : null;
    Object.assign(this, { skeleton, whole, flesh, source, side: "right", size: 1, girth: 1, points: null });
    this.inputs = whole.dofs.map(() => 0);
    this.forces = skeleton.joints.map(() => [0, 0, 0]);
    this.changed("skeleton");
  }

  look(place) {
    Object.assign(this, place);
    this.changed("place");
  }

  /* Change some inputs: {index: value}. */
  move(values) {
    for (const [d, value] of Object.entries(values)) this.inputs[d] = value;
    this.changed("pose");
  }

  change(values) {
    Object.assign(this, values);
    this.changed("pose");
  }

  push(joint, force) {
    this.forces[joint] = force;
    this.changed("force");
  }

  release() {
    this.forces = this.forces.map(() => [0, 0, 0]);
    this.changed("force");
  }

  /* Tell every listener what has changed: "skeleton", "place", "pose" or "force". */
  changed(what) {
    this.posed = this.placed = null;
    for (const listener of this.listeners) listener(what);
  }

  get pose() {
    this.posed ??= forward(this.whole, this.inputs, this.size);
    return this.posed;
  }

  /* Of a vector in the body's own axes, that in the camera's, and back. */
  mirrored(vector) {
    return this.side === "left" ? product(vector, [-1, 1, 1]) : vector;
  }

  /* Where the origin of the inputs is, mm, camera axes. */
  get origin() {
    return unproject(this.camera, this.uvd);
  }

  place(point) {
    return add(this.origin, times(this.mirrored(point), this.unit));
  }

  /* All joints in mm, camera axes, the flesh's own after the skeleton's. */
  get joints() {
    this.placed ??= this.pose.joints.map((joint) => this.place(joint));
    return this.placed;
  }

  /* The same of the skeleton's joints in units from the origin: what HandModel answers. */
  get answer() {
    return this.skeleton.joints.map((_, j) => this.mirrored(this.pose.joints[j]));
  }

  /* The flesh in mm, camera axes. */
  get capsules() {
    if (!this.flesh) return [];
    return this.flesh.posed(this.pose, this.size, this.girth).map(({ a, b, ra, rb, ...more }) => (
      { a: this.place(a), b: this.place(b), ra: ra * this.unit, rb: rb * this.unit, ...more }
    ));
  }

  /* What the forces do to each DoF: N mm about the axis of a turn, N along that of a translation. */
  get torques() {
    const own = this.whole.joints.map((_, j) => this.mirrored(this.forces[j] ?? [0, 0, 0]));
    const gradient = backward(this.whole, this.pose, own);
    return gradient.map((torque, d) => (this.whole.turns[d] ? torque * this.unit : torque));
  }

  /* The losses of PhysLimit: the paper's (L1) and the released system's (L2). */
  get limitLoss() {
    const beyond = this.skeleton.beyond(this.inputs);
    return {
      L1: beyond.reduce((sum, v) => sum + Math.abs(v), 0), L2: beyond.reduce((sum, v) => sum + v * v, 0),
    };
  }

  /* The joints that nothing of the skeleton hangs on: fingertips. */
  get tips() {
    const parents = new Set(this.skeleton.parents);
    return [...this.skeleton.joints.keys()].filter((j) => !parents.has(j));
  }

  /* Where the bone of a joint begins, mm: at its parent, of a root where its motions put it; null without a bone. */
  startOf(joint) {
    const parent = this.skeleton.parents[joint];
    if (parent >= 0) return this.joints[parent];
    return this.skeleton.boneAxes[joint] < 0 ? null : this.place(this.pose.starts[joint]);
  }

  /* The middle of all joints, mm, and how far the farthest one is from it. */
  get bounds() {
    const ends = this.skeleton.joints.flatMap((_, j) => [this.joints[j], this.startOf(j)]).filter(Boolean);
    const low = [0, 1, 2].map((i) => Math.min(...ends.map((p) => p[i])));
    const high = [0, 1, 2].map((i) => Math.max(...ends.map((p) => p[i])));
    const middle = times(add(low, high), 0.5);
    const reach = Math.max(...ends.map((p) => length(minus(p, middle))), 1);
    return { middle, reach };
  }
}
