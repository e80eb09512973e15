/* The bones and joints of a body as lines and discs. */

import { colourOf, GREY } from "./shading.js";

/* Draw a body (joints, skeleton.joints, startOf, tips), the farthest joint first. The joints in the set body.guesses
   are hollow: white, with a rim in their colour.
   `pixel` gives of a point in mm [px to the right, px down, mm away]. */
export function drawBones(pen, body, pixel) {
  const pixels = body.joints.map(pixel), { skeleton } = body, tips = new Set(body.tips);
  const order = [...skeleton.joints.keys()].sort((i, j) => pixels[j][2] - pixels[i][2]);
  pen.lineCap = "round";
  for (const j of order) {
    const from = body.startOf(j), [u, v] = pixels[j];
    const colour = `rgb(${(colourOf(skeleton.joints[j]) ?? GREY).join(" ")})`;
    const [rim, inside] = body.guesses?.has(j) ? [colour, "white"] : ["rgb(20 24 32 / 0.55)", colour];
    for (const [style, wide] of [[rim, 2], [inside, 0]]) {
      pen.strokeStyle = pen.fillStyle = style;
      pen.lineWidth = 2.5 + wide;
      if (from) line(pen, pixel(from), pixels[j]);
      disc(pen, u, v, (tips.has(j) ? 4.5 : 3) + wide / 2);
    }
  }
}

export function line(pen, [x, y], [u, v]) {
  pen.beginPath();
  pen.moveTo(x, y);
  pen.lineTo(u, v);
  pen.stroke();
}

function disc(pen, x, y, radius) {
  pen.beginPath();
  pen.arc(x, y, radius, 0, 2 * Math.PI);
  pen.fill();
}
