"""Pages for the browser, one self-contained file each.

``make docs`` writes them: docs/hand.html and those of the book.

The numbers that a page shows are computed here, by the code that the book is about.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import netlib
from docs.making.figures import drawing
from handpose.output.hand_page.assembly import assembled, page, script_of, source
from handpose.output.hand_page.values import body
from handpose.sequences.movements import poses
from handpose.synthetic import prior_file
from handpose.synthetic.pose_prior import BodySampler
from layers.hand import skeleton as skeletons
from netlib.blob import Array
from netlib.engine import Connection
from netlib.files import atomic
from netlib.files.paths import ROOT
from netlib.proto import prototxt

BROWSER = ROOT / "docs" / "book" / "pages"  # the sources of the book's pages
# of drawing.py
COLOURS = ("DATA", "DIFF", "PALE_DATA", "PALE_DIFF", "REST", "PALE_REST", "POSITIVE", "NEGATIVE")


def pages() -> dict[str, str]:
    """Each page as HTML, by the name of its file."""
    return {"hand": hand(), **{name: book_page(name) for name in BOOK}}


def book_page(name: str) -> str:
    """A page of the book, from its sources and its data."""
    title, data = BOOK[name]
    variables = {key.lower().replace("_", "-"): getattr(drawing, key) for key in COLOURS}
    colours = "".join(f"--{name}: {colour}; " for name, colour in variables.items())
    style = f":root {{ {colours}}}\n" + source("common.css", BROWSER)
    main = "<h1>$title</h1>\n" + source(f"{name}.html", BROWSER)
    return assembled(title, data(), main, style, script_of(name, BROWSER))


def hand() -> str:
    """The packaged hand and NYU's, with their named poses; also the book's arm, and the person."""
    packaged = BodySampler(prior_file.load(prior_file.PEOPLE_PRIOR))
    nyu = BodySampler()
    arm = skeletons.load(ROOT / "docs" / "book" / "arm.prototxt")
    person = skeletons.load(ROOT / "prototxt" / "body" / "person.prototxt")
    ours = body("hand", packaged.skeleton, poses(packaged))
    theirs = body("nyu", nyu.skeleton, poses(nyu))
    others = [body("arm", arm), body("person", person, unit_mm=1200.0)]
    return page("The hand", [ours, theirs, *others])


PICTURE = np.array(
    [
        [0, 0, 1, 0, 0, 0],
        [0, 2, 6, 3, 0, 1],
        [1, 6, 9, 8, 2, 0],
        [0, 7, 9, 9, 5, 0],
        [2, 5, 8, 7, 6, 1],
        [0, 1, 4, 5, 2, 0],
    ]
)
KERNEL = np.array([[1, 0, -1], [2, 0, -2], [1, 0, -1]])  # finds vertical edges
LAYERS: dict[str, tuple[str, str]] = {  # title: type and options
    "convolution 3 × 3": ("Convolution", "kernel_size: 3"),
    "convolution 3 × 3, pad 1": ("Convolution", "kernel_size: 3 pad: 1"),
    "convolution 3 × 3, pad 1, stride 2": ("Convolution", "kernel_size: 3 pad: 1 stride: 2"),
    "convolution 3 × 3, dilation 2": ("Convolution", "kernel_size: 3 dilation: 2"),
    "max pooling 2 × 2, stride 2": ("Pooling", "pool: MAX kernel_size: 2 stride: 2"),
    "max pooling 3 × 3, stride 2 (windows overlap)": (
        "Pooling",
        "pool: MAX kernel_size: 3 stride: 2",
    ),
    "mean pooling 2 × 2, stride 2": ("Pooling", "pool: AVE kernel_size: 2 stride: 2"),
}
# The inputs of an output, (input, element, share). Inputs are counted in the padded picture;
# ``element`` is that of the kernel, -1 in pooling; ``share`` is that of an input in a mean, else 0.
Window = list[tuple[int, int, float]]


def windows() -> dict[str, Any]:
    """An entry for each of LAYERS."""
    return {"layers": [_layer(title, kind, options) for title, (kind, options) in LAYERS.items()]}


def _layer(title: str, kind: str, options: str) -> dict[str, Any]:
    """The padded picture, kernel and bias of a layer, dy, and the windows of the outputs.

    All arrays are lists, row by row.
    """
    pad = int(options.partition("pad: ")[2][:1] or 0)
    padded = np.pad(PICTURE, pad)
    y = SmallLayer(kind, options, PICTURE).y
    w, b, is_maximum = None, None, "MAX" in options
    if kind == "Convolution":
        w, b = KERNEL.ravel().tolist(), [0]
        windows = _convolution_windows(options.replace(f" pad: {pad}", ""), padded)
    else:
        windows = _pooling_windows(options.replace("MAX", "AVE"), is_maximum)
    dy = np.random.default_rng(10).integers(-2, 3, y.size)
    return {
        "title": title,
        "maximum": is_maximum,
        "pad": pad,
        "windows": windows,
        "x": padded.ravel().tolist(),
        "w": w,
        "b": b,
        "dy": dy.tolist(),
        "columns": {"x": padded.shape[1], "w": 3, "b": 1, "y": y.shape[1]},
    }


def _convolution_windows(options: str, padded: Array) -> list[Window]:
    """The window of each output of a convolution without pad. In its kernel of the numbers 1 to 9,
    the gradient of an input is the number of its element.
    """
    numbered = np.arange(1, 10).reshape(3, 3)
    found = []
    for gradient in SmallLayer("Convolution", options, padded, numbered).gradients():
        inside = np.flatnonzero(gradient).tolist()
        found.append([(i, int(gradient[i]) - 1, 0.0) for i in inside])
    return found


def _pooling_windows(options: str, is_maximum: bool) -> list[Window]:
    """The window of each output of a mean pooling, where the gradient of an input is its share;
    those of a maximum pooling are the same, without shares.
    """
    found = []
    for gradient in SmallLayer("Pooling", options, PICTURE).gradients():
        inside = np.flatnonzero(gradient).tolist()
        found.append([(i, -1, 0.0 if is_maximum else float(gradient[i])) for i in inside])
    return found


class SmallLayer:
    """A net of one layer, with one picture (H, W) in and one, y (Ho, Wo), out."""

    def __init__(
        self, kind: str, options: str, picture: Array, kernel: Array = KERNEL, bias: float = 0
    ) -> None:
        outputs = " num_output: 1" if kind == "Convolution" else ""
        rows, columns = picture.shape
        text = f"""
        force_backward: true
        layer {{ name: "data" type: "Input" top: "x"
                 input_param {{ shape {{ dim: 1 dim: 1 dim: {rows} dim: {columns} }} }} }}
        layer {{ name: "y" type: "{kind}" bottom: "x" top: "y"
                 {kind.lower()}_param {{ {options}{outputs} }} }}
        """
        param = prototxt.parse(text)
        self.net = netlib.Net(param, netlib.TRAIN, dtype=np.float64, engine="plain")
        if kind == "Convolution":
            w, b = self.net.params["y"]
            w.data[0, 0], b.data[0] = kernel, bias
        self.net.blobs["x"].data[0, 0] = picture
        self.net.run_forward()
        self.y: Array = self.net.blobs["y"].data[0, 0].copy()

    def backward(self, dy: Array) -> Array:
        """dx (H, W) of dy (Ho, Wo). The diffs of the parameters are those of this pass."""
        self.net.clear_param_diffs()
        self.net.blobs["y"].diff[0, 0] = dy
        self.net.run_backward()
        return self.net.blobs["x"].diff[0, 0].copy()

    def gradients(self) -> list[Array]:
        """For each output, row by row, its derivatives by all inputs (H W,)."""
        outputs = np.eye(self.y.size).reshape(-1, *self.y.shape)
        return [self.backward(one).ravel() for one in outputs]


INPUTS = {"x": [2.0], "t": [1.0]}
PARAMS: dict[str, list[Any]] = {
    "first": [[[1.5]]],
    "second": [[[1], [-1]], [0, 1]],
    "out": [[[0.5, 1]]],
}


def new_small_net() -> netlib.Net:
    """The net of docs/book/small.prototxt, with the numbers of chapter 5."""
    net = netlib.Net(
        ROOT / "docs" / "book" / "small.prototxt", netlib.TRAIN, dtype=np.float64, engine="plain"
    )
    for name, values in INPUTS.items():
        net.blobs[name].data[...] = values
    for name, params in PARAMS.items():
        for blob, value in zip(net.params[name], params):
            blob.data[...] = value
    return net


def small_net() -> dict[str, Any]:
    """Layers in order, each with the blobs that it reads and writes, whether it runs backwards, and
    its parameters.
    """
    net = new_small_net()
    name_of = {id(blob): name for name, blob in net.blobs.items()}
    return {
        "inputs": {name: list(values) for name, values in INPUTS.items()},
        "losses": {name: weight for _, weight, name in net.losses},
        "layers": [_step(step, name_of) for step in net.connections],
    }


def _step(step: Connection, name_of: dict[int, str]) -> dict[str, Any]:
    """A layer of the small net; ``name_of`` has the names of the blobs by their ids."""
    layer = step.layer
    operation = layer.param.operation if layer.type == "Reduction" else ""
    return {
        "name": layer.name,
        "type": layer.type,
        "bottom": [name_of[id(blob)] for blob in step.bottom],
        "top": [name_of[id(blob)] for blob in step.top],
        "backward": step.needs_backward,
        "down": list(step.propagate_down),
        "params": [np.asarray(blob.data).tolist() for blob in layer.blobs],
        "operation": operation,
    }


# name of the file: (title, a function of its data)
BOOK: dict[str, tuple[str, Callable[[], dict[str, Any]]]] = {
    "windows": ("Convolution and pooling", windows),
    "small_net": ("A small net, step by step", small_net),
}

if __name__ == "__main__":
    for name, text in pages().items():
        atomic.replace_text(ROOT / "docs" / f"{name}.html", text)
