"""The fast convolution and deconvolution agree with the plain layers, for random shapes and options."""

from __future__ import annotations

import numpy as np
import pytest

import netlib
from fast.convolution import FastConvolution, FastDeconvolution
from netlib import gradcheck
from netlib.blob import Array, Blob, Blobs

CASES = range(60)


def options(rng: np.random.Generator) -> tuple[str, tuple[int, ...]]:
    """Random options and a shape of the bottom; each kind of algorithm has its share."""
    axes = int(rng.choice([1, 2, 2, 2, 2, 3]))
    group = int(rng.choice([1, 1, 2, 3, 8]))
    each = int(rng.integers(1, 4)) * int(rng.choice([1, 1, 8 // min(group, 8)]))
    outputs = group * (int(rng.integers(1, 4)) if rng.random() < 0.7 else each)
    kernel = (
        [int(rng.integers(1, 6 - axes)) for _ in range(axes)]
        if rng.random() < 0.7
        else [int(rng.choice([1, 3]))] * axes
    )
    plain = rng.random() < 0.4
    stride = [1 if plain else int(rng.integers(1, 4)) for _ in range(axes)]
    dilation = [1 if plain else int(rng.integers(1, 3)) for _ in range(axes)]
    pad = [int(rng.integers(0, 4)) for _ in range(axes)]
    sizes = [
        max(d * (k - 1) + 1 - 2 * p, 1) + int(rng.integers(0, 12 // axes)) for k, d, p in zip(kernel, dilation, pad)
    ]
    text = f"num_output: {outputs} group: {group} bias_term: {str(rng.random() < 0.8).lower()} "
    for name, values in (("kernel_size", kernel), ("stride", stride), ("dilation", dilation), ("pad", pad)):
        text += "".join(f"{name}: {value} " for value in values)
    return text + 'weight_filler { type: "gaussian" } bias_filler { type: "gaussian" }', (
        int(rng.choice([1, 2, 3, 7])), group * each, *sizes)  # fmt: skip


def run(kind: str, text: str, x: Array, engine: str, dtype: type, dy: Array | None = None) -> list[Array]:
    """Return y, or dx and the gradients of the parameters for dy."""
    layer = gradcheck.make_layer(f'type: "{kind}" convolution_param {{ {text} }}', [x], engine=engine, dtype=dtype)
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


def compare(kind: str, text: str, shape: tuple[int, ...], rng: np.random.Generator, dtype: type) -> None:
    """Compare forward and backward of both engines."""
    x = rng.normal(size=shape).astype(dtype)
    want = run(kind, text, x, "plain", dtype)
    dy = rng.normal(size=want[0].shape).astype(dtype)
    want += run(kind, text, x, "plain", dtype, dy)
    got = run(kind, text, x, "fast", dtype) + run(kind, text, x, "fast", dtype, dy)
    for number, (one, other) in enumerate(zip(got, want)):
        tolerance = 1e-12 if dtype is np.float64 else 1e-4 if number else 1e-5
        np.testing.assert_allclose(one, other, rtol=0, atol=tolerance * max(np.abs(other).max(), 1e-3))


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
