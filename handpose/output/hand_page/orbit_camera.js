/* The virtual camera of the 3-D view: it rotates around a centre and looks along z of its own axes, x right, y up. */

import { add, apply, compose, IDENTITY, minus, rotation, times, transposed } from "./vectors.js";

const DISTANCE = 5; // distance of the camera from the centre, in radii of the body
const FILLED = 0.8; // part of the shorter side of the picture that a body fills without zoom
const RAD_PER_PX = 0.008;
const MIN_ZOOM = 0.2, MAX_ZOOM = 12;

export class OrbitCamera {
  constructor() {
    this.width = this.height = 1; // px
    this.reset({ center: [0, 0, 0], radius: 1 });
  }

  /* Look from the front at a sphere with this centre and radius in mm. */
  reset({ center, radius }) {
    Object.assign(this, { center, radius, orientation: IDENTITY, zoom: 1 });
  }

  /* px per unit of slope. */
  get focal() {
    return (Math.min(this.width, this.height) * FILLED * DISTANCE * this.zoom) / 2;
  }

  get distance() {
    return this.radius * DISTANCE;
  }

  /* Rotate the body by a movement of the pointer in px. */
  rotate(right, down) {
    const step = compose(rotation(0, -down * RAD_PER_PX), rotation(1, -right * RAD_PER_PX));
    this.orientation = compose(step, this.orientation);
  }

  zoomBy(factor) {
    this.zoom = Math.min(Math.max(this.zoom * factor, MIN_ZOOM), MAX_ZOOM);
  }

  /* Convert a point in mm to the axes of this camera. */
  toView(point) {
    return add(apply(this.orientation, minus(point, this.center)), [0, 0, this.distance]);
  }

  /* Project a point in mm into the picture: px to the right, px down, mm away. */
  project(point) {
    const [x, y, z] = this.toView(point);
    return [this.width / 2 + (this.focal * x) / z, this.height / 2 - (this.focal * y) / z, z];
  }

  /* The vector in mm that moves a point at this depth by `right` and `down` px in the picture. */
  unprojectVector(right, down, depth) {
    return apply(transposed(this.orientation), times([right, -down, 0], depth / this.focal));
  }

  /* The ascending slopes of rays through `count` pixels across `size` px. */
  slopes(count, size) {
    return Float64Array.from({ length: count }, (_, i) => (((i + 0.5) / count - 0.5) * size) / this.focal);
  }
}
