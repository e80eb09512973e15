/* The live page: it shows the newest frame of the tracker. */

import { BodyView } from "./body_view.js";
import { Confidence } from "./confidence.js";
import { DepthView } from "./depth_view.js";
import { byId, formatNumber } from "./elements.js";
import { Scene } from "./scene.js";
import { takeQuery } from "./token.js";
import { add, length, minus, times } from "./vectors.js";

const FOLLOW_S = 0.3; // time constant with which the view follows the hands
const RATE_S = 2; // time over which frames per second are counted
const CAPSULE_NUMBERS = 8; // numbers of a capsule in a message
const data = JSON.parse(byId("data").textContent), state = byId("state");
const scene = new Scene(data);
const checkboxes = Object.fromEntries(
  ["surface", "skeleton", "points", "names"].map((name) => [name, byId(`show-${name}`)]),
);
const view = new BodyView(byId("view"), scene, checkboxes, (joint) => {
  const position = joint === null ? undefined : scene.joints[joint];
  const text = position?.map((mm) => formatNumber(mm, 1)).join(", ");
  byId("joint").textContent = position ? `${scene.skeleton.joints[joint]}: ${text} mm` : "";
});
const depth = new DepthView(byId("depth"), data, (text) => (byId("hover").textContent = text));
const confidence = new Confidence(byId("curves"), byId("hands"), data.colours);
let frameRequest = null, lastTime = null, arrivals = [], endReason = null;

byId("reset").addEventListener("click", () => view.reset());

/* Decode a frame from a message of handpose/output/live/messages.py: {record, middle, spread, window, grid,
   depth (Uint16Array), surfaces (per hand a list of capsules {a, b, ra, rb})}. */
function frameOf(buffer) {
  const size = new DataView(buffer).getUint32(0, true);
  const { capsules, ...values } = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
  const [left, top, width, height] = values.window, [gridLeft, gridTop, step, columns, rows] = values.grid;
  const window = { left, top, width, height }, grid = { left: gridLeft, top: gridTop, step, columns, rows };
  const samples = columns * rows;
  const numbers = new Float32Array(buffer, 4 + size + 2 * (samples + (samples % 2)));
  let first = 0;
  const surfaces = capsules.map((count) => Array.from({ length: count }, () => {
    const [ax, ay, az, bx, by, bz, ra, rb] = numbers.subarray(first, (first += CAPSULE_NUMBERS));
    return { a: [ax, ay, az], b: [bx, by, bz], ra, rb };
  }));
  return { ...values, window, grid, depth: new Uint16Array(buffer, 4 + size, samples), surfaces };
}

/* Move the centre of the view, without rotating or zooming, so that the hands stay in it. */
function follow(time) {
  if (lastTime === null) view.reset();
  const { camera } = view, { center, radius } = scene.bounds, offset = minus(center, camera.center);
  const part = 1 - Math.exp(-Math.abs(time - (lastTime ?? time)) / FOLLOW_S);
  const outside = Math.max(length(offset) + radius - 1.4 * camera.radius, 0); // mm by which the hands leave the view
  const move = outside && part * Math.min(outside / Math.max(length(offset), 1), 1);
  camera.center = add(camera.center, times(offset, move));
  if (radius > camera.radius) camera.radius += part * (radius - camera.radius);
  lastTime = time;
}

function draw() {
  const { frame } = live, { record } = frame;
  if (scene.show(frame)) follow(record.time_s);
  if (view.hovered >= scene.joints.length) view.hovered = null;
  depth.draw(frame, scene);
  confidence.show(record);
  live.drawn++;
  showState(record);
}

function showState(record) {
  const place = `frame ${record.number}, ${formatNumber(record.time_s, 2)} s`;
  if (endReason !== null) {
    state.textContent = `${endReason}; the last frame is ${record.number}`;
  } else {
    const now = performance.now() / 1000;
    arrivals = [...arrivals.filter((time) => time > now - RATE_S), now];
    const rate = arrivals.length > 1 ? (arrivals.length - 1) / (now - arrivals[0]) : 0;
    state.textContent = `${place}; ${formatNumber(rate, 0)} frames/s shown here`;
  }
}

/* Draw the frame in the next animation frame. */
function requestDraw(frame) {
  live.frame = frame;
  frameRequest ??= requestAnimationFrame(() => ((frameRequest = null), draw()));
}

const address = new URL(data.stream + takeQuery(), location.href);
address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
const socket = new WebSocket(address);
socket.binaryType = "arraybuffer";
const live = { drawn: 0, frame: null, scene, view };
socket.addEventListener("open", () => (state.textContent = "connected; no frame yet"));
socket.addEventListener("message", (event) => {
  requestDraw(frameOf(event.data));
  socket.send("next"); // the server answers with the newest frame and drops those before it
});
socket.addEventListener("close", ({ code, reason }) => {
  endReason = reason || (code === 1006 ? "no connection to the tracker" : `closed (${code})`);
  state.classList.add("over");
  state.textContent = endReason;
  if (live.frame) showState(live.frame.record);
});

globalThis.live = live; // for the console and the tests
