/* A page within a document asks for the height that it needs; the document's script,
   docs/making/site/assets/embedded.js, knows the frame by its window. A document from the disk could not measure
   the page itself. */

export function askForHeight() {
  if (window.parent === window) return;
  const root = document.documentElement; // as high as its content, with margins
  const ask = () => window.parent.postMessage({ height: Math.ceil(root.getBoundingClientRect().height) }, "*");
  new ResizeObserver(ask).observe(root);
  ask();
}
