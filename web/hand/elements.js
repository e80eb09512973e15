/* Small helps for the elements of the page and for numbers. */

/* An element with attributes, listeners (onclick: ...) and children; texts become text, never markup. */
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

/* A number with so many decimals, and no minus before zero. */
export function shown(number, decimals) {
  if (!Number.isFinite(number)) return number > 0 ? "∞" : number < 0 ? "-∞" : "?";
  const text = number.toFixed(decimals);
  return Number(text) === 0 ? (0).toFixed(decimals) : text;
}
