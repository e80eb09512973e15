/* A frame from the server's binary message, as handpose/output/live/messages.py writes it. */

const PER_CAPSULE = 8; // numbers

/* {record, middle, spread, window, grid, depth: Uint16Array, surfaces: per hand [{a, b, ra, rb}]} of an ArrayBuffer. */
export function frameOf(buffer) {
  const size = new DataView(buffer).getUint32(0, true);
  const { capsules, ...values } = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
  const [left, top, width, height] = values.window, [first0, first1, step, columns, rows] = values.grid;
  const window = { left, top, width, height }, grid = { left: first0, top: first1, step, columns, rows };
  const samples = columns * rows;
  const depth = new Uint16Array(buffer, 4 + size, samples);
  const numbers = new Float32Array(buffer, 4 + size + 2 * (samples + (samples % 2)));
  let first = 0;
  const surfaces = capsules.map((count) => Array.from({ length: count }, () => {
    const [ax, ay, az, bx, by, bz, ra, rb] = numbers.subarray(first, (first += PER_CAPSULE));
    return { a: [ax, ay, az], b: [bx, by, bz], ra, rb };
  }));
  return { ...values, window, grid, depth, surfaces };
}
