// Planes that take away what is beyond them, one across each axis: which, where, and which side stays.
import { field, h } from "./dom.js";
import { coordinate } from "./numbers.js";
import { peakOf } from "./solid.js";
import { words } from "./words.js";

/** Parts of the way of a cut through the lamp. */
const STEPS = 200;
const AXES = ["X", "Y", "Z"];

/** Cuts that take nothing away. */
export function uncut() {
  return AXES.map(() => ({ isOn: false, part: 0.5, isOther: false }));
}

/** Unit normal and place of each cut, mm; beyond any of them nothing is shown. A normal of 0 cuts nothing. */
export function planes(cuts, { box, middle, radius }, isSolid) {
  return cuts.map(({ isOn, part, isOther }, axis) => {
    if (!isOn) return [0, 0, 0, 1];
    const [low, high] = isSolid ? [middle[axis] - radius, middle[axis] + radius] : [box.min[axis], box.max[axis]];
    const sign = isOther ? -1 : 1;
    return [...AXES.map((_, k) => (k === axis ? sign : 0)), sign * (low + part * (high - low))];
  });
}

/** Controls of the cuts of a view: `{ element, tell }`; `tell()` says again where they are. */
export function cutControls(view) {
  const rows = AXES.map((name, axis) => {
    const change = (cut) => {
      view.become({ cuts: view.cuts.map((one, k) => (k === axis ? { ...one, ...cut } : one)) });
      tell();
    };
    const at = h("input", { type: "range", min: 0, max: STEPS, value: STEPS / 2, oninput: () => change({ part: Number(at.value) / STEPS }) });
    const other = h("input", { type: "checkbox", onchange: () => change({ isOther: other.checked }) });
    const on = h("input", { type: "checkbox", onchange: () => change({ isOn: on.checked }) });
    const told = h("output", { class: "hint" });
    const how = h("div", { class: "cut", hidden: true }, field(words.view.cutAt(name), at), told, h("label", { class: "check" }, other, words.view.cutOther(name)));
    const tell = () => {
      how.hidden = !view.cuts[axis].isOn;
      told.textContent = how.hidden ? "" : toldOf(view, axis);
      at.setAttribute("aria-valuetext", told.textContent);
    };
    return { choice: h("label", { class: "check" }, on, words.view.cutAcross(name)), how, tell };
  });
  return {
    element: h("fieldset", { class: "cuts" }, h("legend", {}, words.view.cut),
      h("div", { class: "row" }, rows.map(({ choice }) => choice)), rows.map(({ how }) => how)),
    tell: () => rows.forEach(({ tell }) => tell()),
  };
}

/** What a cut leaves. Lengths of the photometric solid are intensities. */
function toldOf(view, axis) {
  const { cuts, camera, lamp, mode } = view;
  const { isOther } = cuts[axis];
  const distance = planes(cuts, camera, mode === "solid")[axis][3];
  const place = isOther ? -distance : distance;
  if (mode !== "solid") return words.view.cutTo(AXES[axis], isOther, `${coordinate(place, camera.radius)} mm`);
  const { origin, reach } = view.picture.solidOf(camera);
  const peak = lamp.solidPeak ?? peakOf(lamp);
  return words.view.cutTo(AXES[axis], isOther, `${coordinate(((place - origin[axis]) / reach) * peak, peak)} ${view.quantity().unit}`);
}
