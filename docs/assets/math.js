// Typeset every formula of the page. pymdownx.arithmatex has wrapped each in an element, as \[ ... \].
for (const element of document.querySelectorAll(".arithmatex")) {
  const formula = element.textContent.trim().replace(/^\\\[|\\\]$/g, "");
  katex.render(formula, element, { displayMode: true });
}
