/* Paints the surface, with each pixel lit according to the normal of the surface, and points and depth images. */

import { render } from "./render.js";
import { length, times } from "./vectors.js";

export const COLOURS = { // RGB of a joint by the first part of its name, as in handpose/output/drawing/hands.py
  thumb: [240, 90, 80], index: [250, 165, 40], middle: [90, 200, 90], ring: [60, 185, 225], little: [170, 95, 225],
};
const GREY = [150, 150, 150]; // RGB of all other joints
export function colourOf(name) {
  const [part] = name.split("_");
  return Object.hasOwn(COLOURS, part) ? COLOURS[part] : undefined; // hasOwn, because a joint may be named "constructor"
}

const SKIN = [235, 165, 120], TINT = 0.2, DARKEST = 0.42;
const LIGHT = [-0.35, -0.45, -0.82]; // direction to the light, y down: the upper left, behind the viewer
const POINT_COLOUR = [40, 110, 235];
const HIDDEN_OPACITY = 0.25; // opacity of a point behind the surface
const HIDDEN_MM = 2; // mm: a point is hidden if it is farther than this behind the surface

/* Paint capsules into `picture` (ImageData) as an orbit camera shows them. Returns the rendered image (render.js). */
export function paintSurface(picture, capsules, names, view) {
  const { width, height, data } = picture;
  const seen = capsules.map((c) => ({ ...c, a: view.toView(c.a), b: view.toView(c.b) }));
  const x = view.slopes(width, view.width), y = view.slopes(height, view.height);
  const image = render(seen, x, y, Infinity);
  const [lx, ly, lz] = times(LIGHT, 1 / length(LIGHT));
  const part = (joint) => names[joint].split("_")[0];
  const skins = capsules.map((c) => (part(c.from) === part(c.to) ? mixed(SKIN, colourOf(names[c.to]) ?? SKIN) : SKIN));
  for (let row = 0, pixel = 0; row < height; row++) {
    for (let column = 0; column < width; column++, pixel++) {
      const owner = image.owner[pixel];
      if (owner < 0) continue;
      const { a, b, ra, rb } = seen[owner], t = image.depth[pixel], s = image.along[pixel], skin = skins[owner];
      const outX = x[column] * t - (a[0] + s * (b[0] - a[0])); // the vector from the axis to the surface, y down
      const outY = y[row] * t + (a[1] + s * (b[1] - a[1]));
      const outZ = t - (a[2] + s * (b[2] - a[2]));
      const lit = (outX * lx + outY * ly + outZ * lz) / (ra + s * (rb - ra));
      const bright = DARKEST + (1.05 - DARKEST) * Math.max(lit, 0);
      data[4 * pixel] = skin[0] * bright;
      data[4 * pixel + 1] = skin[1] * bright;
      data[4 * pixel + 2] = skin[2] * bright;
      data[4 * pixel + 3] = 255;
    }
  }
  return image;
}

/* Paint points, x, y, z in mm one after the other, as squares of `size` px; those behind the surface are faint. */
export function paintPoints(picture, points, view, image, size) {
  const { width, height, data } = picture, scale = width / view.width;
  for (let i = 0; i < points.length; i += 3) {
    const [u, v, depth] = view.project([points[i], points[i + 1], points[i + 2]]);
    const left = Math.round(u * scale - size / 2), top = Math.round(v * scale - size / 2);
    for (let row = Math.max(top, 0); row < Math.min(top + size, height); row++) {
      for (let column = Math.max(left, 0); column < Math.min(left + size, width); column++) {
        const pixel = row * width + column, hidden = image.depth[pixel] < depth - HIDDEN_MM;
        const opacity = hidden ? HIDDEN_OPACITY : 1;
        for (let c = 0; c < 3; c++) data[4 * pixel + c] += opacity * (POINT_COLOUR[c] - data[4 * pixel + c]);
        data[4 * pixel + 3] = Math.max(data[4 * pixel + 3], 255 * opacity);
        if (!hidden) image.depth[pixel] = depth;
      }
    }
  }
}

/* Paint normalised depth, from -1 (near, light) to 1 (far, dark), as in handpose/output/drawing/hands.py. */
export function paintDepth(picture, values) {
  const { data } = picture;
  for (let pixel = 0; pixel < values.length; pixel++) {
    data.fill(Math.round((1 - values[pixel]) * 0.5 * 215), 4 * pixel, 4 * pixel + 3);
    data[4 * pixel + 3] = 255;
  }
}

/* A colour between a and b. */
const mixed = (a, b) => a.map((value, i) => value + TINT * (b[i] - value));

/* Draw the bones and joints of a body as lines and discs, the farthest joint first. The body has joints,
   skeleton.joints, boneStart() and tips. Joints in the set body.guesses are hollow: white, with a rim in their colour.
   project(point) converts a point in mm to [px to the right, px down, mm away]. */
export function drawBones(pen, body, project) {
  const pixels = body.joints.map(project), { skeleton } = body, tips = new Set(body.tips);
  const order = [...skeleton.joints.keys()].sort((i, j) => pixels[j][2] - pixels[i][2]);
  pen.lineCap = "round";
  for (const j of order) {
    const start = body.boneStart(j), [u, v] = pixels[j];
    const colour = `rgb(${(colourOf(skeleton.joints[j]) ?? GREY).join(" ")})`;
    const [rim, inside] = body.guesses?.has(j) ? [colour, "white"] : ["rgb(20 24 32 / 0.55)", colour];
    for (const [style, rimWidth] of [[rim, 2], [inside, 0]]) {
      pen.strokeStyle = pen.fillStyle = style;
      pen.lineWidth = 2.5 + rimWidth;
      if (start) drawLine(pen, project(start), pixels[j]);
      drawDisc(pen, u, v, (tips.has(j) ? 4.5 : 3) + rimWidth / 2);
    }
  }
}

export function drawLine(pen, [x, y], [u, v]) {
  pen.beginPath();
  pen.moveTo(x, y);
  pen.lineTo(u, v);
  pen.stroke();
}

function drawDisc(pen, x, y, radius) {
  pen.beginPath();
  pen.arc(x, y, radius, 0, 2 * Math.PI);
  pen.fill();
}
