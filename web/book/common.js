/* What the pages of the book share: shapes in SVG, and numbers as text. */

const SVG = "http://www.w3.org/2000/svg";

/* An element of SVG with attributes and children; texts become text, never markup. */
export function shape(tag, attributes = {}, ...children) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

/* A number as short as it can be: at most `decimals` decimals, a real minus sign, a power of ten for what is large. */
export function short(number, decimals = 4) {
  if (!Number.isFinite(number)) return Number.isNaN(number) ? "?" : number > 0 ? "∞" : "−∞";
  const large = Math.abs(number) >= 1e6;
  const text = large ? number.toExponential(1).replace("e+", "e") : String(Number(number.toFixed(decimals)) + 0);
  return text.replaceAll("-", "−");
}
