/* Set the height of each embedded page to the height that it reports (reportHeight in
   handpose/output/hand_page/elements.js), so that it has no scroll bar of its own. */

addEventListener("message", ({ source, data }) => {
  if (!Number.isFinite(data?.height)) return;
  for (const frame of document.querySelectorAll("iframe")) {
    if (frame.contentWindow === source) frame.height = Math.min(Math.max(data.height, 100), 6000) + 2; // the border
  }
});
