/* The confidence of each hand over the last seconds as curves, and the present state of each hand as text. */

import { labelOf } from "./depth_view.js";
import { element, formatNumber } from "./elements.js";

const SECONDS = 8;
const LEFT = 42, RIGHT = 12, TOP = 8, BOTTOM = 20; // px, margins around the curves
const MAX_GAP = 0.5; // s: a curve is interrupted where frames are missing for longer
const LOST_S = 3; // a lost hand leaves the list after these seconds

export class Confidence {
  constructor(canvas, list, colours) {
    Object.assign(this, { canvas, list, colours, records: [] });
  }

  colour(id) {
    return `rgb(${this.colours[id % this.colours.length].join(" ")})`;
  }

  /* Show the state in a record. */
  show(record) {
    const now = record.time_s;
    this.records = [...this.records.filter(({ time_s: time }) => time < now && time >= now - SECONDS), record];
    this.draw(now);
    const colourMark = (id) => {
      const mark = element("b");
      mark.style.background = this.colour(id);
      return mark;
    };
    const recent = record.lost.filter(({ since_s: since }) => now - since <= LOST_S);
    this.list.replaceChildren(
      ...record.hands.map((hand) => element("li", {}, colourMark(hand.id), stateOf(hand))),
      ...recent.map(({ id, hand, since_s: since, reason }) => element(
        "li", { class: "lost" }, colourMark(id),
        `${hand ? `${hand} ` : ""}hand lost ${formatNumber(now - since, 1)} s: ${reason}`,
      )),
    );
  }

  draw(now) {
    const { canvas } = this, { width, height } = canvas.getBoundingClientRect(), ratio = Math.max(devicePixelRatio, 1);
    Object.assign(canvas, { width: Math.round(width * ratio), height: Math.round(height * ratio) });
    const pen = canvas.getContext("2d"), bottom = height - BOTTOM;
    const x = (time) => width - RIGHT - ((now - time) / SECONDS) * (width - LEFT - RIGHT);
    const y = (confidence) => bottom - confidence * (bottom - TOP);
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.font = "11px system-ui, sans-serif";
    pen.fillStyle = getComputedStyle(canvas).color;
    for (const level of [0, 0.5, 1]) {
      pen.globalAlpha = 0.15;
      pen.fillRect(LEFT, y(level), width - LEFT - RIGHT, 1);
      pen.globalAlpha = 0.7;
      pen.textAlign = "right";
      pen.fillText(`${100 * level}%`, LEFT - 6, y(level) + 4);
    }
    pen.textAlign = "center";
    for (let back = 0; back <= SECONDS; back += 2) pen.fillText(back ? `-${back} s` : "now", x(now - back), height - 5);
    pen.globalAlpha = 1;
    pen.lineWidth = 2;
    for (const id of new Set(this.records.flatMap(({ hands }) => hands.map((hand) => hand.id)))) {
      this.drawCurve(pen, id, x, y);
    }
  }

  drawCurve(pen, id, x, y) {
    let lastTime = -Infinity;
    pen.strokeStyle = this.colour(id);
    pen.beginPath();
    for (const { time_s: time, hands } of this.records) {
      const confidence = hands.find((hand) => hand.id === id)?.confidence ?? null;
      if (confidence === null) {
        lastTime = -Infinity;
        continue;
      }
      if (time - lastTime > MAX_GAP) pen.moveTo(x(time), y(confidence));
      else pen.lineTo(x(time), y(confidence));
      lastTime = time;
    }
    pen.stroke();
  }
}

/* For example "right 93%, expected error 5 mm, gesture open". */
function stateOf(hand) {
  if (!hand.positions_mm) return `${labelOf(hand)}: ${hand.reason}`;
  const error = hand.error_mm === null ? "" : `, expected error ${formatNumber(hand.error_mm, 0)} mm`;
  const gesture = hand.gesture?.name ? `, gesture ${hand.gesture.name.replaceAll("_", " ")}` : "";
  return `${labelOf(hand)}${error}${gesture}`;
}
