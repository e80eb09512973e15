/* Each embedded page says how high it is (reportHeight in handpose/output/hand_page/elements.js): so it does not scroll inside the document. */

addEventListener("message", ({ source, data }) => {
  if (!Number.isFinite(data?.height)) return;
  for (const frame of document.querySelectorAll("iframe")) {
    if (frame.contentWindow === source) frame.height = Math.min(Math.max(data.height, 100), 6000) + 2; // the border
  }
});
