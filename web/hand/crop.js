/* A pinhole camera, and the crop of its image that a network sees, as handpose/frames/crops.py cuts it. */

import { render, slopes } from "./render.js";

export const SIZE = 128; // pixels on a side

/* x, y, z in mm (y up) of an image point u, v in px and d in mm. */
export const unproject = ({ fx, fy, u0, v0 }, [u, v, d]) => [((u - u0) * d) / fx, ((v0 - v) * d) / fy, d];

/* The image pixels, {columns, rows}, -1 where there is none, of the crop of a cube of `cube` mm about `uvd`. */
export function pixelsOf(uvd, cube, camera) {
  const edges = [[uvd[0], camera.fx], [uvd[1], camera.fy]].map(([at, focal]) => {
    const side = (reach) => Math.floor((((at * uvd[2]) / focal + reach) / uvd[2]) * focal);
    const start = side(-cube / 2);
    return { start, extent: Math.max(side(cube / 2) - start, 1) };
  });
  const longest = Math.max(edges[0].extent, edges[1].extent);
  const [columns, rows] = edges.map(({ start, extent }, axis) => {
    const length = Math.max(Math.floor((extent * SIZE) / longest), 1);
    const pad = Math.floor(SIZE / 2) - Math.floor(length / 2), pixels = [camera.width, camera.height][axis];
    return Array.from({ length: SIZE }, (_, pixel) => {
      const i = pixel - pad, index = start + Math.min(Math.floor(i * (1 / (length / extent))), extent - 1);
      return i >= 0 && i < length && index >= 0 && index < pixels ? index : -1;
    });
  });
  return { columns, rows };
}

/* Depth in mm of capsules in the crop, SIZE x SIZE; nothing in sight is the far face of the cube. */
export function renderCrop(capsules, uvd, cube, camera) {
  const { columns, rows } = pixelsOf(uvd, cube, camera);
  const x = slopes(columns, camera.u0, camera.fx), y = slopes(rows, camera.v0, camera.fy);
  return render(capsules, x, y, uvd[2] + cube / 2).depth;
}

/* Depth in mm to [-1, 1] across the cube, in a new array: what the network sees. */
export const normalised = (depth, uvd, cube) => (
  depth.map((mm) => Math.min(Math.max(((mm - uvd[2]) * 2) / cube, -1), 1))
);
