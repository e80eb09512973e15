/* Helpers that the pages of the book share: elements of SVG, and numbers as text. */

const SVG = "http://www.w3.org/2000/svg";

/* Make an SVG element with attributes and children. Strings become text, never markup. */
export function svgElement(tag, attributes = {}, ...children) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

/* Format a number without superfluous digits: at most `decimals` decimals, a typographic minus sign, and a power of ten
   for large numbers. */
export function short(number, decimals = 4) {
  if (!Number.isFinite(number)) return Number.isNaN(number) ? "?" : number > 0 ? "∞" : "−∞";
  const isLarge = Math.abs(number) >= 1e6;
  const text = isLarge ? number.toExponential(1).replace("e+", "e") : String(Number(number.toFixed(decimals)) + 0);
  return text.replaceAll("-", "−");
}

/* Format a number as a factor in a formula: negative numbers are in parentheses. */
export const factor = (number) => (number < 0 ? `(${short(number)})` : short(number));
