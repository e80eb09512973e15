"""The fast convolution and deconvolution agree with the plain layers, for random
shapes and options.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

import netlib
from fast.columns import Columns
from fast.convolution import ByGroup, Contained, FastConvolution, FastDeconvolution, Turned, choose
from fast.depthwise import Depthwise, Filter
from fast.fusing import After
from fast.geometry import Algorithm, Geometry
from fast.row_winograd import RowWinograd
from fast.rows import Rows
from fast.winograd import Winograd
from netlib import gradcheck
from netlib.blob import Array, Blob, Blobs
from tests.support.nets import inputs

CASES = range(100)
SMALL_BLOCKS = {
    "depthwise.MAX_VALUES": 700,
    "depthwise.BAND_VALUES": 50,
    "depthwise.MIN_CHANNELS": 2,
    "rows.BLOCK_BYTES": 3000,
    "rows.LENGTH": 8,
    "rows.MIN_ROWS": 2,
    "winograd.BLOCK_BYTES": 3000,
    "winograd.MIN_TILES": 6,
    "winograd.MIN_PART": 4,
    "winograd.FEW_TILES": 20,
    "winograd.WEIGHT_BYTES": 900,
    "winograd.MIN_OUTPUTS": 1,
    "winograd.MIN_COST": 0,
    "geometry.MIN_BLOCK_COST": 0,
    "row_winograd.BLOCK_BYTES": 3000,
    "row_winograd.MIN_IMAGES": 1,
    "columns.COLUMN_BYTES": 3000,
    "columns.MIN_COLUMNS": 5,
    "columns.MIN_WINDOWS": 1,
    "fusing.BLOCK": 100,
}


def options(rng: np.random.Generator) -> tuple[str, tuple[int, ...]]:
    """Random options and a shape of the bottom; each kind of algorithm has its share."""

    def pick(*values: int) -> int:
        return int(rng.choice(values))

    axes, group = pick(1, 2, 2, 2, 3), pick(1, 1, 2, 3, 8)
    inputs, outputs = pick(1, 1, 2, 3, 8), pick(1, 1, 2, 3, 8)
    if group == 1 and rng.random() < 0.3:
        inputs, outputs = pick(16, 32, 48), pick(16, 32, 48)
    most = 6 if axes < 3 else 4
    is_square, is_dense = rng.random() < 0.5, rng.random() < 0.5
    kernel = rng.integers(1, most, axes).tolist()
    if is_square:
        kernel = [pick(1, 3, min(5, most))] * axes
    stride = [1 if is_dense else pick(1, 2, 3) for _ in range(axes)]
    dilation = [1 if is_dense else pick(1, 2) for _ in range(axes)]
    pad = [int(rng.integers(0, k + 1)) for k in kernel]
    spare = rng.integers(0, (40, 16, 5)[axes - 1], axes)
    sizes = [
        max(extent - 2 * p, 1) + int(more)
        for extent, p, more in zip(extents(kernel, dilation), pad, spare)
    ]
    bias_term = str(rng.random() < 0.8).lower()
    text = f"num_output: {group * outputs} group: {group} bias_term: {bias_term} "
    fields = {"kernel_size": kernel, "stride": stride, "dilation": dilation, "pad": pad}
    for name, values in fields.items():
        text += "".join(f"{name}: {value} " for value in values)
    shape = pick(0, 1, 2, 3, 9), group * inputs, *sizes
    return text + 'weight_filler { type: "gaussian" } bias_filler { type: "gaussian" }', shape


def extents(kernel: Sequence[int], dilation: Sequence[int]) -> list[int]:
    """The number of values that a window spans on each axis."""
    return [d * (k - 1) + 1 for k, d in zip(kernel, dilation)]


def run(
    kind: str, text: str, x: Array, engine: str, dtype: type, dy: Array | None = None
) -> list[Array]:
    """Return y, or dx and the gradients of the parameters for dy."""
    layer = gradcheck.make_layer(
        f'type: "{kind}" convolution_param {{ {text} }}', [x], engine=engine, dtype=dtype
    )
    if engine == "fast":
        assert isinstance(layer, (FastConvolution, FastDeconvolution))
    bottom, top = Blobs([Blob(x.shape, dtype)]), Blobs([Blob((), dtype)])
    bottom[0].data[...] = x
    layer.reshape(bottom, top)
    top[0].data[...] = bottom[0].diff[...] = np.nan
    if dy is None:
        layer.forward(bottom, top)
        return [top[0].data]
    top[0].diff[...] = dy
    layer.backward(top, [True], bottom)
    layer.backward(top, [True], bottom)  # adds to the gradients of the parameters
    return [bottom[0].diff, *(param.diff for param in layer.blobs)]


def compare(
    kind: str, text: str, shape: tuple[int, ...], rng: np.random.Generator, dtype: type
) -> None:
    """Compare forward and backward of both engines."""
    x = rng.normal(size=shape).astype(dtype)
    expected = run(kind, text, x, "plain", dtype)
    dy = rng.normal(size=expected[0].shape).astype(dtype)
    expected += run(kind, text, x, "plain", dtype, dy)
    found = run(kind, text, x, "fast", dtype) + run(kind, text, x, "fast", dtype, dy)
    of_values, of_gradients = (1e-12, 1e-12) if dtype is np.float64 else (1e-5, 1e-4)
    for number, (fast, plain) in enumerate(zip(found, expected)):
        tolerance = of_gradients if number else of_values
        largest = np.abs(plain).max(initial=1e-3)
        np.testing.assert_allclose(fast, plain, rtol=0, atol=tolerance * largest)


@pytest.mark.parametrize("kind", ["Convolution", "Deconvolution"])
@pytest.mark.parametrize("case", CASES)
def test_random_options(kind: str, case: int) -> None:
    """Any number of spatial axes, kernel, stride, dilation, padding and groups."""
    rng = np.random.default_rng(case)
    text, shape = options(rng)
    try:
        compare(kind, text, shape, rng, np.float64 if case % 2 else np.float32)
    except netlib.NetlibError as error:
        assert "leaves no output" in str(error)


@pytest.mark.parametrize("kind", ["Convolution", "Deconvolution"])
@pytest.mark.parametrize("sizes", [(106, 104), (104, 106), (7, 50)])
@pytest.mark.parametrize("options", ["kernel_size: 3 pad: 2 stride: 3", "kernel_size: 3 pad: 1"])
def test_bottoms_of_several_sizes(
    agree: Callable[..., netlib.Net],
    rng: np.random.Generator,
    kind: str,
    sizes: tuple[int, int],
    options: str,
) -> None:
    """Each bottom may have another algorithm; memory that both use has no values of
    the other one.
    """
    shapes = {f"x{i}": (2, 3, n, n) for i, n in enumerate(sizes)}
    text = (
        f'layer {{ name: "c" type: "{kind}" bottom: "x0" bottom: "x1" top: "y0" top: "y1" convolution_param {{'
        f' num_output: 3 group: 3 {options} weight_filler {{ type: "gaussian" }} }} }}'
    )
    agree(
        f"force_backward: true {inputs(**shapes)} {text}",
        {x: rng.normal(size=shape) for x, shape in shapes.items()},
        tolerance=1e-12,
    )


def geometry_for(algorithm: Algorithm, rng: np.random.Generator, channels: int) -> Geometry:
    """A random geometry that the algorithm supports."""

    axes = 3 if isinstance(algorithm, Rows) and rng.random() < 0.4 else 2

    def each(low: int, high: int) -> tuple[int, ...]:
        return tuple(rng.integers(low, high, axes).tolist())

    if isinstance(algorithm, Depthwise):
        return Geometry(each(1, 5), each(1, 4), each(0, 4), each(1, 3), channels)
    kernel = each(1, 6)
    if isinstance(algorithm, Filter):
        pad = tuple(k // 2 if k % 2 else 0 for k in kernel)
        return Geometry(kernel, each(1, 4), pad, (1, 1), channels)
    stride = dilation = (1,) * axes
    if isinstance(algorithm, Rows):
        dilation = (1, *each(1, 3)[1:])
        if rng.random() < 0.5:
            stride = each(1, 4)
    elif isinstance(algorithm, RowWinograd) and rng.random() < 0.5:
        kernel = (5, 5)
    else:
        kernel = (3, 3)
    pad = tuple(int(rng.integers(0, k)) for k in kernel)
    return Geometry(kernel, stride, pad, dilation, 1)


@pytest.mark.parametrize(
    "algorithm",
    [Filter(), Depthwise(), Rows(), RowWinograd(), Winograd()],
    ids=lambda algorithm: type(algorithm).__name__,
)
@pytest.mark.parametrize("case", range(25))
def test_each_algorithm(algorithm: Algorithm, case: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every algorithm gives the same as Columns, for sizes for which it is not chosen, too, and
    in small blocks.
    """
    rng = np.random.default_rng(case)
    if case % 2:
        for name, value in SMALL_BLOCKS.items():
            monkeypatch.setattr(f"fast.{name}", value)
    N, C = int(rng.integers(0, 6)), int(rng.integers(1, 5))
    g = geometry_for(algorithm, rng, C)
    O = C * int(rng.integers(1, 3)) if g.group > 1 else int(rng.integers(1, 5))
    extent = np.array(g.reach) + 1
    sizes = np.maximum(extent - 2 * np.array(g.pad), 1) + rng.integers(0, 20, len(extent))
    windows = (g.padded(sizes) - extent) // g.stride + 1
    x = rng.normal(size=(N, C, *sizes))
    w = rng.normal(size=(O, C // g.group, *g.kernel))
    dy = rng.normal(size=(N, O, *windows))
    after_y = random_after(rng, O, case // 2)
    after_x = random_after(rng, C, 3 * case)
    y, dx, dw = np.full(dy.shape, np.nan), np.full(x.shape, np.nan), np.ones(w.shape)
    algorithm.correlate(g, x, w, after_y, y)
    expected = np.full(dy.shape, np.nan)
    Columns().correlate(g, x, w, after_y, expected)
    np.testing.assert_allclose(y, expected, rtol=0, atol=1e-11)
    expected = np.full(x.shape, np.nan)
    Columns().transpose(g, dy, w, after_x, expected)
    if "transpose" in type(algorithm).__dict__:
        algorithm.transpose(g, dy, w, after_x, dx)
        np.testing.assert_allclose(dx, expected, rtol=0, atol=1e-11)
    can_turn = set(g.stride) == {1} and O == C and min(g.turned.pad) >= 0
    if can_turn and (not isinstance(algorithm, Filter) or np.array_equal(windows, sizes)):
        for turned in (algorithm, Columns()):
            Turned(turned).transpose(g, dy, w, after_x, dx)
            np.testing.assert_allclose(dx, expected, rtol=0, atol=1e-11)
    if "gradient" in type(algorithm).__dict__:
        algorithm.gradient(g, x, dy, dw)
        expected = np.ones(w.shape)
        Columns().gradient(g, x, dy, expected)
        np.testing.assert_allclose(dw, expected, rtol=0, atol=1e-11)


def random_after(rng: np.random.Generator, channels: int, choice: int) -> After:
    """A gain, a bias and a ReLU, or not, by the bits of ``choice``."""
    gain, bias = rng.normal(size=(2, channels))
    return After(gain if choice & 1 else None, bias if choice & 2 else None, bool(choice & 4))


@pytest.mark.parametrize(
    ("x_shape", "w_shape", "group", "names"),
    [
        ((8, 128, 16, 16), (128, 128, 3, 3), 1, ["Winograd", "Winograd", "Winograd"]),
        ((8, 32, 16, 16), (32, 32, 3, 3), 1, ["RowWinograd", "RowWinograd", "RowWinograd"]),
        ((8, 16, 16, 16), (16, 16, 5, 5), 1, ["RowWinograd", "RowWinograd", "RowWinograd"]),
        ((8, 16, 16, 16), (16, 16, 3, 3), 1, ["Rows", "Rows", "Rows"]),
        ((8, 32, 20, 20), (32, 1, 3, 3), 32, ["Depthwise", "Depthwise", "Depthwise"]),
        ((8, 64, 16, 16), (32, 64, 1, 1), 1, ["Columns", "Columns", "Columns"]),
        ((1, 512, 7, 7), (512, 512, 3, 3), 1, ["Columns", "Columns", "Columns"]),
        ((8, 3, 32, 32), (32, 3, 5, 5), 1, ["Rows", "Columns", "RowWinograd"]),
        ((8, 64, 16, 16), (64, 32, 5, 5), 2, ["RowWinograd", "RowWinograd", "RowWinograd"]),
        ((8, 32, 40, 40), (32, 1, 3, 3), 32, ["Filter", "Filter", "Depthwise"]),
        ((8, 32, 20, 20), (64, 1, 3, 3), 32, ["Depthwise", "Depthwise", "Depthwise"]),
        ((8, 64, 20, 20), (32, 2, 3, 3), 32, ["Columns", "Depthwise", "Columns"]),
        ((2, 16, 8, 16, 16), (16, 16, 3, 3, 3), 1, ["Rows", "Rows", "Rows"]),
    ],
)
def test_the_algorithm_that_is_chosen(
    x_shape: tuple[int, ...], w_shape: tuple[int, ...], group: int, names: list[str]
) -> None:
    pad = tuple(k // 2 for k in w_shape[2:])
    g = Geometry(w_shape[2:], (1, 1), pad, (1, 1), group)
    chosen = choose(g, x_shape, (x_shape[0], w_shape[0], *x_shape[2:]))
    assert [name_of(a) for a in (chosen.for_y, chosen.for_dx, chosen.for_dw)] == names


def test_the_general_algorithm_computes_maps_with_dilation() -> None:
    g = Geometry((3, 3), (1, 1), (2, 2), (2, 2), 1)
    chosen = choose(g, (2, 128, 32, 32), (2, 128, 32, 32))
    names = [name_of(a) for a in (chosen.for_y, chosen.for_dx, chosen.for_dw)]
    assert names == ["Columns"] * 3


def name_of(algorithm: Algorithm) -> str:
    """The name of an algorithm, without its adapters."""
    while isinstance(algorithm, (ByGroup, Contained, Turned)):
        algorithm = algorithm.algorithm
    return type(algorithm).__name__


@pytest.mark.parametrize("kind", ["DepthwiseConvolution", "ConvolutionDepthwise"])
def test_the_types_of_forks_have_the_depthwise_algorithm(kind):
    options = "num_output: 8 group: 8 kernel_size: 3 pad: 1"
    x = np.zeros((2, 8, 20, 20), np.float32)
    found = []
    for type_ in ("Convolution", kind):
        layer: Any = gradcheck.make_layer(
            f'type: "{type_}" convolution_param {{ {options} }}',
            [x],
            dtype=np.float32,
            engine="fast",
        )
        layer.reshape([Blob(x.shape)], [Blob(())])
        [chosen] = layer.algorithms
        found.append([type(getattr(chosen, part)) for part in ("for_y", "for_dx", "for_dw")])
    assert found[0] == found[1] == [Depthwise] * 3
