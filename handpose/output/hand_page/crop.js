/* A pinhole camera, and the crop of its image that is the input of a network, as in handpose/frames/crops.py. */

import { render, slopes } from "./render.js";

export const SIZE = 128; // px, edge of the crop

/* Convert an image point u, v in px at the depth d in mm to x, y, z in mm (y up). */
export const unproject = ({ fx, fy, u0, v0 }, [u, v, d]) => [((u - u0) * d) / fx, ((v0 - v) * d) / fy, d];

/* The image pixels {columns, rows} of the crop around a cube of `cube` mm at `uvd`; -1 is a pixel outside the image. */
export function cropPixels(uvd, cube, camera) {
  const edges = [[uvd[0], camera.fx], [uvd[1], camera.fy]].map(([at, focal]) => {
    const edge = (offset) => Math.floor((((at * uvd[2]) / focal + offset) / uvd[2]) * focal);
    const start = edge(-cube / 2);
    return { start, extent: Math.max(edge(cube / 2) - start, 1) };
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

/* Depth in mm of capsules in the crop, SIZE x SIZE; pixels without a capsule have the depth of the cube's far face. */
export function renderCrop(capsules, uvd, cube, camera) {
  const { columns, rows } = cropPixels(uvd, cube, camera);
  const x = slopes(columns, camera.u0, camera.fx), y = slopes(rows, camera.v0, camera.fy);
  return render(capsules, x, y, uvd[2] + cube / 2).depth;
}

/* Convert depth in mm to -1 ... 1 across the cube, the input of the network, in a new array. */
export const normalised = (depth, uvd, cube) => (
  depth.map((mm) => Math.min(Math.max(((mm - uvd[2]) * 2) / cube, -1), 1))
);
