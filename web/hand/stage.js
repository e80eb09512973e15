/* The picture of the body: turned by dragging, with the surface, the skeleton, the points and the forces. */

import { Viewer } from "./viewer.js";
import { drawBones, line } from "./bones.js";
import { paintSurface, paintPoints } from "./shading.js";
import { add, apply, length, times } from "./vectors.js";

const AIM = 16; // px about a joint that are the joint
const FAST = 25; // ms that a picture may take while something moves
const REST = 160; // ms without movement, after which the picture is drawn finely
const FINE = 2; // samples per px then, along each side
const POINT = 1.25; // px, side of a point
const ARROW = 1 / 32; // length of a newton's arrow, in reaches of the body: 4 mm at the hand
const GHOST = "rgb(128 138 155 / 0.45)"; // the initial pose
const AXES = [["x", "#d62839"], ["y", "#2e8b57"], ["z", "#2563c9"]], AXIS = 26; // px
const STEPS = { ArrowLeft: [-12, 0], ArrowRight: [12, 0], ArrowUp: [0, -12], ArrowDown: [0, 12] };

export class Stage {
  /* canvas   that is drawn on
     body     a Body; or another object with what is read of it here: without push(), no force acts on it
     shows    checkboxes by name: surface, skeleton, points, names, initial (pose), all (forces on any joint)
     tell     is given a line on what is under the pointer */
  constructor(canvas, body, shows, tell) {
    Object.assign(this, { canvas, body, shows, tell, viewer: new Viewer(), pointers: new Map() });
    Object.assign(this, { hovered: null, coarse: 1 });
    this.layer = document.createElement("canvas");
    body.listeners.push((what) => {
      if (what === "skeleton") {
        this.hovered = null;
        this.pointers.clear();
        this.reset();
      }
      this.tell(this.hovered);
      this.stir();
    });
    for (const box of Object.values(shows)) box.addEventListener("change", () => this.stir());
    new ResizeObserver(() => this.stir()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.stir());
    this.listen();
    this.reset();
  }

  reset() {
    this.viewer.show(this.body.bounds);
    this.stir();
  }

  /* Draw soon, coarsely; and finely when nothing has moved for a while. */
  stir() {
    clearTimeout(this.resting);
    this.resting = setTimeout(() => this.draw(FINE), REST);
    this.waiting ??= requestAnimationFrame(() => {
      this.waiting = undefined;
      const before = performance.now();
      this.draw(this.coarse);
      const factor = Math.sqrt(FAST / Math.max(performance.now() - before, 1));
      this.coarse = Math.min(Math.max(this.coarse * factor, 0.4), 1);
    });
  }

  draw(samples) {
    const { canvas, viewer, body, shows } = this, { width, height } = canvas.getBoundingClientRect();
    if (!width || !height) return;
    const ratio = Math.max(devicePixelRatio, 1);
    Object.assign(canvas, { width: Math.round(width * ratio), height: Math.round(height * ratio) });
    Object.assign(viewer, { width, height });
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    if (shows.initial?.checked) this.drawInitial(pen);
    this.drawSurfaces(pen, Math.round(width * samples), Math.round(height * samples));
    if (shows.skeleton.checked) this.drawSkeleton(pen);
    this.drawForces(pen);
    this.drawScale(pen);
    if (shows.names?.checked) body.skeleton.joints.forEach((_, j) => this.drawName(pen, j));
    else if (this.hovered !== null) this.drawName(pen, this.hovered);
  }

  drawSurfaces(pen, width, height) {
    const { body, layer, shows, viewer } = this;
    Object.assign(layer, { width, height });
    const brush = layer.getContext("2d"), picture = brush.createImageData(width, height);
    const capsules = shows.surface.checked ? body.capsules : [];
    const image = paintSurface(picture, capsules, body.whole.joints, viewer);
    if (body.points && shows.points.checked) {
      const [x, y, z] = body.origin, moved = body.points.map((mm, i) => mm + [x, y, z][i % 3]);
      paintPoints(picture, moved, viewer, image, Math.max(Math.round((POINT * width) / viewer.width), 1));
    }
    brush.putImageData(picture, 0, 0);
    pen.imageSmoothingQuality = "high";
    pen.drawImage(layer, 0, 0, viewer.width, viewer.height);
  }

  drawSkeleton(pen) {
    drawBones(pen, this.body, (point) => this.viewer.pixel(point));
  }

  drawInitial(pen) {
    pen.strokeStyle = GHOST;
    pen.lineWidth = 5;
    pen.lineCap = "round";
    for (const [from, to] of this.body.initialBones) line(pen, this.viewer.pixel(from), this.viewer.pixel(to));
  }

  /* In the lower left corner the directions of the axes, and a length as it appears at the body's middle. */
  drawScale(pen) {
    const { viewer, body } = this, ink = getComputedStyle(this.canvas).color;
    const origin = [16 + AXIS, viewer.height - 34 - AXIS];
    pen.font = "12px system-ui, sans-serif";
    pen.lineWidth = 2;
    AXES.forEach(([name, colour], i) => {
      const [x, y] = apply(viewer.turned, [0, 1, 2].map((k) => Number(k === i))), end = [x * AXIS, -y * AXIS];
      pen.strokeStyle = pen.fillStyle = colour;
      line(pen, origin, [origin[0] + end[0], origin[1] + end[1]]);
      pen.fillText(name, origin[0] + 1.3 * end[0] - 3, origin[1] + 1.3 * end[1] + 4);
    });
    const large = viewer.reach > 3 * body.unit, unit = large ? body.unit : 1; // half-cubes of what is large, else mm
    const px = viewer.focal / viewer.distance, size = rounded((viewer.width * 0.2) / px / unit);
    pen.strokeStyle = pen.fillStyle = ink;
    pen.lineWidth = 1.5;
    const y = viewer.height - 10, right = 12 + size * unit * px;
    line(pen, [12, y], [right, y]);
    for (const x of [12, right]) line(pen, [x, y - 4], [x, y + 4]);
    pen.fillText(large ? `${size} half-cubes, ${size * unit} mm` : `${size} mm`, right + 8, y + 4);
  }

  drawForces(pen) {
    const { body, viewer } = this;
    body.forces.forEach((force, j) => {
      if (!length(force)) return;
      const from = body.joints[j], to = add(from, times(force, ARROW * viewer.reach));
      const start = viewer.pixel(from), end = viewer.pixel(to), dx = end[0] - start[0], dy = end[1] - start[1];
      const long = Math.hypot(dx, dy) || 1, x = dx / long, y = dy / long; // the arrow's direction
      pen.strokeStyle = pen.fillStyle = "rgb(214 40 57)";
      pen.lineWidth = 3.5;
      line(pen, start, [end[0] - 7 * x, end[1] - 7 * y]);
      pen.beginPath();
      pen.moveTo(end[0], end[1]);
      for (const side of [1, -1]) pen.lineTo(end[0] - 13 * x + side * 6 * y, end[1] - 13 * y - side * 6 * x);
      pen.fill();
    });
  }

  drawName(pen, joint) {
    const { body, viewer } = this, [u, v] = viewer.pixel(body.joints[joint]), name = body.skeleton.joints[joint];
    pen.font = "12px system-ui, sans-serif";
    const wide = pen.measureText(name).width, left = Math.min(u + 9, viewer.width - wide - 8);
    pen.fillStyle = "rgb(20 24 32 / 0.82)";
    pen.beginPath();
    pen.roundRect(left - 4, v - 20, wide + 8, 18, 4);
    pen.fill();
    pen.fillStyle = "white";
    pen.fillText(name, left, v - 7);
  }

  /* The joint at a place of the canvas, the nearest to the eye of those that may be meant; null if there is none. */
  jointAt(x, y, only = null) {
    let found = null, best = Infinity;
    this.body.joints.slice(0, this.body.skeleton.joints.length).forEach((joint, j) => {
      const [u, v, depth] = this.viewer.pixel(joint), off = Math.hypot(u - x, v - y);
      if (off > AIM || (only && !only.includes(j)) || off * 1e3 + depth > best) return;
      [found, best] = [j, off * 1e3 + depth];
    });
    return found;
  }

  listen() {
    const { canvas, viewer, pointers } = this;
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      const at = [event.offsetX, event.offsetY];
      const joints = this.shows.all?.checked ? null : this.body.tips;
      const pushed = !this.body.push || pointers.size || event.shiftKey ? null : this.jointAt(...at, joints);
      pointers.set(event.pointerId, { at, pushed });
    });
    canvas.addEventListener("pointermove", (event) => this.pointerMoved(event));
    for (const end of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(end, (event) => pointers.delete(event.pointerId));
    }
    canvas.addEventListener("pointerleave", () => this.hover(null));
    canvas.addEventListener("dblclick", () => this.reset());
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      viewer.closer(Math.exp(-event.deltaY * 0.0015));
      this.stir();
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      if (event.key in STEPS) viewer.turn(...STEPS[event.key]);
      else if ("+-".includes(event.key)) viewer.closer(event.key === "+" ? 1.15 : 1 / 1.15);
      else if (event.key === "0") this.reset();
      else return;
      event.preventDefault();
      this.stir();
    });
  }

  pointerMoved(event) {
    const at = [event.offsetX, event.offsetY], { pointers, viewer, body } = this, held = pointers.get(event.pointerId);
    if (!held) return this.hover(this.jointAt(...at));
    const [dx, dy] = [at[0] - held.at[0], at[1] - held.at[1]];
    if (pointers.size === 2) {
      const other = [...pointers].find(([id]) => id !== event.pointerId)[1].at;
      const apart = ([x, y]) => Math.max(Math.hypot(x - other[0], y - other[1]), 1);
      viewer.closer(apart(at) / apart(held.at));
    } else if (held.pushed !== null) {
      const [u, v, depth] = viewer.pixel(body.joints[held.pushed]);
      body.push(held.pushed, times(viewer.vector(at[0] - u, at[1] - v, depth), 1 / (ARROW * viewer.reach)));
      return this.hover(held.pushed);
    } else {
      viewer.turn(dx, dy);
    }
    held.at = at;
    this.stir();
  }

  hover(joint) {
    if (joint === this.hovered && joint === null) return;
    this.hovered = joint;
    this.canvas.classList.toggle("over-joint", joint !== null);
    this.tell(joint);
    this.stir();
  }
}

/* The largest of 1, 2, 5, 10, 20 ... (0.1, 0.2, 0.5 ...) that is not above the number. */
function rounded(number) {
  const power = 10 ** Math.floor(Math.log10(number)), digit = number / power;
  return (digit >= 5 ? 5 : digit >= 2 ? 2 : 1) * power;
}
