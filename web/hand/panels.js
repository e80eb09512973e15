/* What is read beside the picture: the joints, the depth image, the limits, the forces. */

import { byId, element, shown } from "./elements.js";
import { normalised, renderCrop, SIZE } from "./crop.js";
import { paintDepth } from "./shading.js";
import { length } from "./vectors.js";

/* The joints in mm before the camera, and as HandModel answers. */
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
    const { joints, answer } = body;
    cells.forEach((own, j) => own.forEach((cell, i) => {
      cell.textContent = i < 3 ? shown(joints[j][i], 1) : shown(answer[j][i - 3], 4);
    }));
  };
  body.listeners.push((what) => {
    if (what === "skeleton") build();
    if (what !== "force") update();
  });
  build();
  update();
}

/* The crop that the network would see of the body, beside the one that it saw, and the camera. */
export function showDepth(body, cameras) {
  const canvas = byId("depth"), under = byId("depth-under"), choice = byId("camera"), far = byId("distance");
  let depth = null;
  const update = () => {
    const { uvd, cube, camera } = body;
    depth = renderCrop(body.capsules, uvd, cube, camera);
    draw(canvas, normalised(depth, uvd, cube));
    byId("seen-figure").hidden = !body.seen;
    if (body.seen) draw(byId("seen"), body.seen);
    byId("no-surface").hidden = Boolean(body.surface);
    byId("depth-figure").hidden = !body.surface;
    const names = [...new Set([...cameras, camera].map((one) => one.name))];
    choice.replaceChildren(...names.map((name) => element("option", { selected: name === camera.name }, name)));
    if (document.activeElement !== far) far.value = shown(uvd[2], 0);
    byId("cube").textContent = `${shown(cube, 0)} mm about u ${shown(uvd[0], 0)}, v ${shown(uvd[1], 0)}`;
  };
  canvas.addEventListener("pointermove", (event) => {
    const { width, height } = canvas.getBoundingClientRect();
    const i = Math.floor((event.offsetX / width) * SIZE), j = Math.floor((event.offsetY / height) * SIZE);
    const mm = depth[j * SIZE + i];
    under.textContent = mm === undefined ? "" : `column ${i}, row ${j}: ${shown(mm, 1)} mm`;
  });
  canvas.addEventListener("pointerleave", () => (under.textContent = ""));
  choice.addEventListener("change", () => {
    const camera = cameras.find((one) => one.name === choice.value);
    if (camera) body.look({ camera, uvd: [camera.u0, camera.v0, body.uvd[2]] });
  });
  far.addEventListener("change", () => {
    const mm = Number(far.value);
    if (mm > 0 && mm < 1e5) body.look({ uvd: [body.uvd[0], body.uvd[1], mm] });
  });
  let waiting;
  body.listeners.push((what) => {
    if (what !== "force") waiting ??= requestAnimationFrame(() => ((waiting = undefined), update()));
  });
  update();
}

function draw(canvas, values) {
  const pen = canvas.getContext("2d"), picture = pen.createImageData(SIZE, SIZE);
  paintDepth(picture, values);
  pen.putImageData(picture, 0, 0);
}

/* How far the pose is beyond what the body can do: the loss of PhysLimit. */
export function showLimits(body) {
  const update = () => {
    const { L1, L2 } = body.limitLoss, out = byId("limit-loss");
    out.textContent = `limit loss ${shown(L1, 4)} (L1), ${shown(L2, 4)} (L2)`;
    out.classList.toggle("beyond", L1 > 0);
  };
  body.listeners.push(update);
  update();
}

/* The force on one joint as three numbers, for who does not drag. */
export function showForces(body) {
  const joint = byId("force-joint"), numbers = ["x", "y", "z"].map((axis) => byId(`force-${axis}`));
  const build = () => {
    joint.replaceChildren(...body.skeleton.joints.map((name, j) => element("option", { value: j }, name)));
    joint.value = body.tips[0];
  };
  const update = () => {
    const force = body.forces[joint.value];
    numbers.forEach((number, i) => {
      if (document.activeElement !== number) number.value = shown(force[i], 2);
    });
    const pushed = body.forces.filter((f) => length(f) > 0).length, joints = pushed > 1 ? "joints" : "joint";
    const note = `${shown(length(force), 2)} N here; forces on ${pushed} ${joints}`;
    byId("force-note").textContent = pushed ? note : "";
  };
  for (const number of numbers) {
    number.addEventListener("input", () => {
      const force = numbers.map((n) => Number(n.value));
      if (force.every(Number.isFinite)) body.push(Number(joint.value), force);
    });
  }
  joint.addEventListener("change", update);
  byId("release").addEventListener("click", () => body.release());
  body.listeners.push((what) => {
    if (what === "skeleton") build();
    if (what === "skeleton" || what === "force") update();
  });
  build();
  update();
  return (pushed) => {
    joint.value = pushed;
    update();
  };
}
