/* The state of the page: a body in a pose in front of a camera, with forces on its joints. Each part of the page adds a
   function to `listeners`, which is called after a change. */

import { backward, forward, Skeleton, Surface } from "./skeleton.js";
import { unproject } from "./render.js";
import { add, boundingSphere, product, times } from "./vectors.js";

const SAMPLED_POSES = 200; // random poses from which the bounds of a body are computed

export class Body {
  /* skeleton          the body without its surface
     whole, surface    the skeleton followed by the joints and DoFs of its surface alone; its capsules, or null
     inputs            of the whole body: radians and units; for a left hand those of its mirror image
     side              "right", or "left" for the mirror image of the skeleton
     size, thickness   factors of bones, offsets and radii; of the radii alone
     unit              mm of a length of 1
     camera            of the frame or of the choice on the page
     uvd, cube         the centre of the crop (px, px, mm), which is the origin of the inputs; its edge in mm
     forces            per joint of the skeleton: a force in N, camera axes
     points            the recorded depth as x, y, z in mm from the centre of the crop, one after the other; or null
     recordedCrop      the recorded crop, -1 to 1; or null */
  constructor(values) {
    this.listeners = [];
    this.open(values);
  }

  /* Show another body, {skeleton, place} of assembly.py, in its initial pose. */
  open({ skeleton: values, place }) {
    const skeleton = new Skeleton(values.own), whole = new Skeleton(values.whole);
    Object.assign(this, { skeleton, whole, surface: values.capsules && new Surface(values) });
    Object.assign(this, { side: "right", size: 1, thickness: 1, points: null, recordedCrop: null });
    Object.assign(this, { unit: place.unit_mm, camera: place.camera, uvd: place.center_uvd, cube: place.cube_mm });
    this.inputs = whole.dofs.map(() => 0);
    this.forces = skeleton.joints.map(() => [0, 0, 0]);
    this.notify("skeleton");
  }

  /* Change the camera, the place of the crop, or the side. */
  change(values) {
    Object.assign(this, values);
    this.notify("pose");
  }

  /* Change some inputs: {index: value}. */
  setInputs(values) {
    for (const [d, value] of Object.entries(values)) this.inputs[d] = value;
    this.notify("pose");
  }

  applyForce(joint, force) {
    this.forces[joint] = force;
    this.notify("force");
  }

  clearForces() {
    this.forces = this.forces.map(() => [0, 0, 0]);
    this.notify("force");
  }

  /* Call every listener with what has changed: "skeleton", "pose" or "force". */
  notify(what) {
    this.cachedPose = this.cachedJoints = null;
    for (const listener of this.listeners) listener(what);
  }

  get pose() {
    this.cachedPose ??= forward(this.whole, this.inputs, this.size);
    return this.cachedPose;
  }

  /* Convert a vector from the axes of the body to those of the camera, or back: they differ for a left hand. */
  mirrored(vector) {
    return this.side === "left" ? product(vector, [-1, 1, 1]) : vector;
  }

  /* The origin of the inputs in mm, camera axes. */
  get origin() {
    return unproject(this.camera, this.uvd);
  }

  /* Convert a point of the pose to mm, camera axes. */
  toCamera(point) {
    return add(this.origin, times(this.mirrored(point), this.unit));
  }

  /* All joints in mm, camera axes: those of the skeleton, then those of the surface alone. */
  get joints() {
    this.cachedJoints ??= this.pose.joints.map((joint) => this.toCamera(joint));
    return this.cachedJoints;
  }

  /* The joints of the skeleton in units from the origin: the output of HandModel. */
  get outputs() {
    return this.skeleton.joints.map((_, j) => this.mirrored(this.pose.joints[j]));
  }

  /* The capsules of the surface in mm, camera axes. */
  get capsules() {
    if (!this.surface) return [];
    return this.surface.posed(this.pose, this.size, this.thickness).map(({ a, b, ra, rb, ...joints }) => (
      { a: this.toCamera(a), b: this.toCamera(b), ra: ra * this.unit, rb: rb * this.unit, ...joints }
    ));
  }

  /* The torque of the forces about the axis of each DoF in N mm; for a translation, the force along it in N. */
  get torques() {
    const forces = this.whole.joints.map((_, j) => this.mirrored(this.forces[j] ?? [0, 0, 0]));
    const gradient = backward(this.whole, this.pose, forces);
    return gradient.map((torque, d) => (this.whole.turns[d] ? torque * this.unit : torque));
  }

  /* The losses of PhysLimit: L1 is that of the paper, L2 that of the released system. */
  get limitLoss() {
    const beyond = this.skeleton.beyond(this.inputs);
    return {
      L1: beyond.reduce((sum, v) => sum + Math.abs(v), 0), L2: beyond.reduce((sum, v) => sum + v * v, 0),
    };
  }

  /* The joints of the skeleton without children. */
  get tips() {
    const parents = new Set(this.skeleton.parents);
    return [...this.skeleton.joints.keys()].filter((j) => !parents.has(j));
  }

  /* The start of a joint's bone in mm: its parent, or for a root the place to which its motions lead; null without a
     bone. */
  boneStart(joint, pose = this.pose) {
    const parent = this.skeleton.parents[joint];
    if (parent >= 0) return this.toCamera(pose.joints[parent]);
    return this.skeleton.boneAxes[joint] < 0 ? null : this.toCamera(pose.starts[joint]);
  }

  /* The bones [start, end] in mm of the initial pose, at the present place of the body. */
  get initialBones() {
    const inputs = this.inputs.map((value, d) => (this.movesWholeBody(d) ? value : 0));
    const pose = forward(this.whole, inputs, this.size);
    const bones = this.skeleton.joints.map((_, j) => [this.boneStart(j, pose), this.toCamera(pose.joints[j])]);
    return bones.filter(([start]) => start);
  }

  /* The centre and the radius in mm of a sphere that contains the joints of the present pose and of random poses
     within the limits. Inputs that move the whole body keep their present values. */
  get bounds() {
    const { skeleton, whole, size } = this, ends = skeleton.joints.map((_, j) => this.boneStart(j)).filter(Boolean);
    ends.push(...this.joints.slice(0, skeleton.joints.length));
    const range = (d) => {
      const most = whole.turns[d] ? Math.PI : 1;
      return [Math.max(whole.lower[d], -most), Math.min(whole.upper[d], most)];
    };
    const ranges = whole.dofs.map((_, d) => (this.movesWholeBody(d) ? [this.inputs[d], this.inputs[d]] : range(d)));
    for (const share of unitCubePoints(SAMPLED_POSES, whole.dofs.length)) {
      const inputs = ranges.map(([low, high], d) => low + share[d] * (high - low));
      const joints = forward(whole, inputs, size).joints.slice(0, skeleton.joints.length);
      ends.push(...joints.map((joint) => this.toCamera(joint)));
    }
    return boundingSphere(ends, 1);
  }

  /* Whether a DoF moves the whole body: one of a root that can be translated without limits. */
  movesWholeBody(d) {
    const { whole } = this;
    const isFree = ({ turns, dof }) => !turns && !whole.fixed[dof] && whole.upper[dof] === Infinity;
    return whole.motions.some((own, j) => (
      whole.parents[j] < 0 && own.some(isFree) && own.some(({ dof }) => dof === d)
    ));
  }
}

/* Pseudo-random points of the unit cube, equal in every call. */
function unitCubePoints(count, dimensions) {
  let state = 1;
  const next = () => (state = (state * 16807) % 2147483647) / 2147483647;
  return Array.from({ length: count }, () => Array.from({ length: dimensions }, next));
}
