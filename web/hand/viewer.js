/* Where the page's eye is: turned about a point, looking along z of its own axes, x right, y up. */

import { add, apply, compose, IDENTITY, minus, rotation, times, transposed } from "./vectors.js";

const AWAY = 5; // the eye's distance from the middle, in reaches of the body
const FILLS = 0.8; // how much of the picture's shorter side a body fills at first
const PER_PIXEL = 0.008; // rad
const NEAREST = 0.2, FARTHEST = 12; // zoom

export class Viewer {
  constructor() {
    this.width = this.height = 1;
    this.show({ middle: [0, 0, 0], reach: 1 });
  }

  /* Look at a body from the front. */
  show({ middle, reach }) {
    Object.assign(this, { middle, reach, turned: IDENTITY, zoom: 1 });
  }

  /* px per unit of slope. */
  get focal() {
    return (Math.min(this.width, this.height) * FILLS * AWAY * this.zoom) / 2;
  }

  get distance() {
    return this.reach * AWAY;
  }

  turn(right, down) {
    const step = compose(rotation(0, -down * PER_PIXEL), rotation(1, -right * PER_PIXEL));
    this.turned = compose(step, this.turned);
  }

  closer(factor) {
    this.zoom = Math.min(Math.max(this.zoom * factor, NEAREST), FARTHEST);
  }

  /* A point in the eye's axes. */
  see(point) {
    return add(apply(this.turned, minus(point, this.middle)), [0, 0, this.distance]);
  }

  /* Where a point appears: px to the right, px down, mm away. */
  pixel(point) {
    const [x, y, z] = this.see(point);
    return [this.width / 2 + (this.focal * x) / z, this.height / 2 - (this.focal * y) / z, z];
  }

  /* The vector in the world that moves a point at `depth` mm so many px to the right and down. */
  vector(right, down, depth) {
    return apply(transposed(this.turned), times([right, -down, 0], depth / this.focal));
  }

  /* The ascending slopes of rays through `count` pixels that divide `size` px. */
  slopes(count, size) {
    return Float64Array.from({ length: count }, (_, i) => (((i + 0.5) / count - 0.5) * size) / this.focal);
  }
}
