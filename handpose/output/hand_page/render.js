/* Renders depth images of capsules. The formulas are derived in handpose/body/render.py: the infinite cone that touches
   the spheres of a round cone gives the sphere that a ray meets first.

   Capsules are {a, b, ra, rb} in mm, camera axes: x right, y up, z away. Rays have the slopes x, y (y DOWN) and 1. */

import { add, dot, minus, times } from "./vectors.js";

const CLEAR = 40; // mm: parts of capsules nearer to the plane of the camera than this are cut off
const OUTSIDE = 8; // slope of the rays of pixels outside the image, which is too large to meet a capsule

/* Render capsules along rays of ascending slopes `x` and `y`: {depth, owner, along}, row by row.

   depth is in mm. owner is the index of the visible capsule, -1 where no capsule is nearer than `background`. along is
   the position of the visible sphere on the capsule's axis, from 0 (at a) to 1 (at b). */
export function render(capsules, x, y, background) {
  const pixels = x.length * y.length;
  const image = {
    width: x.length, height: y.length, depth: new Float32Array(pixels).fill(background),
    owner: new Int16Array(pixels).fill(-1), along: new Float32Array(pixels),
  };
  capsules.forEach((capsule, number) => {
    const near = inFront(capsule);
    if (near) draw(image, visible(near), number, x, y);
  });
  return image;
}

/* The part of a capsule in front of the camera, or null if there is none. */
function inFront({ a, b, ra, rb }) {
  const nearA = a[2] - ra - CLEAR, nearB = b[2] - rb - CLEAR;
  if (nearA >= 0 && nearB >= 0) return { a, b, ra, rb, first: 0, last: 1 };
  if (nearA < 0 && nearB < 0) return null;
  const cut = -nearA / (nearB - nearA), along = minus(b, a);
  const first = nearA < 0 ? cut : 0, last = nearB < 0 ? cut : 1;
  const at = (s) => add(a, times(along, s)), radius = (s) => ra + s * (rb - ra);
  return { a: at(first), b: at(last), ra: radius(first), rb: radius(last), first, last };
}

/* The capsule with y down. It is replaced by a sphere if only the sphere at one end is visible. */
function visible({ a, b, ra, rb, first, last }) {
  [a, b] = [a, b].map(([x, y, z]) => [x, -y, z]);
  const B = minus(b, a), w = ra - rb, e = dot(B, B) - w * w, g = dot(a, B) + ra * w;
  let end = w < 0 ? 1 : 0; // the larger sphere, which is all there is if it contains the other one
  let one = e <= 0;
  if (!one) { // if the camera is inside the infinite cone, the nearer end hides the rest
    const s = -g / e;
    one = e * (dot(a, a) - ra * ra) - g * g <= 0 && ra - s * w > 0;
    end = Math.round(Math.min(Math.max(s, 0), 1));
  }
  if (!one) return { a, b, ra, rb, first, last };
  return end ? { a: b, b, ra: rb, rb, first: last, last } : { a, b: a, ra, rb: ra, first, last: first };
}

/* The smallest and the largest slope along x or y of the rays that touch the capsule. */
function extent({ a, b, ra, rb }, axis) {
  const bounds = [[a, ra], [b, rb]].map(([c, r]) => {
    const p = c[axis], z = c[2], reach = r * Math.sqrt(p * p + z * z - r * r), below = z * z - r * r;
    return [(p * z - reach) / below, (p * z + reach) / below];
  });
  return [Math.min(bounds[0][0], bounds[1][0]), Math.max(bounds[0][1], bounds[1][1])];
}

/* How many ascending numbers are less than `bound` or, with `including`, less than or equal to it. */
function count(ascending, bound, including) {
  let low = 0, high = ascending.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (including ? ascending[middle] <= bound : ascending[middle] < bound) low = middle + 1;
    else high = middle;
  }
  return low;
}

function draw(image, capsule, number, x, y) {
  const { a, b, ra, rb, first, last } = capsule, [left, right] = extent(capsule, 0), [top, bottom] = extent(capsule, 1);
  const i0 = count(x, left, false), i1 = count(x, right, true), j0 = count(y, top, false), j1 = count(y, bottom, true);
  const B = minus(b, a), w = ra - rb, cone = dot(B, B) - w * w;
  const e = cone > 0 ? cone : 1, g = dot(a, B) + ra * w, q = dot(a, a) - ra * ra, k0 = e * q - g * g;
  const k = minus(times(B, g), times(a, e));
  for (let j = j0; j < j1; j++) {
    const Y = y[j], dY = Y * Y + 1;
    const BY = B[1] * Y + B[2], kY = k[1] * Y + k[2], aY = a[1] * Y + a[2];
    for (let i = i0; i < i1; i++) {
      const X = x[i], dd = X * X + dY, Bd = B[0] * X + BY, k1 = k[0] * X + kY;
      const k2 = e * dd - Bd * Bd;
      const t = -(Math.sqrt(Math.max(k1 * k1 - k0 * k2, 0)) + k1) / k2;
      const s = Math.min(Math.max((t * Bd - g) / e, 0), 1);
      const cd = a[0] * X + aY + s * Bd, inside = cd * cd - dd * (q + s * (2 * g + s * e));
      if (!(inside >= 0)) continue; // the ray misses the capsule
      const depth = (cd - Math.sqrt(inside)) / dd, pixel = j * image.width + i;
      if (depth >= image.depth[pixel]) continue;
      image.depth[pixel] = depth;
      image.owner[pixel] = number;
      image.along[pixel] = first + s * (last - first);
    }
  }
}

/* The slopes of the rays through image columns or rows; -1 is a pixel outside the image. */
export function slopes(pixels, middle, focal) {
  let before = true;
  return Float32Array.from(pixels, (pixel) => {
    if (pixel >= 0) before = false;
    return pixel >= 0 ? (pixel - middle) / focal : before ? -OUTSIDE : OUTSIDE;
  });
}

/* A pinhole camera, and the crop of its image that is the input of a network, as in handpose/frames/crops.py. */

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

/* The points of a crop, -1 to 1, inside its cube, each image pixel once: x, y, z in mm from its centre, one after the
   other. */
export function cropPoints(crop, uvd, cube, camera) {
  const { columns, rows } = cropPixels(uvd, cube, camera), center = unproject(camera, uvd), points = [];
  const isNew = (pixel, i, pixels) => pixel !== pixels[i - 1]; // those outside the image have the far face's value, 1
  rows.forEach((row, j) => columns.forEach((column, i) => {
    const value = crop[j * SIZE + i];
    if (!isNew(row, j, rows) || !isNew(column, i, columns) || Math.abs(value) >= 1) return;
    points.push(...minus(unproject(camera, [column, row, (value * cube) / 2 + uvd[2]]), center));
  }));
  return points;
}
