/** Numbers as photographers write them. */

/** A number with so many significant digits and no exponent. */
export function digits(value, count = 3) {
  if (!Number.isFinite(value)) return "∞";
  if (value === 0) return "0";
  const places = Math.max(0, count - 1 - Math.floor(Math.log10(Math.abs(value))));
  const text = value.toFixed(Math.min(places, 6));
  return (places ? text.replace(/\.?0+$/, "") : text).replace("-", "−");
}

/** A number with its sign and one place, as exposure values are written. */
export function signed(value, places = 1) {
  const text = Math.abs(value).toFixed(places);
  return Number(text) === 0 ? `±${text}` : (value < 0 ? "−" : "+") + text;
}

/** A distance in metres, in the unit that suits it. */
export function distance(metres) {
  if (metres === null || metres === undefined || !Number.isFinite(metres) || metres > 9e5) return "∞";
  if (metres < 0.1) return `${digits(metres * 1000)}\u00a0mm`;
  return metres < 1 ? `${digits(metres * 100)}\u00a0cm` : `${digits(metres)}\u00a0m`;
}

/** An exposure time in seconds as on a dial: 1/125 s, 0.5 s, 4 s. */
export function time(seconds) {
  return seconds >= 0.29 ? `${digits(seconds, 2)}\u00a0s` : `1/${digits(1 / seconds, 3)}\u00a0s`;
}

/** A share as a percentage. */
export function percent(share, count = 2) {
  return `${digits(100 * share, count)}\u00a0%`;
}

/** How far a picture is reduced: full, 1/2, 1/4. */
export function reduction(scale) {
  return scale > 0.99 ? "full" : Math.abs(1 / scale - Math.round(1 / scale)) < 0.05 ? `1/${Math.round(1 / scale)}` : percent(scale);
}

/** Words as the first of a line. */
export function capital(words) {
  return words.charAt(0).toUpperCase() + words.slice(1);
}

const KNOWN = {
  f_number: (value) => `f/${digits(value, 2)}`,
  shutter_s: time,
  iso: (value) => digits(value, 6),
  ev: signed,
  focus_m: distance,
};

/** The value of a dial until the server says how it is written. */
export function dialText(dial, value) {
  if (value === null || value === undefined) return "–";
  if (typeof value !== "number") return String(value);
  const known = KNOWN[dial.name];
  return known ? known(value) : `${digits(value)}${dial.unit ? `\u00a0${dial.unit}` : ""}`;
}

const UNITS = { m: { mm: 1e-3, cm: 1e-2, m: 1 }, mm: { mm: 1, cm: 10, m: 1e3 }, s: { ms: 1e-3, s: 1 } };
const THIRDS = { "⅓": 1 / 3, "½": 1 / 2, "⅔": 2 / 3 };

/** The number that somebody typed, in the unit of its dial: 2.8, f/2.8, 1/125, ISO 400, 65 cm, −1⅓ EV, ∞. Null when it is none. */
export function typed(text, unit = "") {
  const plain = text.trim().toLowerCase().replace("−", "-").replace(",", ".").replace(/^±/, "").replace(/^(?:f\s*\/|iso)\s*/, "");
  if (/^(∞|inf|infinity)$/.test(plain)) return 1e6;
  const found = /^([-+]?)(\d*\.?\d*)([⅓½⅔]?)(?:\s*\/\s*(\d*\.?\d+))?\s*(mm|cm|m|ms|s|ev|k|°)?$/.exec(plain);
  if (!found || !/\d|[⅓½⅔]/.test(found[2] + found[3])) return null;
  const [, sign, whole, part, below, given] = found;
  const factor = given && unit in UNITS ? UNITS[unit][given] : 1;
  const value = ((Number(whole || 0) + (THIRDS[part] ?? 0)) / Number(below ?? 1)) * (factor ?? Number.NaN);
  return Number.isFinite(value) ? (sign === "-" ? -value : value) : null;
}
