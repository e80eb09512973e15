/* How sure each hand has been over the last seconds, as curves, and what is known of it now, in words. */

import { spoken } from "./depth_view.js";
import { element, shown } from "./elements.js";

const SECONDS = 8;
const LEFT = 42, RIGHT = 12, ABOVE = 8, BELOW = 20; // px beside the curves
const GAP = 0.5; // s without a frame, over which no curve is drawn

export class Confidence {
  constructor(canvas, list, colours) {
    Object.assign(this, { canvas, list, colours, past: [] });
  }

  colour(id) {
    return `rgb(${this.colours[id % this.colours.length].join(" ")})`;
  }

  show(record) {
    const { time_s: now } = record; // earlier than the last one after a step back
    this.past = [...this.past.filter(({ time_s: time }) => time < now && time >= now - SECONDS), record];
    this.draw(record.time_s);
    const marked = (id) => {
      const mark = element("b");
      mark.style.background = this.colour(id);
      return mark;
    };
    this.list.replaceChildren(
      ...record.hands.map((hand) => element("li", {}, marked(hand.id), words(hand))),
      ...record.lost.map(({ id, hand, since_s: since, reason }) => element(
        "li", { class: "lost" }, marked(id),
        `${hand ? `${hand} ` : ""}hand lost ${shown(record.time_s - since, 1)} s: ${reason}`,
      )),
    );
  }

  draw(now) {
    const { canvas } = this, { width, height } = canvas.getBoundingClientRect(), ratio = Math.max(devicePixelRatio, 1);
    Object.assign(canvas, { width: Math.round(width * ratio), height: Math.round(height * ratio) });
    const pen = canvas.getContext("2d"), ink = getComputedStyle(canvas).color, bottom = height - BELOW;
    const x = (time) => width - RIGHT - ((now - time) / SECONDS) * (width - LEFT - RIGHT);
    const y = (confidence) => bottom - confidence * (bottom - ABOVE);
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.font = "11px system-ui, sans-serif";
    pen.fillStyle = pen.strokeStyle = ink;
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
    const ids = new Set(this.past.flatMap((record) => record.hands.map(({ id }) => id)));
    for (const id of ids) {
      pen.strokeStyle = this.colour(id);
      pen.beginPath();
      let before = -Infinity;
      for (const { time_s: time, hands } of this.past) {
        const confidence = hands.find((hand) => hand.id === id)?.confidence ?? null;
        if (confidence === null) {
          before = -Infinity;
          continue;
        }
        if (time - before > GAP) pen.moveTo(x(time), y(confidence));
        else pen.lineTo(x(time), y(confidence));
        before = time;
      }
      pen.stroke();
    }
  }
}

/* "right 93%, expected error 5 mm, gesture open" */
function words(hand) {
  const error = hand.error_mm === null ? "" : `, expected error ${shown(hand.error_mm, 0)} mm`;
  const gesture = hand.gesture?.name ? `, gesture ${hand.gesture.name.replaceAll("_", " ")}` : "";
  return `${spoken(hand)}${error}${gesture}`;
}
