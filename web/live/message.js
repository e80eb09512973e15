/* A frame from the server's binary message, as handpose/output/live/messages.py writes it. */

const PER_CAPSULE = 8; // numbers

/* {record, middle, spread, depth: Uint16Array, surfaces: per hand [{a, b, ra, rb}]} of an ArrayBuffer. */
export function frameOf(buffer, columns, rows) {
  const size = new DataView(buffer).getUint32(0, true), samples = columns * rows;
  const { record, middle, spread, capsules } = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
  const depth = new Uint16Array(buffer, 4 + size, samples);
  const numbers = new Float32Array(buffer, 4 + size + 2 * (samples + (samples % 2)));
  let first = 0;
  const surfaces = capsules.map((count) => Array.from({ length: count }, () => {
    const [ax, ay, az, bx, by, bz, ra, rb] = numbers.subarray(first, (first += PER_CAPSULE));
    return { a: [ax, ay, az], b: [bx, by, bz], ra, rb };
  }));
  return { record, middle, spread, depth, surfaces };
}
