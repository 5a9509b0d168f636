// Which way the axes of the source point in the picture, and where C and γ begin: a small drawing, and the same in words.
import { s } from "./dom.js";
import { words } from "./words.js";

const LONG = 26;
const NAMES = ["X", "Y", "Z"];

/** The name of an axis of the source that a vector lies along, as "+X"; null of one that lies along none. */
export function axisName(vector) {
  const k = vector.findIndex((value) => Math.abs(value) > 0.999999);
  return k < 0 ? null : `${vector[k] > 0 ? "+" : "−"}${NAMES[k]}`;
}

/** The directions of γ = 0, C = 0 and C = 90° in the source frame. */
export function beginnings(directions) {
  return [["γ0", directions.vector(0, 0)], ["C0", directions.vector(0, 90)], ["C90", directions.vector(90, 90)]];
}

export class Axes {
  constructor(directions) {
    this.element = s("svg", { class: "axes", viewBox: "-56 -50 112 100", "aria-hidden": "true" });
    const named = beginnings(directions);
    this.text = words.view.frame(...named.map(([, vector]) => axisName(vector) ?? `(${vector.map((value) => value.toFixed(3)).join(", ")})`));
    // An axis and a beginning that lie along one another have one line with both names.
    this.lines = NAMES.map((name, k) => ({ names: [name], vector: [0, 1, 2].map((axis) => (axis === k ? 1 : 0)), kind: "axis" }));
    for (const [name, vector] of named) {
      const same = this.lines.find((line) => line.vector.every((value, k) => Math.abs(value - vector[k]) < 1e-6));
      if (same) same.names.push(name);
      else this.lines.push({ names: [name], vector, kind: "begins" });
    }
    for (const line of this.lines) {
      line.line = s("line", { class: line.kind });
      line.text = s("text", {}, line.names.join(" "));
      this.element.append(line.line, line.text);
    }
  }

  /** Draws them as the camera sees them. Lines are made once and moved: the picture turns many times a second. */
  show({ right, up }) {
    const along = (axis, vector) => axis.reduce((sum, value, k) => sum + value * vector[k], 0);
    for (const { vector, line, text, kind } of this.lines) {
      const [x, y] = [along(right, vector), -along(up, vector)];
      line.setAttribute("x2", (LONG * x).toFixed(1));
      line.setAttribute("y2", (LONG * y).toFixed(1));
      const out = LONG + (kind === "axis" ? 9 : 20);
      text.setAttribute("x", (out * x).toFixed(1));
      text.setAttribute("y", (out * y + 3).toFixed(1));
      // The name of an axis that points at the eye would lie on the others.
      text.setAttribute("visibility", Math.hypot(x, y) > 0.15 ? "visible" : "hidden");
    }
  }
}
