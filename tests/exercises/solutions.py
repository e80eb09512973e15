"""Solutions with plain loops, as a reader writes them: the bodies of each function by its name."""

from __future__ import annotations

CONVOLUTION = {
    "_outputs": """
H, W = x.shape[2:]
(s, t), (p, q), (d, e), (kh, kw) = self.stride, self.pad, self.dilation, self.kernel
return [(H + 2 * p - d * (kh - 1) - 1) // s + 1, (W + 2 * q - e * (kw - 1) - 1) // t + 1]
""",
    "forward": """
w, b = self.weight.data, self.bias.data if self.param.bias_term else np.zeros(self.param.num_output)
(s, t), (p, q), (d, e), (kh, kw) = self.stride, self.pad, self.dilation, self.kernel
for x, y in zip(bottom, top):
    padded = np.pad(x.data, [(0, 0), (0, 0), (p, p), (q, q)])
    for n, o, h, v in np.ndindex(*y.shape):
        first = o // (len(w) // self.param.group) * w.shape[1]
        window = padded[n, first : first + w.shape[1], h * s :: d, v * t :: e][:, :kh, :kw]
        y.data[n, o, h, v] = (w[o] * window).sum() + b[o]
""",
    "backward": """
w, dw = self.weight.data, self.weight.diff
db = self.bias.diff if self.param.bias_term else np.zeros(self.param.num_output)
(s, t), (p, q), (d, e), (kh, kw) = self.stride, self.pad, self.dilation, self.kernel
for x, y, down in zip(bottom, top, propagate_down):
    padded = np.pad(x.data, [(0, 0), (0, 0), (p, p), (q, q)])
    dx = np.zeros_like(padded)
    for n, o, h, v in np.ndindex(*y.shape):
        first = o // (len(w) // self.param.group) * w.shape[1]
        dy, at = y.diff[n, o, h, v], (slice(first, first + w.shape[1]), slice(h * s, None, d), slice(v * t, None, e))
        db[o] += dy
        dw[o] += dy * padded[n][at][:, :kh, :kw]
        dx[n][at][:, :kh, :kw] += dy * w[o]
    if down:
        x.diff[...] = dx[:, :, p : p + x.shape[2], q : q + x.shape[3]]
""",
}
WITHOUT = {  # what an option adds to the code, and the code without it
    "bias_term": (" if self.param.bias_term else np.zeros(self.param.num_output)", ""),
    "stride": ("self.stride", "(1, 1)"),
    "pad": ("self.pad", "(0, 0)"),
    "dilation": ("self.dilation", "(1, 1)"),
    "group": ("first + w.shape[1]", "None"),
}

POOLING = {
    "_outputs": """
extent = size + 2 * self.pad[i] - self.whole_kernel[i]
count = (extent // self.stride[i] if self.param.round_mode == "FLOOR" else -(-extent // self.stride[i])) + 1
return count - (any(self.pad) and (count - 1) * self.stride[i] >= size + self.pad[i])
""",
    "forward": """
x, y = bottom[0].data, top[0].data
(N, C, H, W), (k, l), (s, t), (p, q) = x.shape, self.kernel, self.stride, self.pad
area, self.winners = self.area(x.shape, y.shape), {}
for n, c, h, v in np.ndindex(*y.shape):
    rows, columns = range(h * s - p, h * s - p + k), range(v * t - q, v * t - q + l)
    inside = [(i, j) for i in rows for j in columns if 0 <= i < H and 0 <= j < W]
    if self.is_max:
        best = max(inside, key=lambda place: x[n, c, place[0], place[1]])
        y[n, c, h, v] = x[n, c, best[0], best[1]]
        self.winners[n, c, h, v] = best
        if len(top) > 1:
            top[1].data[n, c, h, v] = best[0] * W + best[1]
    else:
        y[n, c, h, v] = sum(x[n, c, i, j] for i, j in inside) / area[h, v]
""",
    "backward": """
if not propagate_down[0]:
    return
dx, dy = bottom[0].diff, top[0].diff
(N, C, H, W), (k, l), (s, t), (p, q) = dx.shape, self.kernel, self.stride, self.pad
area = self.area(dx.shape, dy.shape)
dx[...] = 0
for n, c, h, v in np.ndindex(*dy.shape):
    if self.is_max:
        i, j = self.winners[n, c, h, v]
        dx[n, c, i, j] += dy[n, c, h, v]
    else:
        rows, columns = (slice(max(a * b - m, 0), a * b - m + f) for a, b, m, f in ((h, s, p, k), (v, t, q, l)))
        dx[n, c, rows, columns] += dy[n, c, h, v] / area[h, v]
""",
}
