/* The hand page: one body, the parts of the page that show it, and the choice of bodies, predicted hands and poses. */

import { Body } from "./body.js";
import { BodyView } from "./body_view.js";
import { byId, element, formatNumber, reportHeight } from "./elements.js";
import { inputsOfText, MAX_INPUT, textOfPose } from "./pose_text.js";
import { cropPoints, renderCrop } from "./render.js";
import { showDepth, showForces, showJoints, showLimits } from "./panels.js";
import { Sliders } from "./sliders.js";
import { length } from "./vectors.js";

const data = JSON.parse(byId("data").textContent);
const body = new Body(data.bodies[0]);
const checkboxes = Object.fromEntries(
  ["surface", "skeleton", "points", "names", "initial", "all"].map((name) => [name, byId(`show-${name}`)]),
);
const selectForce = showForces(body);
const view = new BodyView(byId("view"), body, checkboxes, (joint) => {
  const force = joint === null ? 0 : length(body.forces[joint]);
  const position = joint === null ? "" : body.joints[joint].map((mm) => formatNumber(mm, 1)).join(", ");
  const forceText = force ? `, ${formatNumber(force, 2)} N` : "";
  byId("hover").textContent = joint === null ? "" : `${body.skeleton.joints[joint]}: ${position} mm${forceText}`;
  if (force) selectForce(joint);
});
const sliders = new Sliders(byId("sliders"), body);
showJoints(body);
showDepth(body, data.cameras);
showLimits(body);

/* ------------------------------------------------------------------------------------------------ poses */

/* Set the inputs of all free DoFs that `isChosen` accepts. */
function setFreeInputs(value, isChosen = () => true) {
  const chosen = [...body.whole.dofs.keys()].filter((d) => !body.whole.fixed[d] && isChosen(d));
  body.setInputs(Object.fromEntries(chosen.map((d) => [d, value(d)])));
}

byId("initial").addEventListener("click", () => setFreeInputs(() => 0));
byId("random").addEventListener("click", () => {
  const { lower, upper } = body.whole;
  const isLimited = (d) => Number.isFinite(lower[d]) && Number.isFinite(upper[d]);
  setFreeInputs((d) => lower[d] + Math.random() * (upper[d] - lower[d]), isLimited);
});

/* Set inputs by the names of their DoFs. */
function setNamedInputs(named) {
  body.setInputs(Object.fromEntries(named.map(([name, value]) => [body.skeleton.dofs.indexOf(name), value])));
}

function showPoseButtons({ poses }) {
  byId("poses").replaceChildren(...Object.entries(poses).map(([name, inputs]) => {
    const onclick = () => setNamedInputs(Object.entries(inputs));
    return element("button", { type: "button", onclick }, name.replaceAll("_", " "));
  }));
}

/* ------------------------------------------------------------------------------------------------ the pose as text */

const poseField = byId("pose"), poseError = byId("pose-error");

function showPose() {
  poseField.value = textOfPose(body);
  poseError.textContent = "";
}

poseField.addEventListener("input", () => {
  try {
    body.setInputs(inputsOfText(poseField.value, body));
    poseError.textContent = "";
  } catch (error) {
    poseError.textContent = error.message;
  }
});
poseField.addEventListener("blur", () => {
  if (!poseError.textContent) showPose();
});
byId("copy").addEventListener("click", async () => {
  showPose();
  poseField.select();
  const copied = await navigator.clipboard?.writeText(poseField.value).then(() => true, () => false);
  byId("copied").textContent = copied || document.execCommand("copy") ? "copied" : "selected: copy with Ctrl-C";
  setTimeout(() => (byId("copied").textContent = ""), 2000);
});

/* ------------------------------------------------------------------------------------------------ bodies, hands */

const hands = byId("hands"), bodies = byId("bodies");

function showBody(name) {
  const values = data.bodies.find((one) => one.name === name) ?? data.bodies[0];
  bodies.value = values.name;
  showPoseButtons(values);
  body.open(values);
  checkboxes.initial.checked = !body.surface; // a pose without a surface is easier to see next to the initial one
  byId("description").textContent = "";
}

/* Show a predicted hand, with the depth that the camera recorded. */
function showHand(hand) {
  const [{ skeleton }] = data.bodies;
  body.open({ skeleton, place: hand.place });
  const { side, size, thickness } = hand;
  const bytes = Uint8Array.from(atob(hand.crop), (character) => character.charCodeAt(0));
  const recordedCrop = Float64Array.from(new Int16Array(bytes.buffer), (value) => value / 32767);
  const points = cropPoints(recordedCrop, body.uvd, body.cube, body.camera);
  Object.assign(body, { side, size, thickness, points, recordedCrop });
  hand.inputs.forEach((value, d) => (body.inputs[d] = value));
  byId("description").textContent = hand.words;
  showPoseButtons(data.bodies[0]);
  body.notify("skeleton");
}

/* Decode 16-bit numbers, low byte first, from base64. */
/* Show the chosen hand or, on a page without predicted hands, the chosen body, in its initial state. */
function showChosen() {
  if (data.hands.length) showHand(data.hands[hands.value]);
  else showBody(bodies.value);
}

/* Apply the fragment of the address, with which the book links to a pose:
   #body=arm&shoulder=53.13&elbow=36.87&force=wrist,1,2,0
   Angles are in degrees, lengths in mm and forces in N, as on the page. Unknown names and large numbers are ignored. */
function applyAddress() {
  const fields = new URLSearchParams(location.hash.slice(1)), name = fields.get("body");
  if (data.bodies.some((one) => one.name === name)) showBody(name);
  const { dofs, joints } = body.skeleton;
  const known = [...fields].filter(([key, value]) => dofs.includes(key) && isNumber(value));
  setNamedInputs(known.map(([key, value]) => [key, Number(value) / sliders.scale(dofs.indexOf(key))]));
  for (const text of fields.getAll("force")) {
    const [joint, ...force] = text.split(","), j = joints.indexOf(joint);
    if (j < 0 || force.length !== 3 || !force.every(isNumber)) continue;
    body.applyForce(j, force.map(Number));
    selectForce(j);
  }
}

const isNumber = (text) => text !== "" && Math.abs(Number(text)) < MAX_INPUT;

bodies.addEventListener("change", () => showBody(bodies.value));
hands.addEventListener("change", showChosen);
byId("restart").addEventListener("click", showChosen);
addEventListener("hashchange", applyAddress);
byId("show-fixed").addEventListener("change", (event) => sliders.showFixed(event.target.checked));
byId("mirror").addEventListener("change", (event) => body.change({ side: event.target.checked ? "left" : "right" }));
byId("reset").addEventListener("click", () => view.reset());

body.listeners.push((what) => {
  const { skeleton } = body, free = skeleton.fixed.filter((fixed) => !fixed).length;
  if (what === "skeleton") {
    byId("points-label").hidden = !body.points;
    byId("mirror").checked = body.side === "left";
    const counts = `${skeleton.joints.length} joints, ${free} of ${skeleton.dofs.length} DoFs free`;
    byId("name").textContent = `${skeleton.name}: ${counts}`;
  }
  if (document.activeElement !== poseField) showPose();
});
hands.append(...data.hands.map((hand, i) => element("option", { value: i }, hand.name)));
byId("hands-label").hidden = !data.hands.length;
bodies.append(...data.bodies.map(({ name }) => element("option", { value: name }, name)));
byId("bodies-label").hidden = data.bodies.length < 2;
showChosen();
if (!data.hands.length) applyAddress();

reportHeight();

// for the console and the tests
globalThis.hand = { Body, body, cropPoints, data, inputsOfText, renderCrop, textOfPose, view };
