"""Weights of NVIDIA's and Intel's BatchNorm, with a scale and a bias inside, in nets with a
BatchNorm and a Scale.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

import netlib
from netlib.errors import WeightsError
from netlib.net import Net
from netlib.proto import prototxt, schema, wire
from netlib.proto.messages import BlobProto, BlobShape, LayerParameter, NetParameter
from netlib.proto.net_parameter import load_parameter
from tests.support.hdf5_files import write_hdf5
from tests.support.nets import inputs

Array = NDArray[np.float32]

MEAN, VARIANCE = np.float32([0.1, 0.2, 0.3]), np.float32([1, 2, 3])
GAIN, BIAS = np.float32([2, 3, 4]), np.float32([0.5, 0.6, 0.7])
ONE = np.ones(1, np.float32)
FIVE = MEAN, VARIANCE, ONE, GAIN, BIAS
SHAPE = (2, 3, 2, 2)
X = np.random.default_rng(0).normal(size=SHAPE).astype(np.float32)


def batch_norm(options: str = "") -> str:
    return f'layer {{ name: "bn" type: "BatchNorm" bottom: "x" top: "y" {options} }} '


def scale(top: str = "y") -> str:
    options = "scale_param { bias_term: true }"
    return f'layer {{ name: "sc" type: "Scale" bottom: "y" top: "{top}" {options} }} '


RELU = 'layer { name: "r" type: "ReLU" bottom: "y" top: "y" relu_param { negative_slope: 1 } } '
NETS = {
    "scale_bias": batch_norm("batch_norm_param { scale_bias: true }") + RELU,
    "fillers": batch_norm(
        "batch_norm_param { scale_filler { value: 1 } bias_filler { value: 0 } }"
    ),
    "Intel": batch_norm("batch_norm_param { use_weight_bias: true bias_term: true }"),
    "a Scale in place": batch_norm() + scale(),
    "a Scale": batch_norm() + scale("z"),
}


def expected(gain: Array = GAIN, bias: Array = BIAS) -> Array:
    wide = (-1, 1, 1)
    normal = (X - MEAN.reshape(wide)) / np.sqrt(VARIANCE + 1e-5).reshape(wide)
    return np.asarray(normal * gain.reshape(wide) + bias.reshape(wide), np.float32)


def binary(folder: Path, **layers: Sequence[Array]) -> str:
    """A caffemodel with these arrays."""
    specs = tuple(
        LayerParameter(name, blobs=tuple(BlobProto(BlobShape(a.shape), a.ravel()) for a in arrays))
        for name, arrays in layers.items()
    )
    path = folder / "nvidia.caffemodel"
    path.write_bytes(wire.encode(schema.to_tree(NetParameter(layer=specs)), NetParameter))
    return str(path)


OutputOf = Callable[[str, Path | str], Array]


@pytest.fixture
def output_of(net_of: Callable[..., Net]) -> OutputOf:
    """``output_of(form, weights)``: the output of a net of this form with all weights of a file."""

    def output(form: str, weights: Path | str) -> Array:
        net = net_of(inputs(x=SHAPE) + NETS[form], phase=netlib.TEST)
        assert net.copy_from(weights, strict=True) == ([], [])
        (found,) = net.forward(x=X).values()
        return found

    return output


@pytest.mark.parametrize("form", list(NETS))
def test_a_net_computes_what_the_fork_computes(
    form: str, output_of: OutputOf, tmp_path: Path
) -> None:
    assert_allclose(output_of(form, binary(tmp_path, bn=FIVE)), expected(), rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("arrays", [
    [MEAN, VARIANCE, 0 * ONE, GAIN, BIAS],
    [4 * MEAN, 4 * VARIANCE, 4 * ONE, GAIN, BIAS],
    [GAIN, BIAS, MEAN, VARIANCE, ONE],
    [a.reshape(1, -1, 1, 1) for a in (GAIN, BIAS, MEAN, VARIANCE, ONE)],
], ids=["factor 0", "sums", "older order", "four axes"])  # fmt: skip
def test_forms_of_the_five_parameters(
    arrays: Sequence[Array], output_of: OutputOf, tmp_path: Path
) -> None:
    found = output_of("scale_bias", binary(tmp_path, bn=arrays))
    assert_allclose(found, expected(), rtol=1e-5, atol=1e-6)


def test_a_file_with_both_scales(output_of: OutputOf, tmp_path: Path) -> None:
    found = output_of("a Scale", binary(tmp_path, bn=FIVE, sc=[BIAS, GAIN]))
    assert_allclose(found, expected(BIAS * GAIN, BIAS * BIAS + GAIN), rtol=1e-5)


def test_hdf5(output_of: OutputOf, tmp_path: Path) -> None:
    path = tmp_path / "w.caffemodel.h5"
    write_hdf5(path, **{f"data/bn/{i}": array for i, array in enumerate(FIVE)})
    assert_allclose(output_of("a Scale", path), expected(), rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("after", ["", RELU, scale().replace("true", "false")])
def test_a_net_without_the_scale_is_refused_with_the_way_out(
    after: str, net_of: Callable[..., Net], tmp_path: Path
) -> None:
    net = net_of(inputs(x=SHAPE) + batch_norm() + after)
    with pytest.raises(
        WeightsError, match=r"'bn' has 5 parameters.* NVIDIA's.*scale_bias: true.*Scale"
    ):
        net.copy_from(binary(tmp_path, bn=FIVE))


def test_statistics_that_count_as_zero_are_mentioned(
    net_of: Callable[..., Net], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    net = net_of(inputs(x=SHAPE) + batch_norm())
    net.copy_from(binary(tmp_path, bn=[MEAN, VARIANCE, 0 * ONE]))
    assert "the factor is 0" in caplog.text


def test_the_net_is_written_as_a_batch_norm_and_a_scale(tmp_path: Path) -> None:
    """The Scale has the rules of the layer and the rates of scale and bias, and a
    name that is free.
    """
    fillers = "scale_filler { value: 2 } bias_filler { value: 3 }"
    rates = "".join(f"param {{ lr_mult: {rate} }} " for rate in (0, 0, 0, 5, 6))
    text = batch_norm(
        f"{rates} include {{ phase: TEST }} batch_norm_param {{ scale_bias: true eps: 0.01 {fillers} }}"
    )
    other = 'layer { name: "bn_scale" type: "ReLU" bottom: "y" top: "y" } '
    read = load_parameter(prototxt.parse(text + other))
    norm, made, _ = read.layer
    assert [one.name for one in read.layer] == ["bn", "bn_scale_", "bn_scale"]
    assert str(norm.blocks["batch_norm_param"]) == "eps: 0.01\n"
    assert (made.bottom, made.top, made.include) == (("y",), ("y",), norm.include)
    assert [one.lr_mult for one in made.param] == [5, 6]
    options = "bias_term: true\nfiller {\n  value: 2\n}\nbias_filler {\n  value: 3\n}\n"
    assert str(made.blocks["scale_param"]) == options


def test_a_net_without_weights_trains_the_scale(net_of: Callable[..., Net]) -> None:
    net = net_of(inputs(x=SHAPE) + NETS["scale_bias"], phase=netlib.TRAIN)
    assert [blob.data.tolist() for blob in net.params["bn_scale"]] == [[1, 1, 1], [0, 0, 0]]
    assert [(p.layer, p.spec.lr_mult) for p in net.learnable if p.spec.lr_mult] == [
        ("bn_scale", 1)
    ] * 2
