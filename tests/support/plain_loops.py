"""Layers by their definitions, as loops over single numbers, to compare the other
implementations with.
"""

import numpy as np


def convolve(x, w, b, stride=1, pad=0, dilation=1, group=1):
    """Compute a convolution by its definition.

    Stride, pad and dilation are one number, or one per spatial axis.
    """
    axes, C = x.ndim - 2, len(w) // group
    stride, pad, dilation = (np.broadcast_to(numbers, axes) for numbers in (stride, pad, dilation))
    padded = np.pad(x, [(0, 0), (0, 0), *((p, p) for p in pad)])
    reach = dilation * (np.array(w.shape[2:], int) - 1) + 1
    places = (np.array(padded.shape[2:], int) - reach) // stride + 1
    y = np.zeros((len(x), len(w), *places))
    for o, *place in np.ndindex(y.shape[1:]):
        first = o // C * w.shape[1]
        starts = np.array(place, int) * stride
        window = [slice(start, start + r, d) for start, r, d in zip(starts, reach, dilation)]
        values = padded[(slice(None), slice(first, first + w.shape[1]), *window)]
        products = (values * w[o]).reshape(len(x), -1)
        y[(slice(None), o, *place)] = b[o] + products.sum(axis=1)
    return y


def check_transpose(dy, x, w, b, dx, dw, db, convolve):
    """Check that y is linear in x, w and b: for any direction v, <dy, y(v)> is <dx, v>."""
    rng, zero = np.random.default_rng(2), np.zeros_like(b)
    for _ in range(3):
        v, u = rng.normal(size=x.shape), rng.normal(size=w.shape)
        assert np.isclose((dx * v).sum(), (dy * convolve(v, w, zero)).sum())
        assert np.isclose((dw * u).sum(), (dy * convolve(x, u, zero)).sum())
    assert np.allclose(db, dy.sum(axis=(0, 2, 3)))


def outputs(size, kernel, stride, pad, ceil=True):
    """Return the number of windows along one axis."""
    extent = size + 2 * pad - kernel
    count = (-(-extent // stride) if ceil else extent // stride) + 1
    return count - 1 if pad and (count - 1) * stride >= size + pad else count


def pool(x, kernel, stride, pad, mean=False, ceil=True):
    """Compute a pooling by its definition: the outputs and the share of each input in each output,
    as (y, weights).
    """
    H, W = size = x.shape[2:]
    counts = [outputs(*axis, ceil) for axis in zip(size, kernel, stride, pad)]
    y = np.zeros((*x.shape[:2], *counts))
    share = np.zeros((*y.shape, H, W))
    for n, c, h, w in np.ndindex(y.shape):
        starts = h * stride[0] - pad[0], w * stride[1] - pad[1]
        ends = [min(start + k, s + p) for start, k, s, p in zip(starts, kernel, size, pad)]
        area = (ends[0] - starts[0]) * (ends[1] - starts[1])
        rows = slice(max(starts[0], 0), min(ends[0], H))
        columns = slice(max(starts[1], 0), min(ends[1], W))
        window = x[n, c, rows, columns]
        if mean:
            y[n, c, h, w] = window.sum() / area
            share[n, c, h, w, rows, columns] = 1 / area
        else:
            y[n, c, h, w] = window.max()
            i, j = np.unravel_index(window.argmax(), window.shape)  # the first of equal values
            share[n, c, h, w, rows.start + i, columns.start + j] = 1
    return y, share
