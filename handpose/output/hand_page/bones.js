/* Draws the bones and joints of a body as lines and discs. */

import { colourOf, GREY } from "./shading.js";

/* Draw a body, which has joints, skeleton.joints, boneStart() and tips, the farthest joint first. Joints in the set
   body.guesses are hollow: white, with a rim in their colour.
   project(point) converts a point in mm to [px to the right, px down, mm away]. */
export function drawBones(pen, body, project) {
  const pixels = body.joints.map(project), { skeleton } = body, tips = new Set(body.tips);
  const order = [...skeleton.joints.keys()].sort((i, j) => pixels[j][2] - pixels[i][2]);
  pen.lineCap = "round";
  for (const j of order) {
    const start = body.boneStart(j), [u, v] = pixels[j];
    const colour = `rgb(${(colourOf(skeleton.joints[j]) ?? GREY).join(" ")})`;
    const [rim, inside] = body.guesses?.has(j) ? [colour, "white"] : ["rgb(20 24 32 / 0.55)", colour];
    for (const [style, rimWidth] of [[rim, 2], [inside, 0]]) {
      pen.strokeStyle = pen.fillStyle = style;
      pen.lineWidth = 2.5 + rimWidth;
      if (start) drawLine(pen, project(start), pixels[j]);
      drawDisc(pen, u, v, (tips.has(j) ? 4.5 : 3) + rimWidth / 2);
    }
  }
}

export function drawLine(pen, [x, y], [u, v]) {
  pen.beginPath();
  pen.moveTo(x, y);
  pen.lineTo(u, v);
  pen.stroke();
}

function drawDisc(pen, x, y, radius) {
  pen.beginPath();
  pen.arc(x, y, radius, 0, 2 * Math.PI);
  pen.fill();
}
