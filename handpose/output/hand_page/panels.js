/* The tables next to the picture: joints, depth image, limits and forces. */

import { byId, element, formatNumber } from "./elements.js";
import { normalised, renderCrop, SIZE } from "./render.js";
import { paintDepth } from "./shading.js";
import { length } from "./vectors.js";

const MAX_DISTANCE = 1e5; // mm

/* The table of joints, in mm from the camera and as HandModel outputs them. */
export function showJoints(body) {
  const rows = byId("joints"), cells = [];
  const build = () => {
    cells.length = 0;
    rows.replaceChildren(...body.skeleton.joints.map((name) => {
      const own = Array.from({ length: 6 }, () => element("td"));
      cells.push(own);
      return element("tr", {}, element("th", { scope: "row" }, name), ...own);
    }));
  };
  const update = () => {
    const { joints, outputs } = body;
    cells.forEach((own, j) => own.forEach((cell, i) => {
      cell.textContent = i < 3 ? formatNumber(joints[j][i], 1) : formatNumber(outputs[j][i - 3], 4);
    }));
  };
  body.listeners.push((what) => {
    if (what === "skeleton") build();
    if (what !== "force") update();
  });
  build();
  update();
}

/* The crop of the body that a network would receive, next to the recorded crop, and the choice of the camera. */
export function showDepth(body, cameras) {
  const canvas = byId("depth"), hoverText = byId("depth-hover"), choice = byId("camera"), distance = byId("distance");
  let depth = null, frameRequest;
  const update = () => {
    const { uvd, cube, camera, recordedCrop } = body;
    depth = renderCrop(body.capsules, uvd, cube, camera);
    drawDepth(canvas, normalised(depth, uvd, cube));
    byId("recorded-figure").hidden = !recordedCrop;
    if (recordedCrop) drawDepth(byId("recorded"), recordedCrop);
    byId("no-surface").hidden = Boolean(body.surface);
    byId("depth-figure").hidden = !body.surface;
    const names = [...new Set([...cameras, camera].map((one) => one.name))];
    choice.replaceChildren(...names.map((name) => element("option", { selected: name === camera.name }, name)));
    if (document.activeElement !== distance) distance.value = formatNumber(uvd[2], 0);
    const [u, v] = uvd.map((value) => formatNumber(value, 0));
    byId("cube").textContent = `${formatNumber(cube, 0)} mm about u ${u}, v ${v}`;
  };
  canvas.addEventListener("pointermove", (event) => {
    const { width, height } = canvas.getBoundingClientRect();
    const column = Math.floor((event.offsetX / width) * SIZE), row = Math.floor((event.offsetY / height) * SIZE);
    const mm = depth[row * SIZE + column];
    hoverText.textContent = mm === undefined ? "" : `column ${column}, row ${row}: ${formatNumber(mm, 1)} mm`;
  });
  canvas.addEventListener("pointerleave", () => (hoverText.textContent = ""));
  choice.addEventListener("change", () => {
    const camera = cameras.find((one) => one.name === choice.value);
    if (camera) body.change({ camera, uvd: [camera.u0, camera.v0, body.uvd[2]] });
  });
  distance.addEventListener("change", () => {
    const mm = Number(distance.value);
    if (mm > 0 && mm < MAX_DISTANCE) body.change({ uvd: [body.uvd[0], body.uvd[1], mm] });
  });
  body.listeners.push((what) => {
    if (what !== "force") frameRequest ??= requestAnimationFrame(() => ((frameRequest = undefined), update()));
  });
  update();
}

function drawDepth(canvas, values) {
  const pen = canvas.getContext("2d"), picture = pen.createImageData(SIZE, SIZE);
  paintDepth(picture, values);
  pen.putImageData(picture, 0, 0);
}

/* The loss of PhysLimit: how far the pose is beyond the limits of the body. */
export function showLimits(body) {
  const update = () => {
    const { L1, L2 } = body.limitLoss, output = byId("limit-loss");
    output.textContent = `limit loss ${formatNumber(L1, 4)} (L1), ${formatNumber(L2, 4)} (L2)`;
    output.classList.toggle("beyond", L1 > 0);
  };
  body.listeners.push(update);
  update();
}

/* Three input fields for the force on a joint, as an alternative to dragging. Returns a function that selects it. */
export function showForces(body) {
  const joint = byId("force-joint"), fields = ["x", "y", "z"].map((axis) => byId(`force-${axis}`));
  const build = () => {
    joint.replaceChildren(...body.skeleton.joints.map((name, j) => element("option", { value: j }, name)));
    joint.value = body.tips[0];
  };
  const update = () => {
    const force = body.forces[joint.value];
    fields.forEach((field, i) => {
      if (document.activeElement !== field) field.value = formatNumber(force[i], 2);
    });
    const count = body.forces.filter((one) => length(one) > 0).length, joints = count > 1 ? "joints" : "joint";
    const note = `${formatNumber(length(force), 2)} N here; forces on ${count} ${joints}`;
    byId("force-note").textContent = count ? note : "";
  };
  for (const field of fields) {
    field.addEventListener("input", () => {
      const force = fields.map((one) => Number(one.value));
      if (force.every(Number.isFinite)) body.applyForce(Number(joint.value), force);
    });
  }
  joint.addEventListener("change", update);
  byId("no-force").addEventListener("click", () => body.clearForces());
  body.listeners.push((what) => {
    if (what === "skeleton") build();
    if (what === "skeleton" || what === "force") update();
  });
  build();
  update();
  return (selected) => {
    joint.value = selected;
    update();
  };
}
