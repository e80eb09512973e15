"""export/onnx/check.py: differences that rounding explains are accepted, and mistakes of
0.1% are found.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from export.onnx.check import (
    TOLERANCE,
    Difference,
    _in_float64,
    _rounding_errors,
    compared,
    difference,
    differences,
)
from export.onnx.net import load, onnx_image
from netlib.net import Net


@dataclass
class Case:
    """A net that amplifies rounding.

    layers       after an inner product x0 -> y
    mistakes     constants of the file, and attributes of operators, whose change by
                 0.1% must be found
    shape        of x0
    variance     of a BatchNorm
    """

    layers: str
    mistakes: list[str]
    shape: tuple[int, ...] = (1, 20)
    variance: float = 1.0


def layer(name: str, kind: str, options: str = "", bottom: str = "y", top: str = "z") -> str:
    bottoms = " ".join(f'bottom: "{one}"' for one in bottom.split())
    return f'layer {{ name: "{name}" type: "{kind}" {bottoms} top: "{top}" {options} }}'


def fc(name: str, bottom: str, top: str) -> str:
    """Return an inner product; all of a net have the same parameters."""
    shared = 'param { name: "w" } param { name: "b" } inner_product_param { num_output: 12 }'
    return layer(name, "InnerProduct", shared, bottom, top)


def power(name: str, options: str, bottom: str, top: str) -> str:
    return layer(name, "Power", f"power_param {{ {options} }}", bottom, top)


SOFTMAX = layer("p", "Softmax", bottom="s", top="p")
MAPS = layer(
    "r", "Reshape", "reshape_param { shape { dim: 0 dim: 3 dim: 2 dim: 2 } }", bottom="s", top="r"
)
CASES = {
    "Softmax, differences of 1e3": Case(
        power("s", "scale: 300", "y", "s") + SOFTMAX, ["fc/weight", "s/scale", "p/Softmax axis"]
    ),
    "Softmax, sums of 1e3": Case(
        power("s", "shift: 1000", "y", "s") + SOFTMAX, ["fc/weight", "s/shift", "p/Softmax axis"]
    ),
    "Log": Case(
        power("s", "scale: 0.001 shift: 1", "y", "s") + layer("l", "Log", bottom="s"),
        ["fc/weight", "s/shift"],
    ),
    "Power": Case(
        power("s", "power: 2", "y", "s") + power("t", "power: -1.5 shift: 0.001", "s", "t"),
        ["fc/weight", "s/power", "t/power", "t/shift"],
    ),
    "Exp": Case(layer("e", "Exp", "exp_param { scale: 10 }"), ["fc/weight", "fc/bias", "e/scale"]),
    "MVN": Case(
        power("s", "shift: 1000", "y", "s") + MAPS + layer("m", "MVN", bottom="r"), ["s/shift"]
    ),
    "BatchNorm": Case(
        layer("b", "BatchNorm"),
        ["fc/weight", "b/gain", "b/mean", "b/variance", "b/BatchNormalization epsilon"],
        variance=1e-5,
    ),
    "Normalize": Case(
        power("s", "scale: 0.00001", "y", "s") + MAPS + layer("n", "Normalize", bottom="r"),
        ["fc/weight", "s/scale", "n/shift", "n/scale"],
    ),
    "Eltwise": Case(
        power("s", "scale: 1.0001", "x0", "s")
        + fc("fc2", "s", "y2")
        + layer("e", "Eltwise", "eltwise_param { coeff: 1 coeff: -1 }", "y y2"),
        ["fc/weight", "fc2/bias", "s/scale", "e/scale"],
    ),
    "Power, shifts": Case(
        power("s", "shift: 10000", "y", "s") + power("t", "shift: -10000", "s", "t"),
        ["s/shift", "t/shift"],
    ),
    "ArgMax": Case(layer("a", "ArgMax", "argmax_param { axis: 1 }"), ["fc/weight", "fc/bias"]),
}


@pytest.fixture
def net(request, files) -> Net:
    """The net of the case that the test names."""
    case = CASES[request.param]
    found = load(*files(fc("fc", "x0", "y") + case.layers, case.shape))
    if "b" in found.params:
        found.params["b"][1].data[...] *= case.variance
    return found


def wrong(image: bytes, mistake: str, onnx) -> bytes:
    """Change a constant, or the attribute of an operator, by 0.1%, or an axis to 0."""
    model = onnx.load_from_string(image)
    name, _, attribute = mistake.partition(" ")
    if attribute:
        (node,) = (node for node in model.graph.node if node.name == name)
        (value,) = (value for value in node.attribute if value.name == attribute)
        if attribute == "axis":
            value.i = 0
        else:
            value.f *= 1.001
    else:
        (constant,) = (constant for constant in model.graph.initializer if constant.name == name)
        values = np.float32(1.001) * onnx.numpy_helper.to_array(constant)
        constant.CopyFrom(onnx.numpy_helper.from_array(values, name))
    return model.SerializeToString()


def largest(*found: dict[str, Difference]) -> float:
    """Return the largest difference as a multiple of what rounding explains."""
    return max(difference.found / difference.limit for of in found for difference in of.values())


@pytest.mark.parametrize("net", CASES, indirect=True)
def test_a_correct_file_passes(net):
    """Rounding explains the differences of outputs and layers, though some are above 1e-5 of the
    largest value.
    """
    assert largest(*differences(onnx_image(net), net, (1, 3))) <= 1


@pytest.mark.parametrize(
    ("net", "mistake"),
    [(name, mistake) for name, case in CASES.items() for mistake in case.mistakes],
    indirect=["net"],
)
def test_mistakes_are_found(net, mistake, onnx):
    assert largest(*differences(wrong(onnx_image(net), mistake, onnx), net, (1, 3))) > 1


@pytest.mark.parametrize("net", ["Softmax, differences of 1e3"], indirect=True)
def test_mistakes_hidden_by_an_output_are_found_in_the_layers(net, onnx):
    """The probabilities are 0 and 1, whatever the weights."""
    outputs, layers = differences(wrong(onnx_image(net), "fc/weight", onnx), net, (1, 3))
    assert largest(outputs) <= 1 < layers["y"].found / layers["y"].limit


@pytest.mark.parametrize("net", ["Eltwise", "Power, shifts"], indirect=True)
def test_the_effect_of_rounding(net):
    """Where large values cancel, the net's own float32 has a large error, which the
    comparison measures.
    """
    outputs, layers = differences(onnx_image(net), net, (1, 3))
    assert all(
        1e-4 < difference.rounding < 1e-1 and difference.found > TOLERANCE
        for difference in outputs.values()
    )
    assert layers["y"].rounding < 1e-6


@pytest.mark.parametrize("net", ["Exp"], indirect=True)
def test_rounding_errors_are_undone(net, rng):
    """Bottoms and parameters have their values back, also after an error."""
    exact = _in_float64(net)
    exact.forward(x0=rng.uniform(0.5, 1, exact.blobs["x0"].shape))
    at = next(at for at in exact.connections if at.layer.type == "InnerProduct")
    arrays = [at.bottom[0].data, at.layer.blobs[0].data]
    before = [array.copy() for array in arrays]
    with pytest.raises(ZeroDivisionError), _rounding_errors(at, np.random.default_rng(1)):
        for array, values in zip(arrays, before):
            assert 0 < difference(array, values) <= 2.0**-24
        raise ZeroDivisionError
    assert all(np.array_equal(array, values) for array, values in zip(arrays, before))


def test_difference():
    """The difference is relative to the largest finite expected value; NaN and infinity only
    equal themselves.
    """
    nan, inf = np.nan, np.inf
    assert difference(np.array([1.0, 2.5]), np.array([1.0, 2.0])) == 0.25
    assert difference(np.array([nan, inf, 1.0]), np.array([nan, inf, 1.0])) == 0
    assert difference(np.array([nan, 1.0]), np.array([1.0, 1.0])) == inf
    assert difference(np.array([inf]), np.array([nan])) == inf
    assert difference(np.zeros((2, 1)), np.zeros(2)) == inf


def test_values_that_overflow_in_float32():
    """A value beyond float32 is infinity; NaN where the net's float32 has it too is
    no difference.
    """
    inf, nan = np.float32(np.inf), np.float32(np.nan)
    assert compared(np.array([inf, 1]), np.array([inf, 1]), np.array([1e60, 1])) == Difference()
    assert compared(np.array([nan, 1]), np.array([nan, 1]), np.array([5.0, 1])) == Difference()
    assert compared(np.array([nan, 1]), np.array([5, 1]), np.array([5.0, 1])).found == inf
