/* The depth image, the part around the hands, with the bones of all hands where the camera sees them. */

import { drawBones } from "./bones.js";
import { shown } from "./elements.js";
import { paintDepth } from "./shading.js";

const TAG = 20; // px of height
const DARKEST = 0.65; // of the farthest depth, where 1 is black

export class DepthView {
  /* tell is given a line on what is under the pointer */
  constructor(canvas, { camera, colours }, tell) {
    Object.assign(this, { canvas, camera, colours, frame: null });
    canvas.style.aspectRatio = `${camera.width} / ${camera.height}`;
    this.layer = document.createElement("canvas");
    this.brush = this.layer.getContext("2d");
    canvas.addEventListener("pointermove", ({ offsetX, offsetY }) => {
      if (!this.frame) return;
      const { window, grid, depth } = this.frame, zoom = canvas.getBoundingClientRect().width / window.width;
      const column = Math.floor((window.left + offsetX / zoom - grid.left) / grid.step);
      const row = Math.floor((window.top + offsetY / zoom - grid.top) / grid.step);
      const mm = column >= 0 && column < grid.columns ? depth[row * grid.columns + column] : undefined;
      const place = `column ${grid.left + column * grid.step}, row ${grid.top + row * grid.step}`;
      tell(mm === undefined ? "" : `${place}: ${mm ? `${mm} mm` : "nothing read"}`);
    });
    canvas.addEventListener("pointerleave", () => tell(""));
  }

  draw(frame, scene) {
    this.frame = frame;
    const { canvas, camera } = this, { window, grid } = frame, { width } = canvas.getBoundingClientRect();
    const ratio = Math.max(devicePixelRatio, 1), zoom = width / window.width;
    const size = { width: Math.round(width * ratio), height: Math.round(window.height * zoom * ratio) };
    if (!size.width) return;
    if (canvas.width !== size.width || canvas.height !== size.height) Object.assign(canvas, size);
    this.paint(frame);
    const pen = canvas.getContext("2d"), scale = grid.step * zoom;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.drawImage(this.layer, (grid.left - window.left) * zoom, (grid.top - window.top) * zoom, grid.columns * scale,
      grid.rows * scale);
    const pixel = ([x, y, z]) => {
      const mm = Math.max(z, 1); // of what is behind the camera, far beside the picture
      const u = camera.u0 + (camera.fx * x) / mm + 0.5, v = camera.v0 - (camera.fy * y) / mm + 0.5;
      return [(u - window.left) * zoom, (v - window.top) * zoom, z];
    };
    drawBones(pen, scene, pixel);
    for (const hand of frame.record.hands) this.drawTag(pen, hand, hand.positions_mm.map(pixel));
  }

  /* The depth into the layer, a pixel for each sample. */
  paint({ depth, grid: { columns, rows }, middle, spread }) {
    const { layer } = this;
    if (layer.width !== columns || layer.height !== rows) Object.assign(layer, { width: columns, height: rows });
    const picture = this.brush.createImageData(columns, rows), values = new Float32Array(columns * rows);
    depth.forEach((mm, pixel) => {
      const away = (mm - middle) / spread;
      values[pixel] = mm ? DARKEST * away / Math.hypot(1, away) : 1; // steepest where the hands are
    });
    paintDepth(picture, values);
    this.brush.putImageData(picture, 0, 0);
  }

  /* Above a hand which one it is and how sure; in colour on white while its side is assumed. */
  drawTag(pen, hand, pixels) {
    const words = spoken(hand), left = Math.min(...pixels.map(([u]) => u)), top = Math.min(...pixels.map(([, v]) => v));
    pen.font = "13px system-ui, sans-serif";
    const wide = pen.measureText(words).width + 12, x = Math.max(left, 0), y = Math.max(top - TAG - 8, 0);
    const colour = `rgb(${this.colours[hand.id % this.colours.length].join(" ")})`;
    pen.fillStyle = hand.hand ? colour : "white";
    pen.fillRect(x, y, wide, TAG);
    pen.strokeStyle = colour;
    pen.lineWidth = 2;
    pen.strokeRect(x, y, wide, TAG);
    pen.fillStyle = hand.hand ? "white" : colour;
    pen.fillText(words, x + 6, y + 14);
  }
}

/* "right 93%", "right? 49%" while the side is assumed; no estimate is certain. */
export function spoken({ hand, assumed_hand: assumed, confidence }) {
  const side = hand ?? `${assumed}?`;
  if (confidence === null) return side;
  return `${side} ${confidence >= 0.995 ? ">99%" : `${shown(100 * confidence, 0)}%`}`;
}
