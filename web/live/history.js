/* The last frames, and which of them is shown: the newest one, or while paused any of them, frame by frame. */

import { byId } from "./elements.js";

const KEPT = 150; // frames

export class History {
  /* send(word)  to the tracker: pause, play or step
     show()      the frame to show has changed */
  constructor(send, show) {
    Object.assign(this, { send, show, frames: [], at: -1, paused: false, stepping: false });
    this.buttons = { pause: byId("pause"), back: byId("back"), forward: byId("forward") };
    this.buttons.pause.addEventListener("click", () => this.pause(!this.paused));
    this.buttons.back.addEventListener("click", () => this.step(-1));
    this.buttons.forward.addEventListener("click", () => this.step(1));
  }

  get shown() {
    return this.frames[this.at] ?? null;
  }

  add(frame) {
    this.frames.push(frame);
    if (this.frames.length > KEPT) {
      this.frames.shift();
      this.at = Math.max(this.at - 1, 0);
    }
    if (!this.paused || this.stepping) {
      this.at = this.stepping ? this.at + 1 : this.frames.length - 1;
      this.stepping = false;
      this.show();
    }
    this.update();
  }

  pause(paused) {
    this.paused = paused;
    this.stepping = false;
    this.send(paused ? "pause" : "play");
    if (!paused) this.at = this.frames.length - 1;
    this.update();
    this.show();
  }

  /* Back or forward; after the last frame that is kept, the tracker is asked for one more. */
  step(by) {
    if (by > 0 && this.at === this.frames.length - 1) {
      this.stepping = true;
      this.send("step");
      return;
    }
    this.at = Math.min(Math.max(this.at + by, 0), this.frames.length - 1);
    this.update();
    this.show();
  }

  update() {
    const { pause, back, forward } = this.buttons;
    pause.textContent = this.paused ? "Play" : "Pause";
    pause.setAttribute("aria-pressed", String(this.paused));
    back.disabled = !this.paused || this.at <= 0;
    forward.disabled = !this.paused;
  }
}
