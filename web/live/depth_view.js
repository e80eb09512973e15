/* The depth image, with the bones of all hands where the camera sees them. */

import { drawBones } from "./bones.js";
import { shown } from "./elements.js";
import { paintDepth } from "./shading.js";

const TAG = 20; // px of height

export class DepthView {
  /* tell is given a line on what is under the pointer */
  constructor(canvas, { camera, step, colours }, tell) {
    Object.assign(this, { canvas, camera, step, colours, frame: null });
    this.columns = Math.ceil(camera.width / step);
    this.rows = Math.ceil(camera.height / step);
    canvas.style.aspectRatio = `${camera.width} / ${camera.height}`;
    this.layer = document.createElement("canvas");
    Object.assign(this.layer, { width: this.columns, height: this.rows });
    this.brush = this.layer.getContext("2d");
    this.picture = this.brush.createImageData(this.columns, this.rows);
    this.values = new Float32Array(this.columns * this.rows);
    canvas.addEventListener("pointermove", ({ offsetX, offsetY }) => {
      const { width, height } = canvas.getBoundingClientRect();
      const u = Math.floor((offsetX / width) * this.columns), v = Math.floor((offsetY / height) * this.rows);
      const mm = this.frame?.depth[v * this.columns + u];
      tell(mm === undefined ? "" : `column ${u * step}, row ${v * step}: ${mm ? `${mm} mm` : "nothing read"}`);
    });
    canvas.addEventListener("pointerleave", () => tell(""));
  }

  draw(frame, scene) {
    this.frame = frame;
    const { canvas, camera, values } = this, { width } = canvas.getBoundingClientRect();
    const ratio = Math.max(devicePixelRatio, 1), zoom = width / camera.width;
    const size = { width: Math.round(width * ratio), height: Math.round(camera.height * zoom * ratio) };
    if (!size.width) return;
    if (canvas.width !== size.width || canvas.height !== size.height) Object.assign(canvas, size);
    frame.depth.forEach((mm, pixel) => {
      const away = (mm - frame.middle) / frame.spread;
      values[pixel] = mm ? away / (1 + Math.abs(away)) : 1; // steepest where the hands are
    });
    paintDepth(this.picture, values);
    this.brush.putImageData(this.picture, 0, 0);
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.drawImage(this.layer, 0, 0, width, camera.height * zoom);
    const pixel = ([x, y, z]) => {
      const mm = Math.max(z, 1); // of what is behind the camera, far beside the picture
      return [(camera.u0 + (camera.fx * x) / mm + 0.5) * zoom, (camera.v0 - (camera.fy * y) / mm + 0.5) * zoom, z];
    };
    drawBones(pen, scene, pixel);
    for (const hand of frame.record.hands) this.drawTag(pen, hand, hand.positions_mm.map(pixel));
  }

  /* Above a hand which one it is and how sure. */
  drawTag(pen, hand, pixels) {
    const words = spoken(hand), left = Math.min(...pixels.map(([u]) => u)), top = Math.min(...pixels.map(([, v]) => v));
    pen.font = "13px system-ui, sans-serif";
    const wide = pen.measureText(words).width + 12, x = Math.max(left, 0), y = Math.max(top - TAG - 8, 0);
    pen.fillStyle = `rgb(${this.colours[hand.id % this.colours.length].join(" ")})`;
    pen.fillRect(x, y, wide, TAG);
    pen.fillStyle = "white";
    pen.fillText(words, x + 6, y + 14);
  }
}

/* "right 93%"; no estimate is certain. */
export function spoken({ hand, confidence }) {
  const side = hand ?? "unknown";
  if (confidence === null) return side;
  return `${side} ${confidence >= 0.995 ? ">99%" : `${shown(100 * confidence, 0)}%`}`;
}
