/* Pictures of the surface and of points: every pixel lit by the direction of the surface that it shows. */

import { length, times } from "./vectors.js";
import { render } from "./render.js";

export const COLOURS = { // RGB of a joint by the first part of its name, as handpose/output/drawing/hands.py
  thumb: [240, 90, 80], index: [250, 165, 40], middle: [90, 200, 90], ring: [60, 185, 225], little: [170, 95, 225],
};
export const GREY = [150, 150, 150]; // of all other joints
export function colourOf(name) {
  const [part] = name.split("_");
  return Object.hasOwn(COLOURS, part) ? COLOURS[part] : undefined; // a joint may be called "constructor"
}

const SKIN = [235, 165, 120], TINT = 0.2, DARKEST = 0.42;
const LIGHT = [-0.35, -0.45, -0.82]; // y down: from the upper left, behind the viewer
const POINT = [40, 110, 235], BEHIND = 0.25; // how much of a point shows through the surface in front of it
const MARGIN = 2; // mm, that a point may lie behind the surface

/* The surface as the viewer sees it, into `picture` (ImageData): {owner, depth} of every pixel. */
export function paintSurface(picture, capsules, names, viewer) {
  const { width, height, data } = picture;
  const seen = capsules.map((c) => ({ ...c, a: viewer.see(c.a), b: viewer.see(c.b) }));
  const x = viewer.slopes(width, viewer.width), y = viewer.slopes(height, viewer.height);
  const image = render(seen, x, y, Infinity);
  const [lx, ly, lz] = times(LIGHT, 1 / length(LIGHT));
  const part = (joint) => names[joint].split("_")[0];
  const skins = capsules.map((c) => (part(c.from) === part(c.to) ? mixed(SKIN, colourOf(names[c.to]) ?? SKIN) : SKIN));
  for (let row = 0, pixel = 0; row < height; row++) {
    for (let column = 0; column < width; column++, pixel++) {
      const owner = image.owner[pixel];
      if (owner < 0) continue;
      const { a, b, ra, rb } = seen[owner], t = image.depth[pixel], s = image.along[pixel], skin = skins[owner];
      const outX = x[column] * t - (a[0] + s * (b[0] - a[0])); // from the axis to the surface, y down
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

/* Points (flat x, y, z in mm) as squares of `size` px, faint behind the surface. */
export function paintPoints(picture, points, viewer, image, size) {
  const { width, height, data } = picture, scale = width / viewer.width;
  for (let i = 0; i < points.length; i += 3) {
    const [u, v, depth] = viewer.pixel([points[i], points[i + 1], points[i + 2]]);
    const left = Math.round(u * scale - size / 2), top = Math.round(v * scale - size / 2);
    for (let row = Math.max(top, 0); row < Math.min(top + size, height); row++) {
      for (let column = Math.max(left, 0); column < Math.min(left + size, width); column++) {
        const pixel = row * width + column, hidden = image.depth[pixel] < depth - MARGIN;
        const part = hidden ? BEHIND : 1;
        for (let c = 0; c < 3; c++) data[4 * pixel + c] += part * (POINT[c] - data[4 * pixel + c]);
        data[4 * pixel + 3] = Math.max(data[4 * pixel + 3], 255 * part);
        if (!hidden) image.depth[pixel] = depth;
      }
    }
  }
}

/* Normalised depth, -1 near to 1 far, as grey in `picture`; near is light, as in handpose/output/drawing/hands.py. */
export function paintDepth(picture, values) {
  const { data } = picture;
  for (let pixel = 0; pixel < values.length; pixel++) {
    data.fill(Math.round((1 - values[pixel]) * 0.5 * 215), 4 * pixel, 4 * pixel + 3);
    data[4 * pixel + 3] = 255;
  }
}

const mixed = (a, b) => a.map((value, i) => value + TINT * (b[i] - value));
