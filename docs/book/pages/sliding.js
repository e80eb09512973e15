/* Forward and backward passes of a layer that slides a window over a picture. Arrays are flat lists, row by row.

   `windows[i]` lists the inputs of output i: [index of the input in the padded picture, element of the kernel or −1,
   share]. The share is the factor of the input in mean pooling; a convolution uses its kernel instead. */

const sum = (values) => values.reduce((total, value) => total + value, 0);

/* The index in the window of its largest input, the first one of several. */
function winnerOf(window, x) {
  let best = 0;
  window.forEach(([j], n) => {
    if (x[j] > x[window[best][0]]) best = n;
  });
  return best;
}

/* The factor of each input of output i in y[i]. The input's diff receives this factor times dy[i]. */
export function factors({ windows, w, maximum }, x, i) {
  const window = windows[i], winner = maximum ? winnerOf(window, x) : -1;
  return window.map(([, element, share], n) => (w ? w[element] : maximum ? Number(n === winner) : share));
}

/* Compute y, and dx, dw and db from the first `count` outputs. */
export function slide(layer, count = layer.windows.length) {
  const { x, w, b, dy, windows } = layer;
  const y = windows.map((window, i) => {
    const given = factors(layer, x, i);
    return sum(window.map(([j], n) => given[n] * x[j])) + (w ? b[0] : 0);
  });
  const dx = x.map(() => 0), dw = w ? w.map(() => 0) : [], db = w ? [0] : [];
  windows.slice(0, count).forEach((window, i) => {
    const given = factors(layer, x, i);
    window.forEach(([j, element], n) => {
      dx[j] += given[n] * dy[i];
      if (w) dw[element] += x[j] * dy[i];
    });
    if (w) db[0] += dy[i];
  });
  return { y, dx, dw, db };
}
