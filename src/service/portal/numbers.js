// Numbers as people read them.

/** A number with so many significant digits, with thin spaces between thousands. */
export function significant(value, digits) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.floor(Math.log10(Math.abs(value)));
  if (size >= 15 || size < -4) return exponent(Number(value.toPrecision(digits)));
  const rounded = Number(value.toPrecision(digits));
  const [whole, part] = rounded.toFixed(Math.max(0, digits - 1 - size)).split(".");
  const grouped = whole.replace(/(\d)(?=(\d{3})+$)/g, "$1\u202f");
  return part ? `${grouped}.${part}` : grouped;
}

/**
 * A number as people type it; null for what is not one, or could be two: 1,200 is a thousand to some and one to others. Elsewhere a
 * comma is a decimal mark. Spaces between thousands are the page's own.
 */
export function typed(text) {
  const plain = text.trim().replaceAll(/(?<=\d)[ \u00a0\u202f](?=\d{3}(?!\d))/g, "");
  if (!/^(\d+([.,]\d*)?|[.,]\d+)(e[+-]?\d{1,2})?$/i.test(plain) || /^[1-9]\d{0,2},\d{3}(e|$)/i.test(plain)) return null;
  return Number(plain.replace(",", "."));
}

/** A count as people type it, 1000000 or 1e6 or 2.5e8, with all of its digits; null for what is not one. */
export function whole(text) {
  const value = /^\d+(\.\d+)?(e\+?\d{1,2})?$/i.test(text) ? Number(text) : NaN;
  return Number.isSafeInteger(value) ? String(value) : null;
}

function exponent(value) {
  const [mantissa, power] = value.toExponential().split("e");
  const raised = [...String(Number(power))].map((sign) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[sign] ?? "⁻").join("");
  return `${mantissa} · 10${raised}`;
}

export function count(value) {
  return String(Math.round(value)).replace(/(\d)(?=(\d{3})+$)/g, "$1\u202f");
}

export function bytes(value) {
  for (const [unit, size] of [["GiB", 2 ** 30], ["MiB", 2 ** 20], ["KiB", 2 ** 10]]) {
    if (value >= size) return `${significant(value / size, 3)} ${unit}`;
  }
  return `${value} bytes`;
}

export function percent(fraction) {
  return fraction > 0 && fraction < 0.001 ? "<\u00a00.1\u00a0%" : `${significant(100 * fraction, fraction < 0.1 ? 2 : 3)}\u00a0%`;
}

export function seconds(value) {
  if (value < 90) return `${Math.max(1, Math.round(value))} s`;
  return value < 5400 ? `${Math.round(value / 60)} min` : `${significant(value / 3600, 2)} h`;
}

export function when(ms) {
  return new Date(ms).toLocaleString("en-GB", { dateStyle: "medium", timeStyle: "short" });
}

/** A coordinate, mm, to a thousandth of what has this size. */
export function coordinate(value, size) {
  const decimals = Math.min(9, Math.max(0, 3 - Math.floor(Math.log10(size || 1))));
  return String(Number(value.toFixed(decimals)) || 0);
}

/** Powers of a thousand that units have names for. */
const PREFIXES = [["G", 1e9], ["M", 1e6], ["k", 1e3], ["", 1], ["m", 1e-3], ["µ", 1e-6]];

/** A unit with a prefix in which `value` is a number people read, and how many of it one is. */
export function prefixed(value, unit) {
  const size = Math.abs(value);
  const [prefix, factor] = PREFIXES.find(([, least]) => size >= least) ?? (size > 0 ? PREFIXES.at(-1) : ["", 1]);
  return { unit: `${prefix}${unit}`, factor: 1 / factor };
}

/** A value with three digits and its unit. */
export function measured(value, unit) {
  const { unit: shown, factor } = prefixed(value, unit);
  return `${significant(value * factor, 3)} ${shown}`;
}

/** The unit of what a picture shows, and how many of it one lm or W per mm² (and sr) are. */
export function quantity(mode, isLuminous) {
  if (mode === "exitance") return isLuminous ? { factor: 1, unit: "lm/mm²" } : { factor: 1, unit: "W/mm²" };
  return isLuminous ? { factor: 1e6, unit: "cd/m²" } : { factor: 1, unit: "W/(mm² sr)" };
}

/** The next round number: 1 to 10 in halves. */
export function ceiling(value) {
  if (!(value > 0)) return 0;
  const step = 10 ** Math.floor(Math.log10(value)) / 2;
  return Math.ceil(value / step - 1e-9) * step;
}
