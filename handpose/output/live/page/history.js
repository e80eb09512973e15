/* The last frames, and the index of the shown one: the newest frame, or the one that the user chose after a pause. */

import { byId } from "./elements.js";

const MAX_FRAMES = 150;

export class History {
  /* send(word)  sends pause, play or step to the tracker
     onChange()  is called when another frame is to be shown */
  constructor(send, onChange) {
    Object.assign(this, { send, onChange, frames: [], index: -1, paused: false, stepping: false });
    this.buttons = { pause: byId("pause"), back: byId("back"), forward: byId("forward") };
    this.buttons.pause.addEventListener("click", () => this.pause(!this.paused));
    this.buttons.back.addEventListener("click", () => this.step(-1));
    this.buttons.forward.addEventListener("click", () => this.step(1));
  }

  get current() {
    return this.frames[this.index] ?? null;
  }

  add(frame) {
    this.frames.push(frame);
    if (this.frames.length > MAX_FRAMES) {
      this.frames.shift();
      this.index = Math.max(this.index - 1, 0);
    }
    if (!this.paused || this.stepping) {
      this.index = this.stepping ? this.index + 1 : this.frames.length - 1;
      this.stepping = false;
      this.onChange();
    }
    this.update();
  }

  pause(paused) {
    this.paused = paused;
    this.stepping = false;
    this.send(paused ? "pause" : "play");
    if (!paused) this.index = this.frames.length - 1;
    this.update();
    this.onChange();
  }

  /* Go one frame back (-1) or forward (1); after the newest frame, request one more from the tracker. */
  step(by) {
    if (by > 0 && this.index === this.frames.length - 1) {
      this.stepping = true;
      this.send("step");
      return;
    }
    this.index = Math.min(Math.max(this.index + by, 0), this.frames.length - 1);
    this.update();
    this.onChange();
  }

  update() {
    const { pause, back, forward } = this.buttons;
    pause.textContent = this.paused ? "Play" : "Pause";
    pause.setAttribute("aria-pressed", String(this.paused));
    back.disabled = !this.paused || this.index <= 0;
    forward.disabled = !this.paused;
  }
}
