"""An infinite value or NaN reaches the same results with the fast engine as with the plain one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy

import netlib
from fast.geometry import NotFiniteError, check_spread
from netlib import gradcheck
from netlib.blob import Array, Blob, Blobs
from netlib.proto import prototxt
from tests.fast.test_convolution_fast import name_of
from tests.support.nets import inputs

VALUES = [np.inf, -np.inf, np.nan, 3e38]  # the last is finite, but its transforms are not
# Type, options, the shape of the bottom, and the algorithms of y, dx and dw of the convolution
CASES: list[tuple[str, str, tuple[int, ...], list[str]]] = [
    ("Convolution", "num_output: 48 kernel_size: 3 pad: 1", (7, 48, 16, 16), ["Winograd"] * 3),
    ("Convolution", "num_output: 48 kernel_size: 3 pad: 1", (5, 48, 32, 32), ["Winograd"] * 3),
    (
        "Convolution",
        "num_output: 64 kernel_size: 3 pad: 1 group: 2",
        (8, 64, 9, 10),
        ["RowWinograd"] * 3,
    ),
    ("Convolution", "num_output: 16 kernel_size: 5 pad: 2", (8, 16, 13, 14), ["RowWinograd"] * 3),
    ("Convolution", "num_output: 16 kernel_size: 3 pad: 1", (8, 16, 13, 14), ["Rows"] * 3),
    ("Convolution", "num_output: 2 kernel_size: 3 pad: 1", (8, 4, 13, 14), ["Columns"] * 3),
    (
        "Convolution",
        "num_output: 8 group: 4 kernel_size: 3 pad: 1",
        (3, 4, 12, 11),
        ["Depthwise"] * 3,
    ),
    (
        "Convolution",
        "num_output: 4 group: 4 kernel_size: 5 pad: 2",
        (3, 4, 12, 1),
        ["Depthwise"] * 3,
    ),
    (
        "Convolution",
        "num_output: 8 group: 4 kernel_size: 3 pad: 1",
        (3, 4, 20, 21),
        ["Depthwise"] * 3,
    ),
    (
        "Convolution",
        "num_output: 4 group: 4 kernel_size: 3 pad: 1",
        (3, 4, 40, 41),
        ["Filter", "Filter", "Depthwise"],
    ),
    (
        "Convolution",
        "num_output: 4 group: 4 kernel_size: 9 pad: 4",
        (3, 4, 40, 41),
        ["Depthwise"] * 3,
    ),
    (
        "Convolution",
        "num_output: 4 group: 4 kernel_size: 3 pad: 1",
        (3, 8, 9, 9),
        ["Columns", "Depthwise", "Columns"],
    ),
    (
        "Convolution",
        "num_output: 16 kernel_size: 3 pad: 2 dilation: 2",
        (2, 16, 32, 30),
        ["Columns"] * 3,
    ),
    ("Deconvolution", "num_output: 48 kernel_size: 3 pad: 1", (7, 48, 16, 16), ["Winograd"] * 3),
    (
        "Deconvolution",
        "num_output: 4 kernel_size: 4 pad: 1 stride: 2",
        (3, 5, 9, 9),
        ["Columns"] * 3,
    ),
]


def passes(engine: str, kind: str, options: str, arrays: list[Array]) -> tuple[list[Array], Any]:
    """Return y, dx and the gradients of the parameters for x, w and dy, and the layer."""
    x, w, dy = arrays
    layer: Any = gradcheck.make_layer(
        f'type: "{kind}" convolution_param {{ {options} }}', [x], engine=engine, dtype=np.float32
    )
    bottom, top = Blobs([Blob(x.shape, np.float32)]), Blobs([Blob((), np.float32)])
    layer.reshape(bottom, top)
    bottom[0].data[...], layer.weight.data[...], top[0].diff[...] = x, w, dy
    with np.errstate(all="ignore"):
        layer.forward(bottom, top)
        layer.backward(top, [True], bottom)
    return [top[0].data, bottom[0].diff, *(param.diff for param in layer.blobs)], layer


def check_equal(fast: list[Array], plain: list[Array]) -> None:
    """The same values are finite, and those are equal."""
    for found, expected in zip(fast, plain):
        finite = np.isfinite(expected)
        np.testing.assert_array_equal(np.isfinite(found), finite)
        tolerance = 1e-4 * np.abs(expected[finite]).max(initial=1e-3)
        np.testing.assert_allclose(found[finite], expected[finite], rtol=0, atol=tolerance)


@pytest.mark.parametrize(("kind", "options", "shape", "names"), CASES)
def test_convolutions(kind: str, options: str, shape: tuple[int, ...], names: list[str]) -> None:
    """One such value in x, in w or in dy, anywhere in a tile of any algorithm."""
    rng = np.random.default_rng(0)
    text = f'type: "{kind}" convolution_param {{ {options} }}'
    layer = gradcheck.make_layer(text, [np.zeros(shape)])
    bottom, top = Blobs([Blob(shape)]), Blobs([Blob(())])
    layer.reshape(bottom, top)
    shapes = (shape, layer.blobs[0].shape, top[0].shape)  # of x, w and dy
    ordinary = [0.05 * rng.normal(size=size).astype(np.float32) for size in shapes]
    for value in VALUES:
        for i in range(3):
            arrays = [array.copy() for array in ordinary]
            arrays[i].reshape(-1)[rng.integers(arrays[i].size)] = value
            expected, _ = passes("plain", kind, options, arrays)
            found, layer = passes("fast", kind, options, arrays)
            check_equal(found, expected)
    [chosen] = layer.algorithms
    assert [name_of(a) for a in (chosen.for_y, chosen.for_dx, chosen.for_dw)] == names


def test_a_weight_of_zero_times_infinity() -> None:
    """It is NaN, also where OpenCV would omit the weight."""
    rng = np.random.default_rng(0)
    shapes = (1, 2, 40, 40), (2, 1, 3, 3), (1, 2, 40, 40)
    x, w, dy = (rng.normal(size=shape).astype(np.float32) for shape in shapes)
    x[0, 0, 20, 20] = np.inf
    w[0, 0, 0, 1] = 0
    options = "num_output: 2 group: 2 kernel_size: 3 pad: 1"
    fast, _ = passes("fast", "Convolution", options, [x, w, dy])
    plain, _ = passes("plain", "Convolution", options, [x, w, dy])
    check_equal(fast, plain)


NET = """
force_backward: %s
layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 3 dim: 1 dim: 32 dim: 32 } } }
layer { name: "c1" type: "Convolution" bottom: "x" top: "y1"
        convolution_param { num_output: 4 kernel_size: 5 weight_filler { type: "gaussian" std: 0.1 } } }
layer { name: "p1" type: "Pooling" bottom: "y1" top: "z1" pooling_param { kernel_size: 4 stride: 4 } }
layer { name: "c2" type: "Convolution" bottom: "z1" top: "y2"
        convolution_param { num_output: 3 kernel_size: 3 weight_filler { type: "gaussian" std: 0.1 } } }
layer { name: "p2" type: "Pooling" bottom: "y2" top: "z2" pooling_param { kernel_size: 2 stride: 2 } }
"""


@pytest.mark.parametrize("force", ["true", "false"], ids=["tiles", "windows without background"])
@pytest.mark.parametrize("place", ["x", "c1", "c2"])
def test_convolutions_on_tiles(force: str, place: str) -> None:
    """One such value in x or in the weights of a layer; the next pass is without it."""
    rng = np.random.default_rng(0)
    x = rng.uniform(-1, 1, (3, 1, 32, 32))
    # With a gradient of x, rounding would decide which value of a background is the largest.
    if force == "false":
        x[:, :, :6] = x[:, :, 20:] = 1
    nets = [
        netlib.Net(prototxt.parse(NET % force), netlib.TRAIN, engine=engine, seed=1)
        for engine in ("plain", "fast")
    ]
    dz = rng.normal(size=nets[0].forward(x=x)["z2"].shape)
    for value in [0, np.inf, -np.inf, np.nan, 0]:
        index, results = int(rng.integers(9)), []
        for net in nets:
            image = x.copy()
            values = image[1, 0, 8, 9:20] if place == "x" else net.params[place][0].data.reshape(-1)
            values[index] = value
            z = net.forward(x=image)["z2"].copy()
            net.clear_param_diffs()
            net.backward(z2=dz)
            dx = [net.blobs["x"].diff.copy()] if force == "true" else []
            results.append([z, *dx, *(param.blob.diff.copy() for param in net.learnable)])
            values[index] = 0.1
        plain, fast = results
        check_equal(fast, plain)


LAYERS = [
    *(
        f'type: "Pooling" pooling_param {{ pool: {pool} {windows} }}'
        for pool in ("MAX", "AVE")
        for windows in (
            "kernel_size: 3 stride: 2",
            "kernel_size: 3 stride: 1 pad: 1",
            "kernel_size: 6 stride: 2 pad: 2",
            "kernel_size: 2 stride: 2",
            "global_pooling: true",
        )
    ),
    'type: "LRN" lrn_param { local_size: 3 }',
    'type: "LRN" lrn_param { local_size: 3 norm_region: WITHIN_CHANNEL }',
]


@pytest.mark.parametrize("phase", [netlib.TRAIN, netlib.TEST])
@pytest.mark.parametrize("layer", LAYERS)
def test_engines_agree_on_pooling_and_normalization(layer: str, phase: int) -> None:
    """One such value in x or in dy of a pooling, with winners and without, or of a
    normalization.
    """
    rng = np.random.default_rng(0)
    text = (
        'force_backward: true layer { name: "x" type: "Input" top: "x" '
        "input_param { shape { dim: 2 dim: 4 dim: 11 dim: 12 } } }\n"
        f'layer {{ name: "p" bottom: "x" top: "y" {layer} }}'
    )
    nets = [netlib.Net(prototxt.parse(text), phase, engine=engine) for engine in ("plain", "fast")]
    for value in [*VALUES[:3], *VALUES[:3]]:
        x = rng.normal(size=(2, 4, 11, 12))
        dy = rng.normal(size=nets[0].forward(x=x)["y"].shape)
        for array in (x, dy):
            ordinary = array.copy()
            array.reshape(-1)[rng.integers(array.size)] = value
            results = []
            for net in nets:
                y = net.forward(x=x)["y"].copy()
                net.backward(y=dy)
                results.append([y, net.blobs["x"].diff.copy()])
            plain, fast = results
            check_equal(fast, plain)
            array[...] = ordinary


@pytest.mark.parametrize("share", [0, 1e-3, 0.03])
@pytest.mark.parametrize(("channels", "size", "kernel"), [(64, 28, 3), (32, 16, 3), (16, 28, 5)])
def test_large_values_spoil_only_their_windows(
    channels: int, size: int, kernel: int, share: float
) -> None:
    """Outputs whose windows do not contain one of the values 65535, as of depth sensors, are
    right to 1e-3.
    """
    rng = np.random.default_rng(1)
    x = rng.normal(size=(8, channels, size, size)).astype(np.float32)
    is_large = rng.random((8, size, size)) < share
    is_large[0, 5, 5] = True
    x[:, 0][is_large] = 65535
    options = f"num_output: {channels} kernel_size: {kernel} pad: {kernel // 2} weight_filler {{ type: 'msra' }}"
    text = f'layer {{ name: "c" type: "Convolution" bottom: "x" top: "y" convolution_param {{ {options} }} }}'
    model = prototxt.parse(inputs(x=x.shape) + text)
    nets = (
        netlib.Net(model, netlib.TEST, engine=engine, dtype=dtype, seed=1)
        for engine, dtype in (("plain", np.float64), ("fast", np.float32))
    )
    has_large = scipy.ndimage.maximum_filter(is_large, size=(1, kernel, kernel))
    expected, found = (net.forward(x=x)["y"].swapaxes(0, 1)[:, ~has_large] for net in nets)
    assert np.abs(found - expected).max() <= 1e-3 * expected.std()


@pytest.mark.parametrize("values", ["normal", "half zeros", "black background", "long tail"])
def test_ordinary_values_are_not_taken_for_large_ones(values: str) -> None:
    """The guard accepts the sums of ordinary inputs, and not those with one of 65535."""
    rng = np.random.default_rng(0)
    shape = (2, 64, 24, 24)
    x = rng.standard_t(3, shape) if values == "long tail" else rng.normal(size=shape)
    x = x.astype(np.float32)
    if values == "half zeros":
        np.maximum(x, 0, out=x)
    elif values == "black background":
        x[..., 8:] = 0
    means = scipy.ndimage.uniform_filter(x, (0, 0, 3, 3))
    sums = np.tensordot(rng.normal(size=(64, 64)), means, (1, 1))
    check_spread(sums, x, 64)
    x[0, 0, 5, 5] = 65535
    with pytest.raises(NotFiniteError):
        check_spread(sums + 65535 * (np.abs(sums) > 3 * sums.std()), x, 64)
