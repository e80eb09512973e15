/* The 3-D view of a body: surface, skeleton, depth points and forces, which can be rotated with the pointer. */

import { drawBones, drawLine, paintPoints, paintSurface } from "./shading.js";
import { OrbitCamera } from "./orbit_camera.js";
import { add, apply, length, times } from "./vectors.js";

const PICK_RADIUS = 16; // px: a click this near to a joint selects it
const DRAW_MS = 25; // time limit of a drawing while something moves
const STILL_MS = 160; // time without movement before the picture is drawn in high resolution
const HIGH_RESOLUTION = 2; // samples per px along each side
const POINT_PX = 1.25; // side of a depth point
const FORCE_LENGTH = 1 / 32; // length of the arrow of 1 N, in radii of the body: 4 mm for a hand
const AXIS_PX = 26; // length of the coordinate axes in the corner
const AXES = [["x", "#d62839"], ["y", "#2e8b57"], ["z", "#2563c9"]];
const FORCE_COLOUR = "rgb(214 40 57)", INITIAL_COLOUR = "rgb(128 138 155 / 0.45)";
const KEY_STEPS = { ArrowLeft: [-12, 0], ArrowRight: [12, 0], ArrowUp: [0, -12], ArrowDown: [0, 12] }; // px

export class BodyView {
  /* canvas       where to draw
     body         a Body, or any object with joints, skeleton, whole, capsules, bounds, points, forces and listeners;
                  forces can be applied if it has applyForce()
     checkboxes   by name: surface, skeleton, points, names, initial (pose), all (forces on any joint)
     onHover      is called with the index of the joint under the pointer, or null, and when this joint changes */
  constructor(canvas, body, checkboxes, onHover) {
    Object.assign(this, { canvas, body, checkboxes, onHover, camera: new OrbitCamera(), pointers: new Map() });
    Object.assign(this, { hovered: null, samples: 1 });
    this.layer = document.createElement("canvas");
    body.listeners.push((what) => {
      if (what === "skeleton") {
        this.hovered = null;
        this.pointers.clear();
        this.reset();
      }
      this.onHover(this.hovered);
      this.redraw();
    });
    for (const box of Object.values(checkboxes)) box.addEventListener("change", () => this.redraw());
    new ResizeObserver(() => this.redraw()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.redraw());
    this.listen();
    this.reset();
  }

  /* Show the whole body from the front. */
  reset() {
    this.camera.reset(this.body.bounds);
    this.redraw();
  }

  /* Draw in the next animation frame, in a resolution that takes DRAW_MS, and after STILL_MS without movement in high
     resolution. */
  redraw() {
    clearTimeout(this.stillTimer);
    this.stillTimer = setTimeout(() => this.draw(HIGH_RESOLUTION), STILL_MS);
    this.frameRequest ??= requestAnimationFrame(() => {
      this.frameRequest = undefined;
      const start = performance.now();
      this.draw(this.samples);
      const factor = Math.sqrt(DRAW_MS / Math.max(performance.now() - start, 1));
      this.samples = Math.min(Math.max(this.samples * factor, 0.4), 1);
    });
  }

  /* Draw with this number of samples of the surface per px along each side. */
  draw(samples) {
    const { canvas, camera, body, checkboxes } = this, { width, height } = canvas.getBoundingClientRect();
    if (!width || !height) return;
    const ratio = Math.max(devicePixelRatio, 1);
    Object.assign(canvas, { width: Math.round(width * ratio), height: Math.round(height * ratio) });
    Object.assign(camera, { width, height });
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    if (checkboxes.initial?.checked) this.drawInitialPose(pen);
    this.drawSurface(pen, Math.round(width * samples), Math.round(height * samples));
    if (checkboxes.skeleton.checked) drawBones(pen, body, (point) => camera.project(point));
    this.drawForces(pen);
    this.drawAxes(pen);
    this.drawScaleBar(pen);
    if (checkboxes.names?.checked) body.skeleton.joints.forEach((_, j) => this.drawName(pen, j));
    else if (this.hovered !== null) this.drawName(pen, this.hovered);
  }

  drawSurface(pen, width, height) {
    const { body, layer, checkboxes, camera } = this;
    Object.assign(layer, { width, height });
    const layerPen = layer.getContext("2d"), picture = layerPen.createImageData(width, height);
    const capsules = checkboxes.surface.checked ? body.capsules : [];
    const image = paintSurface(picture, capsules, body.whole.joints, camera);
    if (body.points && checkboxes.points.checked) {
      const { origin } = body, points = body.points.map((mm, i) => mm + origin[i % 3]);
      paintPoints(picture, points, camera, image, Math.max(Math.round((POINT_PX * width) / camera.width), 1));
    }
    layerPen.putImageData(picture, 0, 0);
    pen.imageSmoothingQuality = "high";
    pen.drawImage(layer, 0, 0, camera.width, camera.height);
  }

  drawInitialPose(pen) {
    pen.strokeStyle = INITIAL_COLOUR;
    pen.lineWidth = 5;
    pen.lineCap = "round";
    for (const [start, end] of this.body.initialBones) {
      drawLine(pen, this.camera.project(start), this.camera.project(end));
    }
  }

  /* The directions of x, y and z, in the lower left corner. */
  drawAxes(pen) {
    const { camera } = this, origin = [16 + AXIS_PX, camera.height - 34 - AXIS_PX];
    pen.font = "12px system-ui, sans-serif";
    pen.lineWidth = 2;
    AXES.forEach(([name, colour], i) => {
      const [x, y] = apply(camera.orientation, [0, 1, 2].map((k) => Number(k === i)));
      const end = [x * AXIS_PX, -y * AXIS_PX];
      pen.strokeStyle = pen.fillStyle = colour;
      drawLine(pen, origin, [origin[0] + end[0], origin[1] + end[1]]);
      pen.fillText(name, origin[0] + 1.3 * end[0] - 3, origin[1] + 1.3 * end[1] + 4);
    });
  }

  /* A length at the depth of the body's centre, below the axes: in mm, or in half-cubes for a large body. */
  drawScaleBar(pen) {
    const { camera, body } = this, inHalfCubes = camera.radius > 3 * body.unit, unit = inHalfCubes ? body.unit : 1;
    const pxPerMm = camera.focal / camera.distance, size = roundDown((camera.width * 0.2) / pxPerMm / unit);
    const y = camera.height - 10, right = 12 + size * unit * pxPerMm;
    pen.strokeStyle = pen.fillStyle = getComputedStyle(this.canvas).color;
    pen.lineWidth = 1.5;
    drawLine(pen, [12, y], [right, y]);
    for (const x of [12, right]) drawLine(pen, [x, y - 4], [x, y + 4]);
    pen.fillText(inHalfCubes ? `${size} half-cubes, ${size * unit} mm` : `${size} mm`, right + 8, y + 4);
  }

  drawForces(pen) {
    const { body, camera } = this;
    body.forces.forEach((force, j) => {
      if (!length(force)) return;
      const tail = body.joints[j], [startX, startY] = camera.project(tail);
      const [endX, endY] = camera.project(add(tail, times(force, FORCE_LENGTH * camera.radius)));
      const px = Math.hypot(endX - startX, endY - startY) || 1;
      const x = (endX - startX) / px, y = (endY - startY) / px; // the direction of the arrow
      pen.strokeStyle = pen.fillStyle = FORCE_COLOUR;
      pen.lineWidth = 3.5;
      drawLine(pen, [startX, startY], [endX - 7 * x, endY - 7 * y]);
      pen.beginPath();
      pen.moveTo(endX, endY);
      for (const side of [1, -1]) pen.lineTo(endX - 13 * x + side * 6 * y, endY - 13 * y - side * 6 * x);
      pen.fill();
    });
  }

  drawName(pen, joint) {
    const { body, camera } = this, [u, v] = camera.project(body.joints[joint]), name = body.skeleton.joints[joint];
    pen.font = "12px system-ui, sans-serif";
    const width = pen.measureText(name).width, left = Math.min(u + 9, camera.width - width - 8);
    pen.fillStyle = "rgb(20 24 32 / 0.82)";
    pen.beginPath();
    pen.roundRect(left - 4, v - 20, width + 8, 18, 4);
    pen.fill();
    pen.fillStyle = "white";
    pen.fillText(name, left, v - 7);
  }

  /* The joint nearest to a position of the canvas in px, and of equally near joints the one in front; null if there is
     none. `candidates` restricts the choice. */
  jointAt(x, y, candidates = null) {
    let found = null, best = Infinity;
    this.body.joints.slice(0, this.body.skeleton.joints.length).forEach((joint, j) => {
      const [u, v, depth] = this.camera.project(joint), distance = Math.hypot(u - x, v - y);
      const score = distance * 1e3 + depth;
      if (distance > PICK_RADIUS || (candidates && !candidates.includes(j)) || score > best) return;
      [found, best] = [j, score];
    });
    return found;
  }

  listen() {
    const { canvas, camera, pointers } = this;
    canvas.addEventListener("pointerdown", (event) => this.pressPointer(event));
    canvas.addEventListener("pointermove", (event) => this.movePointer(event));
    for (const end of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(end, (event) => pointers.delete(event.pointerId));
    }
    canvas.addEventListener("pointerleave", () => this.hover(null));
    canvas.addEventListener("dblclick", () => this.reset());
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      camera.zoomBy(Math.exp(-event.deltaY * 0.0015));
      this.redraw();
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      if (event.key in KEY_STEPS) camera.rotate(...KEY_STEPS[event.key]);
      else if ("+-".includes(event.key)) camera.zoomBy(event.key === "+" ? 1.15 : 1 / 1.15);
      else if (event.key === "0") this.reset();
      else return;
      event.preventDefault();
      this.redraw();
    });
  }

  /* A drag that begins at a fingertip applies a force; any other one rotates the body. */
  pressPointer(event) {
    this.canvas.setPointerCapture(event.pointerId);
    const at = [event.offsetX, event.offsetY], { body, checkboxes, pointers } = this;
    const candidates = checkboxes.all?.checked ? null : body.tips;
    const canForce = body.applyForce && !pointers.size && !event.shiftKey;
    pointers.set(event.pointerId, { at, joint: canForce ? this.jointAt(...at, candidates) : null });
  }

  /* One pointer applies a force or rotates; two pointers zoom. */
  movePointer(event) {
    const at = [event.offsetX, event.offsetY], { pointers, camera, body } = this;
    const pressed = pointers.get(event.pointerId);
    if (!pressed) return this.hover(this.jointAt(...at));
    if (pointers.size === 2) {
      const other = [...pointers].find(([id]) => id !== event.pointerId)[1].at;
      const distance = ([x, y]) => Math.max(Math.hypot(x - other[0], y - other[1]), 1);
      camera.zoomBy(distance(at) / distance(pressed.at));
    } else if (pressed.joint !== null) {
      const [u, v, depth] = camera.project(body.joints[pressed.joint]);
      const vector = camera.unprojectVector(at[0] - u, at[1] - v, depth);
      body.applyForce(pressed.joint, times(vector, 1 / (FORCE_LENGTH * camera.radius)));
      return this.hover(pressed.joint);
    } else {
      camera.rotate(at[0] - pressed.at[0], at[1] - pressed.at[1]);
    }
    pressed.at = at;
    this.redraw();
  }

  hover(joint) {
    if (joint === this.hovered && joint === null) return;
    this.hovered = joint;
    this.canvas.classList.toggle("over-joint", joint !== null);
    this.onHover(joint);
    this.redraw();
  }
}

/* The largest of ... 0.1, 0.2, 0.5, 1, 2, 5, 10 ... that is not greater than the number. */
function roundDown(number) {
  const power = 10 ** Math.floor(Math.log10(number)), digit = number / power;
  return (digit >= 5 ? 5 : digit >= 2 ? 2 : 1) * power;
}
