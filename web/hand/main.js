/* The page: one body, and all that shows it. */

import { askForHeight } from "./embedding.js";
import { Body } from "./body.js";
import { byId, element, shown } from "./elements.js";
import { inputsOf, asDofs, asInputs } from "./pose_text.js";
import { renderCrop } from "./crop.js";
import { parse } from "./prototxt.js";
import { showDepth, showForces, showJoints, showLimits } from "./panels.js";
import { Sliders } from "./sliders.js";
import { Stage } from "./stage.js";
import { length } from "./vectors.js";

const MAX_FILE_BYTES = 5e6; // of a skeleton file
const data = JSON.parse(byId("data").textContent);
const { skeleton: packaged } = data;
const body = new Body(packaged.text, packaged.source, data.place);
const boxes = ["surface", "skeleton", "points", "names", "initial", "all"].map((name) => [name, byId(`show-${name}`)]);
const shows = Object.fromEntries(boxes);
const chooseForced = showForces(body);
const stage = new Stage(byId("stage"), body, shows, (joint) => {
  const at = joint === null ? "" : body.joints[joint].map((mm) => shown(mm, 1)).join(", ");
  const force = joint === null ? 0 : length(body.forces[joint]);
  const pushed = force ? `, ${shown(force, 2)} N` : "";
  byId("under").textContent = joint === null ? "" : `${body.skeleton.joints[joint]}: ${at} mm${pushed}`;
  if (force) chooseForced(joint);
});
const sliders = new Sliders(byId("sliders"), body);
showJoints(body);
showDepth(body, data.cameras);
showLimits(body);

/* ------------------------------------------------------------------------------------------------ poses */

const isFree = (d) => !body.whole.fixed[d];
const isLimited = (d) => isFree(d) && body.whole.limits(d).every(Number.isFinite);
const ofAll = (value, which) => Object.fromEntries(
  [...body.whole.dofs.keys()].filter(which).map((d) => [d, value(d)]),
);

byId("initial").addEventListener("click", () => body.move(ofAll(() => 0, isFree)));
byId("random").addEventListener("click", () => {
  const { lower, upper } = body.whole;
  body.move(ofAll((d) => lower[d] + Math.random() * (upper[d] - lower[d]), isLimited));
});

function offerPoses() {
  const known = ([, inputs]) => Object.keys(inputs).every((name) => body.skeleton.dofs.includes(name));
  const values = (inputs) => Object.entries(inputs).map(([name, value]) => [body.skeleton.dofs.indexOf(name), value]);
  byId("poses").replaceChildren(...Object.entries(data.poses).filter(known).map(([name, inputs]) => {
    const onclick = () => body.move(Object.fromEntries(values(inputs)));
    return element("button", { type: "button", onclick }, name.replaceAll("_", " "));
  }));
}

/* ------------------------------------------------------------------------------------------------ the pose as text */

const line = byId("pose"), form = byId("pose-form"), fault = byId("pose-fault");
const write = () => (form.value === "prototxt" ? asDofs(body) : asInputs(body));
const showPose = () => {
  if (document.activeElement !== line) line.value = write();
};
form.addEventListener("change", () => (line.value = write()));
line.addEventListener("input", () => {
  try {
    body.move(inputsOf(line.value, body));
    fault.textContent = "";
  } catch (error) {
    fault.textContent = error.message;
  }
});
line.addEventListener("blur", () => {
  if (!fault.textContent) line.value = write();
});
byId("copy").addEventListener("click", async () => {
  line.value = write();
  fault.textContent = "";
  line.select();
  const copied = await navigator.clipboard?.writeText(line.value).then(() => true, () => false);
  byId("copied").textContent = copied || document.execCommand("copy") ? "copied" : "selected: copy with Ctrl-C";
  setTimeout(() => (byId("copied").textContent = ""), 2000);
});

/* ------------------------------------------------------------------------------------------------ skeletons, hands */

const fileFault = byId("fault"), hands = byId("hands"), bodies = byId("bodies");

function openText(text, source, place = data.place) {
  try {
    body.open(text, source);
    const { camera, center_uvd: uvd, cube_mm: cube, unit_mm: unit } = place;
    Object.assign(body, { camera, uvd, cube, unit, seen: null });
    shows.initial.checked = !body.surface; // lines alone say less of what has moved
    body.changed("skeleton");
    fileFault.textContent = "";
    hands.value = bodies.value = "";
  } catch (error) {
    fileFault.textContent = error.message;
  }
}

async function openFile(file) {
  if (!file) return;
  if (file.size > MAX_FILE_BYTES) fileFault.textContent = `${file.name}: ${file.size} bytes; expected a skeleton file`;
  else openText(await file.text(), file.name);
}

/* One of the page's own bodies. */
function showBody(name) {
  const { skeleton, place } = data.bodies.find((one) => one.name === name) ?? data;
  openText(skeleton.text, skeleton.source, place);
  bodies.value = name;
}

/* What the address asks for, as a book links to it: #body=arm&shoulder=53.13&elbow=36.87&force=wrist,1,2,0
   Angles are in degrees and lengths in mm, as at the sliders; forces in N. What is unknown is passed by. */
function showAddress() {
  const asked = new URLSearchParams(location.hash.slice(1)), name = asked.get("body");
  if (data.bodies.some((one) => one.name === name)) showBody(name);
  const { dofs } = body.skeleton, known = [...asked].filter(([key, value]) => dofs.includes(key) && isNumber(value));
  body.move(Object.fromEntries(known.map(([key, value]) => {
    const d = dofs.indexOf(key);
    return [d, Number(value) / sliders.scale(d)];
  })));
  for (const text of asked.getAll("force")) {
    const [joint, ...force] = text.split(","), j = body.skeleton.joints.indexOf(joint);
    if (j < 0 || force.length !== 3 || !force.every(isNumber)) continue;
    body.push(j, force.map(Number));
    chooseForced(j);
  }
}

const isNumber = (text) => text !== "" && Math.abs(Number(text)) < 1e6;

/* A hand that was predicted, with what the camera saw of it. */
function showHand(hand) {
  body.open(packaged.text, packaged.source);
  const { side, size, thickness } = hand, { camera, center_uvd: uvd, cube_mm: cube } = hand.place;
  const points = Float64Array.from(integers(hand.points), (value) => value * hand.step_mm);
  const seen = Float64Array.from(integers(hand.crop), (value) => value / 32767);
  Object.assign(body, { side, size, thickness, points, seen, camera, uvd, cube, unit: hand.place.unit_mm });
  hand.inputs.forEach((value, d) => (body.inputs[d] = value));
  byId("said").textContent = hand.words;
  body.changed("skeleton");
}

/* 16-bit numbers from base64, the low byte first. */
function integers(text) {
  const bytes = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
  return new Int16Array(bytes.buffer);
}

byId("file").addEventListener("change", (event) => {
  openFile(event.target.files[0]);
  event.target.value = ""; // so that the same file can be opened again
});
byId("packaged").addEventListener("click", () => showBody(""));
bodies.addEventListener("change", () => showBody(bodies.value));
addEventListener("hashchange", showAddress);
for (const name of ["dragover", "drop"]) document.addEventListener(name, (event) => event.preventDefault());
document.addEventListener("drop", (event) => openFile(event.dataTransfer.files[0]));
byId("show-fixed").addEventListener("change", (event) => sliders.showFixed(event.target.checked));
byId("mirror").addEventListener("change", (event) => body.change({ side: event.target.checked ? "left" : "right" }));
byId("reset").addEventListener("click", () => stage.reset());
hands.addEventListener("change", () => hands.value !== "" && showHand(data.hands[hands.value]));

body.listeners.push((what) => {
  if (what === "skeleton") {
    offerPoses();
    byId("points-label").hidden = !body.points;
    byId("mirror").checked = body.side === "left";
    if (!body.points) byId("said").textContent = "";
  }
  const { skeleton } = body, free = skeleton.fixed.filter((fixed) => !fixed).length;
  const counts = `${skeleton.joints.length} joints, ${free} of ${skeleton.dofs.length} DoFs free`;
  byId("name").textContent = `${skeleton.name || body.source}: ${counts}`;
  showPose();
});
hands.append(...data.hands.map((hand, i) => element("option", { value: i }, hand.name)));
byId("hands-label").hidden = !data.hands.length;
bodies.append(...data.bodies.map(({ name }) => element("option", { value: name }, name)));
byId("bodies-label").hidden = !data.bodies.length;
byId("packaged").hidden = data.bodies.length > 0; // it is one of them
if (data.hands.length) {
  hands.value = 0;
  showHand(data.hands[0]);
} else {
  body.changed("skeleton");
  bodies.value = data.bodies[0]?.name ?? "";
  showAddress();
}

askForHeight();

// For the console, and for tests.
globalThis.hand = { Body, asDofs, asInputs, body, data, inputsOf, parse, renderCrop, stage };
