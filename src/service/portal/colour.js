// Colour: CIE 1931 2° tristimulus values of spectra, what they are called, sRGB, and the false colours of the pictures.
import { CMF, FIRST_NM, STEP_NM } from "./cie.js";

/** Luminous efficacy of radiation at 555 nm, lm/W. */
const LM_PER_W = 683;

/** x̄, ȳ, z̄ at a wavelength, linear between the table's rows, 0 outside. */
function matching(nm) {
  const at = (nm - FIRST_NM) / STEP_NM;
  if (!(at >= 0 && at <= CMF.length - 1)) return [0, 0, 0];
  const k = Math.min(Math.floor(at), CMF.length - 2);
  return [0, 1, 2].map((axis) => CMF[k][axis] + (at - k) * (CMF[k + 1][axis] - CMF[k][axis]));
}

/** Weighs densities per nm of bands to X, Y, Z (Y in lm of W/nm): a function of a list with a number per band. */
export function weigher(edges) {
  const weights = edges.slice(1).map((end, band) => {
    const start = edges[band];
    const steps = Math.max(1, Math.ceil(end - start));
    const sum = [0, 0, 0];
    for (let k = 0; k < steps; k += 1) {
      matching(start + ((k + 0.5) / steps) * (end - start)).forEach((value, axis) => { sum[axis] += value; });
    }
    return sum.map((value) => (LM_PER_W * value * (end - start)) / steps);
  });
  return (densities) => {
    const xyz = [0, 0, 0];
    for (let band = 0; band < weights.length; band += 1) {
      for (let axis = 0; axis < 3; axis += 1) xyz[axis] += weights[band][axis] * densities[band];
    }
    return xyz;
  };
}

/** x, y, u′, v′ of tristimulus values; null without light. */
export function chromaticity([x, y, z]) {
  const sum = x + y + z;
  if (!(sum > 0)) return null;
  const fifteen = x + 15 * y + 3 * z;
  return { x: x / sum, y: y / sum, u: (4 * x) / fifteen, v: (9 * y) / fifteen };
}

/** Farthest from the Planckian locus, in u and v of CIE 1960, that people call a light by a temperature. */
const MOST_DUV = 0.02;

/** Correlated colour temperature, K, and distance from the Planckian locus; null where that is far. */
export function temperature({ x, y }) {
  const [u, v] = [(4 * x) / (-2 * x + 12 * y + 3), (6 * y) / (-2 * x + 12 * y + 3)];
  const distance = (mired) => {
    const [pu, pv] = planck(1e6 / mired);
    return Math.hypot(u - pu, v - pv);
  };
  let best = 0;
  for (let mired = 40; mired <= 660; mired += 5) if (!best || distance(mired) < distance(best)) best = mired;
  for (let step = 2.5; step > 0.01; step /= 2) {
    best = [best - step, best, best + step].reduce((a, b) => (distance(b) < distance(a) ? b : a));
  }
  const duv = distance(best) * (v >= planck(1e6 / best)[1] ? 1 : -1);
  return Math.abs(duv) <= MOST_DUV && best > 41 && best < 659 ? { kelvin: 1e6 / best, duv } : null;
}

/** u, v (CIE 1960) of a black body: Planck's law with c₂ = 1.4388e7 nm K. */
function planck(kelvin) {
  const sum = [0, 0, 0];
  CMF.forEach((row, k) => {
    const nm = FIRST_NM + k * STEP_NM;
    const power = (nm / 560) ** -5 / Math.expm1(1.4388e7 / (nm * kelvin));
    row.forEach((value, axis) => { sum[axis] += value * power; });
  });
  const [x, y, z] = sum;
  return [(4 * x) / (x + 15 * y + 3 * z), (6 * y) / (x + 15 * y + 3 * z)];
}

/** Dominant wavelength, nm, from equal-energy white; null for purples. */
export function dominant({ x, y }) {
  const angle = Math.atan2(y - 1 / 3, x - 1 / 3);
  let found = null;
  for (let nm = 390; nm < 700; nm += 1) {
    const [from, to] = [nm, nm + 1].map((at) => {
      const [mx, my, mz] = matching(at);
      return Math.atan2(my / (mx + my + mz) - 1 / 3, mx / (mx + my + mz) - 1 / 3);
    });
    const [a, b] = [from, to].map((other) => Math.atan2(Math.sin(other - angle), Math.cos(other - angle)));
    if (a * b <= 0 && Math.abs(a - b) < 1) found = nm + (a === b ? 0 : a / (a - b));
  }
  return found;
}

/** Linear sRGB of X, Y, Z (IEC 61966-2-1), column-major for the shader. */
export const RGB_FROM_XYZ = [3.2406, -0.9689, 0.0557, -1.5372, 1.8758, -0.204, -0.4986, 0.0415, 1.057];

/** A colour a screen can show of tristimulus values, as `rgb(..)`: as bright as it can be. */
export function swatch(xyz) {
  const linear = [0, 1, 2].map((row) => Math.max(0, xyz.reduce((sum, value, column) => sum + RGB_FROM_XYZ[3 * column + row] * value, 0)));
  const most = Math.max(...linear, 1e-30);
  return `rgb(${linear.map((value) => Math.round(255 * encoded(value / most))).join(" ")})`;
}

/** Bytes of sRGB of X, Y, Z, of which Y = 1 is white; colours outside of the screen's are paled until they are within, as in the shader. */
export function screen(xyz) {
  let linear = [0, 1, 2].map((row) => xyz.reduce((sum, value, column) => sum + RGB_FROM_XYZ[3 * column + row] * value, 0));
  const [least, grey] = [Math.min(...linear), xyz[1]];
  if (least < 0 && grey > 0) linear = linear.map((value) => grey + (value - grey) * (grey / (grey - least)));
  return linear.map((value) => Math.round(255 * encoded(Math.min(1, Math.max(0, value)))));
}

const encoded = (value) => (value <= 0.0031308 ? 12.92 * value : 1.055 * value ** (1 / 2.4) - 0.055);

/** A colour for a wavelength of a drawing. */
export function ofWavelength(nm) {
  const at = Math.min(Math.max(nm, 400), 690);
  return swatch(matching(at));
}

/** Stations of the false colours, sRGB: each brighter than the one before, so that prints in grey keep the order. */
const STATIONS = [[6, 7, 15], [38, 20, 82], [92, 22, 120], [153, 32, 112], [208, 58, 82], [243, 107, 49], [252, 166, 40], [246, 221, 96], [255, 253, 220]];

/** 256 false colours, RGBA bytes. */
export function falseColours() {
  const out = new Uint8Array(1024);
  for (let k = 0; k < 256; k += 1) {
    const at = (k / 255) * (STATIONS.length - 1);
    const low = Math.min(Math.floor(at), STATIONS.length - 2);
    const mixed = STATIONS[low].map((value, axis) => value + (at - low) * (STATIONS[low + 1][axis] - value));
    out.set([...mixed.map(Math.round), 255], 4 * k);
  }
  return out;
}

/** The same as stops of a gradient from left to right. */
export const GRADIENT = `linear-gradient(to right, ${STATIONS.map((rgb) => `rgb(${rgb.join(" ")})`).join(", ")})`;

/** A colour for a zone: neighbours in number differ. */
export function ofZone(id) {
  const hue = (id * 137.508) % 360;
  const [light, chroma] = [0.62 + 0.12 * ((id % 3) - 1), 0.42];
  const part = (shift) => light + chroma * 0.5 * Math.cos(((hue + shift) * Math.PI) / 180);
  return [part(0), part(-120), part(120)].map((value) => Math.min(1, Math.max(0, value)));
}
