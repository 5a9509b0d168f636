// A camera that goes round the source: it looks from the direction (C, γ), at a distance, so that what is seen has a name.
const RAD = Math.PI / 180;
/** Field of view across the narrow side of the picture, radians. */
const FIELD = 28 * RAD;

export class Camera {
  constructor(directions, box) {
    this.directions = directions;
    this.box = box;
    this.middle = box.min.map((low, k) => (low + box.max[k]) / 2);
    this.radius = Math.max(Math.hypot(...box.min.map((low, k) => box.max[k] - low)) / 2, 1e-6);
    this.home();
  }

  /** The whole source, from the side of its light. */
  home() {
    Object.assign(this, { c: 300, gamma: 40, target: [...this.middle] });
    this.fit();
  }

  fit() {
    this.target = [...this.middle];
    this.distance = (1.02 * this.radius) / Math.sin(FIELD / 2);
  }

  turn(byC, byGamma) {
    this.c = (((this.c + byC) % 360) + 360) % 360;
    this.gamma = Math.min(180, Math.max(0, this.gamma + byGamma));
  }

  zoom(factor) {
    this.distance = Math.min(Math.max(this.distance * factor, 0.05 * this.radius), 400 * this.radius);
  }

  /** Half the height of the picture at the distance 1, for a picture of this width over height. */
  static tall(aspect) {
    return Math.tan(FIELD / 2) / Math.min(1, aspect);
  }

  /** Moves what is looked at, by parts of the picture's height. */
  shift(right, up, aspect) {
    const height = 2 * this.distance * Camera.tall(aspect);
    const axes = this.axes();
    this.target = this.target.map((value, k) => value + height * (right * axes.right[k] + up * axes.up[k]));
  }

  /** Unit vectors: towards the eye, up and right in the picture. Up is where γ becomes smaller. */
  axes() {
    const { x, y, z } = this.directions;
    const [sinG, cosG, sinC, cosC] = [this.gamma, this.c].flatMap((deg) => [Math.sin(deg * RAD), Math.cos(deg * RAD)]);
    const back = this.directions.vector(this.c, this.gamma);
    const up = [0, 1, 2].map((k) => -(cosG * cosC * x[k] + cosG * sinC * y[k] + sinG * z[k]));
    const right = [up[1] * back[2] - up[2] * back[1], up[2] * back[0] - up[0] * back[2], up[0] * back[1] - up[1] * back[0]];
    return { back, up, right };
  }

  eye() {
    const { back } = this.axes();
    return this.target.map((value, k) => value + this.distance * back[k]);
  }

  /** Clip space from the source frame and back, column-major, for a picture of this width over height. */
  matrices(aspect) {
    const { back, up, right } = this.axes();
    const eye = this.eye();
    const along = (axis) => -(axis[0] * eye[0] + axis[1] * eye[1] + axis[2] * eye[2]);
    const tall = Camera.tall(aspect);
    const [wide, near, far] = [tall * aspect, this.distance * 1e-3, this.distance + 500 * this.radius];
    const rows = [
      [...right.map((value) => value / wide), along(right) / wide],
      [...up.map((value) => value / tall), along(up) / tall],
      [...back, along(back)].map((value) => (-(far + near) / (far - near)) * value),
      [...back, along(back)].map((value) => -value),
    ];
    rows[2][3] -= (2 * far * near) / (far - near);
    const clip = new Float32Array([0, 1, 2, 3].flatMap((column) => rows.map((row) => row[column])));
    return { clip, eye, far, tall, wide, back, up, right };
  }

  /** The line of sight through a point of the picture, -1 to 1 each way. */
  line(x, y, aspect) {
    const { eye, tall, wide, back, up, right } = this.matrices(aspect);
    const way = back.map((value, k) => -value + x * wide * right[k] + y * tall * up[k]);
    const length = Math.hypot(...way);
    return { eye, way: way.map((value) => value / length) };
  }

  /** The inverse of `clip` for points at the far end, which is all the pictures need. */
  unclip(aspect) {
    const { eye, tall, wide, back, up, right } = this.matrices(aspect);
    const column = (vector) => [...vector, 0];
    return new Float32Array([
      ...column(right.map((value) => value * wide)),
      ...column(up.map((value) => value * tall)),
      ...column(back.map((value) => -value)),
      ...eye, 1,
    ]);
  }
}
