/* The page: one body, and all that shows it. */

import { Body } from "./body.js";
import { byId, element, shown } from "./elements.js";
import { inputsOf, asDofs, asInputs } from "./pose_text.js";
import { renderCrop } from "./crop.js";
import { parse } from "./prototxt.js";
import { showDepth, showForces, showJoints, showLimits } from "./panels.js";
import { Sliders } from "./sliders.js";
import { Stage } from "./stage.js";
import { length } from "./vectors.js";

const LARGEST_FILE = 5e6; // bytes of a skeleton file
const data = JSON.parse(byId("data").textContent);
const { skeleton: packaged } = data;
const body = new Body(packaged.text, packaged.source, data.place);
const boxes = ["flesh", "skeleton", "points", "names", "all"].map((name) => [name, byId(`show-${name}`)]);
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

const told = byId("fault"), hands = byId("hands");

function openText(text, source) {
  try {
    body.open(text, source);
    const { camera, center_uvd: uvd, cube_mm: cube, unit_mm: unit } = data.place;
    Object.assign(body, { camera, uvd, cube, unit, seen: null });
    body.changed("skeleton");
    told.textContent = "";
    hands.value = "";
  } catch (error) {
    told.textContent = error.message;
  }
}

async function openFile(file) {
  if (!file) return;
  if (file.size > LARGEST_FILE) told.textContent = `${file.name}: ${file.size} bytes; expected a skeleton file`;
  else openText(await file.text(), file.name);
}

/* A hand that was predicted, with what the camera saw of it. */
function showHand(hand) {
  body.open(packaged.text, packaged.source);
  const { side, size, girth } = hand, { camera, center_uvd: uvd, cube_mm: cube } = hand.place;
  const points = Float64Array.from(integers(hand.points), (value) => value * hand.step_mm);
  const seen = Float64Array.from(integers(hand.crop), (value) => value / 32767);
  Object.assign(body, { side, size, girth, points, seen, camera, uvd, cube, unit: hand.place.unit_mm });
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
byId("packaged").addEventListener("click", () => openText(packaged.text, packaged.source));
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
if (data.hands.length) {
  hands.value = 0;
  showHand(data.hands[0]);
} else {
  body.changed("skeleton");
}

// For the console, and for tests.
globalThis.hand = { Body, asDofs, asInputs, body, data, inputsOf, parse, renderCrop, stage };
