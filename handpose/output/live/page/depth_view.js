/* The part of the depth image around the hands, with the bones of all hands where the camera sees them. */

import { drawBones, paintDepth } from "./shading.js";
import { formatNumber } from "./elements.js";

const LABEL_HEIGHT = 20; // px
const DARKEST = 0.65; // grey value of the farthest depth; 1 is black

export class DepthView {
  /* onHover is called with a text about the pixel under the pointer. */
  constructor(canvas, { camera, colours }, onHover) {
    Object.assign(this, { canvas, camera, colours, onHover, frame: null });
    canvas.style.aspectRatio = `${camera.width} / ${camera.height}`;
    this.layer = document.createElement("canvas");
    this.layerPen = this.layer.getContext("2d");
    canvas.addEventListener("pointermove", (event) => this.hover(event.offsetX, event.offsetY));
    canvas.addEventListener("pointerleave", () => onHover(""));
  }

  hover(x, y) {
    if (!this.frame) return;
    const { window, grid, depth } = this.frame, zoom = this.canvas.getBoundingClientRect().width / window.width;
    const column = Math.floor((window.left + x / zoom - grid.left) / grid.step);
    const row = Math.floor((window.top + y / zoom - grid.top) / grid.step);
    const mm = column >= 0 && column < grid.columns ? depth[row * grid.columns + column] : undefined;
    const place = `column ${grid.left + column * grid.step}, row ${grid.top + row * grid.step}`;
    this.onHover(mm === undefined ? "" : `${place}: ${mm ? `${mm} mm` : "no depth"}`);
  }

  draw(frame, scene) {
    this.frame = frame;
    const { canvas, camera } = this, { window, grid } = frame, { width } = canvas.getBoundingClientRect();
    const ratio = Math.max(devicePixelRatio, 1), zoom = width / window.width;
    const size = { width: Math.round(width * ratio), height: Math.round(window.height * zoom * ratio) };
    if (!size.width) return;
    if (canvas.width !== size.width || canvas.height !== size.height) Object.assign(canvas, size);
    this.paintLayer(frame);
    const pen = canvas.getContext("2d"), scale = grid.step * zoom;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.drawImage(this.layer, (grid.left - window.left) * zoom, (grid.top - window.top) * zoom, grid.columns * scale,
      grid.rows * scale);
    const project = ([x, y, z]) => {
      const mm = Math.max(z, 1); // moves points behind the camera far out of the picture
      const u = camera.u0 + (camera.fx * x) / mm + 0.5, v = camera.v0 - (camera.fy * y) / mm + 0.5;
      return [(u - window.left) * zoom, (v - window.top) * zoom, z];
    };
    drawBones(pen, scene, project);
    for (const hand of frame.record.hands) this.drawLabel(pen, hand, (hand.positions_mm ?? [hand.palm_mm]).map(project));
  }

  /* Paint the depth into the layer, one pixel per sample; the contrast is highest at the depth of the hands. */
  paintLayer({ depth, grid: { columns, rows }, middle, spread }) {
    const { layer } = this;
    if (layer.width !== columns || layer.height !== rows) Object.assign(layer, { width: columns, height: rows });
    const picture = this.layerPen.createImageData(columns, rows), values = new Float32Array(columns * rows);
    depth.forEach((mm, pixel) => {
      const away = (mm - middle) / spread;
      values[pixel] = mm ? DARKEST * away / Math.hypot(1, away) : 1;
    });
    paintDepth(picture, values);
    this.layerPen.putImageData(picture, 0, 0);
  }

  /* Draw the side and the confidence above a hand: white on its colour; its colour on white if the side is assumed. */
  drawLabel(pen, hand, pixels) {
    const text = labelOf(hand), colour = `rgb(${this.colours[hand.id % this.colours.length].join(" ")})`;
    const left = Math.min(...pixels.map(([u]) => u)), top = Math.min(...pixels.map(([, v]) => v));
    pen.font = "13px system-ui, sans-serif";
    const width = pen.measureText(text).width + 12, x = Math.max(left, 0), y = Math.max(top - LABEL_HEIGHT - 8, 0);
    pen.fillStyle = hand.hand ? colour : "white";
    pen.fillRect(x, y, width, LABEL_HEIGHT);
    pen.strokeStyle = colour;
    pen.lineWidth = 2;
    pen.strokeRect(x, y, width, LABEL_HEIGHT);
    pen.fillStyle = hand.hand ? "white" : colour;
    pen.fillText(text, x + 6, y + 14);
  }
}

/* For example "right 93%", or "right? 49%" while the side is assumed. No confidence is shown as 100%. */
export function labelOf({ hand, assumed_hand: assumed, confidence, presence, positions_mm: positions }) {
  const side = positions ? (hand ?? `${assumed}?`) : hand ? `${hand} hand` : "hand";
  const chance = positions ? confidence : presence;
  if (chance === null) return side;
  return `${side} ${chance >= 0.995 ? ">99%" : `${formatNumber(100 * chance, 0)}%`}`;
}
