/* Vectors are arrays of three numbers, and 3 x 3 matrices are arrays of three rows. */

export const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const times = (a, factor) => [a[0] * factor, a[1] * factor, a[2] * factor];
export const product = (a, b) => [a[0] * b[0], a[1] * b[1], a[2] * b[2]]; // element by element
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const length = (a) => Math.hypot(a[0], a[1], a[2]);
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

export const IDENTITY = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
export const column = (M, i) => [M[0][i], M[1][i], M[2][i]];
export const transposed = (M) => [column(M, 0), column(M, 1), column(M, 2)];
export const apply = (M, a) => [dot(M[0], a), dot(M[1], a), dot(M[2], a)];

export function compose(M, N) {
  const columns = transposed(N);
  return M.map((row) => [dot(row, columns[0]), dot(row, columns[1]), dot(row, columns[2])]);
}

/* The rotation by `angle` about a coordinate axis (0, 1, 2 for x, y, z), counter-clockwise for a right-handed frame. */
export function rotation(axis, angle) {
  const i = (axis + 1) % 3, j = (axis + 2) % 3, cos = Math.cos(angle), sin = Math.sin(angle);
  const R = [[0, 0, 0], [0, 0, 0], [0, 0, 0]];
  R[axis][axis] = 1;
  R[i][i] = R[j][j] = cos;
  R[i][j] = -sin;
  R[j][i] = sin;
  return R;
}

/* A sphere around points: the centre of their box, and the distance to the farthest one, at least `minRadius`. */
export function boundingSphere(points, minRadius) {
  const low = [0, 1, 2].map((i) => points.reduce((least, p) => Math.min(least, p[i]), Infinity));
  const high = [0, 1, 2].map((i) => points.reduce((most, p) => Math.max(most, p[i]), -Infinity));
  const center = times(add(low, high), 0.5);
  return { center, radius: points.reduce((most, p) => Math.max(most, length(minus(p, center))), minRadius) };
}
