"""Data of docs/windows.html: layers that slide a window over a picture, and what each output reads.

The windows are gradients: the diff of one output is 1, that of all others 0, and ``backward`` says which inputs count,
and how much. With a kernel of different numbers the gradient names the element of the kernel. The page computes y, dx,
dw and db from them, for any numbers.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import netlib
from netlib.blob import Array
from netlib.proto import prototxt, schema
from netlib.proto.messages import NetParameter

PICTURE = np.array([
    [0, 0, 1, 0, 0, 0],
    [0, 2, 6, 3, 0, 1],
    [1, 6, 9, 8, 2, 0],
    [0, 7, 9, 9, 5, 0],
    [2, 5, 8, 7, 6, 1],
    [0, 1, 4, 5, 2, 0],
])
SEED = 10
KERNEL = np.array([[1, 0, -1], [2, 0, -2], [1, 0, -1]])  # answers to edges that stand upright
LAYERS: dict[str, tuple[str, str]] = {  # title: type and options
    "convolution 3 × 3": ("Convolution", "kernel_size: 3"),
    "convolution 3 × 3, pad 1": ("Convolution", "kernel_size: 3 pad: 1"),
    "convolution 3 × 3, pad 1, stride 2": ("Convolution", "kernel_size: 3 pad: 1 stride: 2"),
    "convolution 3 × 3, dilation 2": ("Convolution", "kernel_size: 3 dilation: 2"),
    "max pooling 2 × 2, stride 2": ("Pooling", "pool: MAX kernel_size: 2 stride: 2"),
    "max pooling 3 × 3, stride 2 (windows overlap)": ("Pooling", "pool: MAX kernel_size: 3 stride: 2"),
    "mean pooling 2 × 2, stride 2": ("Pooling", "pool: AVE kernel_size: 2 stride: 2"),
}


def data() -> dict[str, Any]:
    """One entry for each of LAYERS."""
    return {"layers": [_entry(title, kind, options) for title, (kind, options) in LAYERS.items()]}


def _entry(title: str, kind: str, options: str) -> dict[str, Any]:
    """Of a layer its padded picture, kernel and bias, dy, and ``windows``: per output [input, element, share].

    All arrays are lists, row by row. Inputs are counted in the padded picture; ``element`` is that of the kernel, -1 in
    pooling; ``share`` is that of an input in a mean, else 0.
    """
    pad = int(options.partition("pad: ")[2][:1] or 0)
    padded = np.pad(PICTURE, pad)
    layer = Layer(kind, options, PICTURE)
    without = Layer(kind, options.replace(f" pad: {pad}", ""), padded)  # the same outputs, the padding as inputs
    assert np.array_equal(layer.y, without.y)
    if kind == "Convolution":
        elements = Layer(kind, without.options, padded, np.arange(1, 10).reshape(3, 3)).shares()
        windows = [[(j, int(n) - 1, 0.0) for j, n in enumerate(row) if n] for row in elements]
    else:
        means = Layer(kind, options.replace("MAX", "AVE"), PICTURE).shares()
        windows = [[(j, -1, 0.0 if "MAX" in options else float(n)) for j, n in enumerate(row) if n] for row in means]
    return {
        "title": title, "maximum": "MAX" in options, "pad": pad, "windows": windows, "x": padded.ravel().tolist(),
        "w": KERNEL.ravel().tolist() if kind == "Convolution" else None, "b": [0] if kind == "Convolution" else None,
        "dy": np.random.default_rng(SEED).integers(-2, 3, layer.y.size).tolist(),
        "columns": {"x": padded.shape[1], "w": 3, "b": 1, "y": layer.y.shape[1]},
    }


class Layer:
    """A net of one layer, with one picture in and one out."""

    def __init__(self, kind: str, options: str, picture: Array, kernel: Array = KERNEL, bias: float = 0) -> None:
        self.options = options
        name, more = kind.lower(), " num_output: 1" if kind == "Convolution" else ""
        text = f"""
            force_backward: true
            layer {{ name: "data" type: "Input" top: "x"
                     input_param {{ shape {{ dim: 1 dim: 1 dim: {picture.shape[0]} dim: {picture.shape[1]} }} }} }}
            layer {{ name: "y" type: "{kind}" bottom: "x" top: "y" {name}_param {{ {options}{more} }} }}"""
        param = schema.read(prototxt.parse(text, "windows"), NetParameter)
        self.net = netlib.Net(param, netlib.TRAIN, dtype=np.float64, engine="plain")
        if kind == "Convolution":
            w, b = self.net.params["y"]
            w.data[0, 0], b.data[0] = kernel, bias
        self.net.blobs["x"].data[0, 0] = picture
        self.net.run_forward()
        self.y: Array = self.net.blobs["y"].data[0, 0].copy()

    def backward(self, dy: Array) -> Array:
        """dx. The diffs of the parameters are those of this pass."""
        self.net.clear_param_diffs()
        self.net.blobs["y"].diff[0, 0] = dy
        self.net.run_backward()
        return self.net.blobs["x"].diff[0, 0].copy()

    def shares(self) -> list[Array]:
        """For each output, in rows, the derivatives by all inputs, in rows."""
        ones = np.eye(self.y.size).reshape(-1, *self.y.shape)
        return [self.backward(one).ravel() for one in ones]
