// Set every formula of the page. pymdownx.arithmatex has put each into an element of its own, as \[ ... \].
for (const element of document.querySelectorAll(".arithmatex")) {
  const formula = element.textContent.trim().replace(/^\\\[|\\\]$/g, "");
  katex.render(formula, element, { displayMode: true });
}
