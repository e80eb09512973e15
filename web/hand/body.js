/* What the page is about: a body in a pose before a camera, with forces on it. Whoever shows some of it listens. */

import { backward, forward } from "./kinematics.js";
import { Surface } from "./surface.js";
import { skeletonOf } from "./skeleton.js";
import { unproject } from "./crop.js";
import { add, length, minus, product, times } from "./vectors.js";

export class Body {
  /* skeleton, whole   the tables of the file, and with those of its surface alone
     inputs            of the whole body: radians, and lengths in units; of a left hand those of its mirror image
     size, thickness       factors of bones, offsets and radii; of the radii alone
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
    const skeleton = skeletonOf(text, source), whole = skeleton.withSurface();
    const surface = skeleton.param.flesh ? new Surface(skeleton, whole) : null;
    Object.assign(this, { skeleton, whole, surface, source, side: "right", size: 1, thickness: 1, points: null });
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

  /* All joints in mm, camera axes, the surface's own after the skeleton's. */
  get joints() {
    this.placed ??= this.pose.joints.map((joint) => this.place(joint));
    return this.placed;
  }

  /* The same of the skeleton's joints in units from the origin: what HandModel answers. */
  get answer() {
    return this.skeleton.joints.map((_, j) => this.mirrored(this.pose.joints[j]));
  }

  /* The surface in mm, camera axes. */
  get capsules() {
    if (!this.surface) return [];
    return this.surface.posed(this.pose, this.size, this.thickness).map(({ a, b, ra, rb, ...more }) => (
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
  startOf(joint, pose = this.pose) {
    const parent = this.skeleton.parents[joint];
    if (parent >= 0) return this.place(pose.joints[parent]);
    return this.skeleton.boneAxes[joint] < 0 ? null : this.place(pose.starts[joint]);
  }

  /* The bones of the initial pose at the present place, mm: [from, to] each. */
  get initialBones() {
    const pose = forward(this.whole, this.inputs.map((value, d) => (this.isPlace(d) ? value : 0)), this.size);
    const bones = this.skeleton.joints.map((_, j) => [this.startOf(j, pose), this.place(pose.joints[j])]);
    return bones.filter(([from]) => from);
  }

  /* The middle of where the joints can be, mm, and how far the farthest place is from it: the present pose, and poses
     spread over the limits. The place of the whole body (a root without limits for where it is) is the present one. */
  get bounds() {
    const { skeleton, whole, size } = this, ends = skeleton.joints.map((_, j) => this.startOf(j)).filter(Boolean);
    const open = (d) => (whole.turns[d] ? Math.PI : 1), clamp = (value, most) => Math.min(Math.max(value, -most), most);
    const ranges = whole.dofs.map((_, d) => this.isPlace(d) ? null : whole.limits(d).map((at) => clamp(at, open(d))));
    for (const share of spread(POSES, whole.dofs.length)) {
      const inputs = ranges.map((range, d) => range ? range[0] + share[d] * (range[1] - range[0]) : this.inputs[d]);
      ends.push(...forward(whole, inputs, size).joints.slice(0, skeleton.joints.length).map((p) => this.place(p)));
    }
    ends.push(...this.joints.slice(0, skeleton.joints.length));
    const low = [0, 1, 2].map((i) => ends.reduce((least, p) => Math.min(least, p[i]), Infinity));
    const high = [0, 1, 2].map((i) => ends.reduce((most, p) => Math.max(most, p[i]), -Infinity));
    const middle = times(add(low, high), 0.5);
    const reach = ends.reduce((most, p) => Math.max(most, length(minus(p, middle))), 1);
    return { middle, reach };
  }

  /* Whether a DoF moves the body as a whole: it is one of a root that is free to be anywhere. */
  isPlace(d) {
    const { whole } = this, free = ({ turns, dof }) => !turns && !whole.fixed[dof] && whole.limits(dof)[1] === Infinity;
    return whole.motions.some((own, j) => whole.parents[j] < 0 && own.some(free) && own.some(({ dof }) => dof === d));
  }
}

const POSES = 200; // that are looked at to see how far a body reaches

/* So many points of the unit cube, the same each time. */
function spread(count, size) {
  let state = 1;
  const next = () => (state = (state * 16807) % 2147483647) / 2147483647;
  return Array.from({ length: count }, () => Array.from({ length: size }, next));
}
