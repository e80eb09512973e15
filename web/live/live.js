/* The live page: every frame as it comes, the newest one only; and frame by frame while it is paused. */

import { Confidence } from "./confidence.js";
import { DepthView } from "./depth_view.js";
import { byId, shown } from "./elements.js";
import { History } from "./history.js";
import { frameOf } from "./message.js";
import { Scene } from "./scene.js";
import { Stage } from "./stage.js";
import { takeQuery } from "./token.js";
import { add, length, minus, times } from "./vectors.js";

const FOLLOW_S = 0.3; // in which most of a move of what is shown is made
const RATE_S = 2; // over which frames per second are counted
const data = JSON.parse(byId("data").textContent), state = byId("state");
const scene = new Scene(data);
const layers = ["surface", "skeleton", "points", "names"];
const shows = Object.fromEntries(layers.map((name) => [name, byId(`show-${name}`)]));
const stage = new Stage(byId("stage"), scene, shows, (joint) => {
  const place = joint === null ? undefined : scene.joints[joint];
  const at = place?.map((mm) => shown(mm, 1)).join(", ");
  byId("joint").textContent = place ? `${scene.skeleton.joints[joint]}: ${at} mm` : "";
});
const depth = new DepthView(byId("depth"), data, (words) => (byId("under").textContent = words));
const confidence = new Confidence(byId("curves"), byId("hands"), data.colours);
const live = { data, depth, drawn: 0, frame: null, scene, stage };
let waiting = null, seen = null, arrivals = [], ended = null;

byId("reset").addEventListener("click", () => stage.reset());

/* Keep the hands in sight, without turning or zooming. */
function follow(time) {
  if (seen === null) stage.reset();
  const { viewer } = stage, { middle, reach } = scene.bounds, off = minus(middle, viewer.middle);
  const part = 1 - Math.exp(-Math.abs(time - (seen ?? time)) / FOLLOW_S);
  const out = Math.max(length(off) + reach - 1.4 * viewer.reach, 0); // that is out of sight
  if (out) viewer.middle = add(viewer.middle, times(off, part * Math.min(out / Math.max(length(off), 1), 1)));
  if (reach > viewer.reach) viewer.reach += part * (reach - viewer.reach);
  seen = time;
}

function draw() {
  const { frame } = live, { record } = frame;
  if (scene.show(frame)) follow(record.time_s);
  if (stage.hovered >= scene.joints.length) stage.hovered = null;
  depth.draw(frame, scene);
  confidence.show(record);
  live.drawn++;
  const place = `frame ${record.number}, ${shown(record.time_s, 2)} s`;
  if (ended !== null) {
    state.textContent = kept.paused ? `${place}; ${ended}` : `${ended}; the last frame is ${record.number}`;
  } else if (kept.paused) {
    state.textContent = `${place}; paused`;
  }
  if (ended !== null || kept.paused) return;
  const now = performance.now() / 1000;
  arrivals = [...arrivals.filter((time) => time > now - RATE_S), now];
  const rate = arrivals.length > 1 ? (arrivals.length - 1) / (now - arrivals[0]) : 0;
  state.textContent = `${place}; ${shown(rate, 0)} frames/s shown here`;
}

/* Draw the frame of the history that is to be shown, before the next picture of the screen. */
function show() {
  live.frame = kept.shown;
  if (live.frame) waiting ??= requestAnimationFrame(() => ((waiting = null), draw()));
}

const address = new URL(data.stream + takeQuery(), location.href);
address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
const socket = new WebSocket(address);
socket.binaryType = "arraybuffer";
const kept = new History((word) => socket.readyState === WebSocket.OPEN && socket.send(word), show);
live.kept = kept;
socket.addEventListener("open", () => (state.textContent = "connected; no frame yet"));
socket.addEventListener("message", (event) => {
  kept.add(frameOf(event.data));
  socket.send("next"); // the newest one then, whatever has come in between
});
socket.addEventListener("close", ({ code, reason }) => {
  ended = reason || (code === 1006 ? "no connection to the tracker" : `closed (${code})`);
  state.classList.add("over");
  state.textContent = live.frame ? `${ended}; the last frame is ${live.frame.record.number}` : ended;
});

// For the console, and for tests.
globalThis.live = live;
