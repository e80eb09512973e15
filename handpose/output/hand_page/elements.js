/* Helpers for elements of the page, and for numbers in it. */

/* Make an element with attributes, listeners (onclick: ...) and children. Strings become text, never markup. */
export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (value === true) made.setAttribute(name, "");
    else if (value !== false) made.setAttribute(name, value);
  }
  made.append(...children);
  return made;
}

export const byId = (id) => document.getElementById(id);

/* Format a number with a fixed number of decimals; zero has no minus sign. */
export function formatNumber(number, decimals) {
  if (!Number.isFinite(number)) return number > 0 ? "∞" : number < 0 ? "-∞" : "?";
  const text = number.toFixed(decimals);
  return Number(text) === 0 ? (0).toFixed(decimals) : text;
}

/* If the page is embedded in a document, send it the height of the page after every change, because a document cannot
   measure a page opened from file:. */
export function reportHeight() {
  if (window.parent === window) return;
  const root = document.documentElement; // its height includes the margins
  const report = () => window.parent.postMessage({ height: Math.ceil(root.getBoundingClientRect().height) }, "*");
  new ResizeObserver(report).observe(root);
  report();
}
