"""Layer types of other programs: the advice is a table, and the layers that it names
compute what it says.
"""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import log_softmax

from layers import LAYER_TYPES
from netlib.net import Net
from netlib.proto.fork_types import ADVICE, EQUIVALENTS, UNSUPPORTED, type_advice
from netlib.proto.options import block_name
from tests.support.nets import inputs

Array = NDArray[np.float64]
SHAPE = (2, 8, 3, 4)
OPTIONS = {
    "a": "0.3",
    "b": "0.7",
    "1/a": "3.3333333",
    "s": "2",
    "n": "5",
    "C": "2",
    "H": "3",
    "W": "4",
    "sH": "6",
    "sW": "8",
}  # of the letters in the table


def sigmoid(x: Array) -> Array:
    return 1 / (1 + np.exp(-x))


def shuffled(x: Array) -> Array:
    n, c, h, w = x.shape
    return x.reshape(n, 2, c // 2, h, w).swapaxes(1, 2).reshape(x.shape)


def pixel_shuffle(x: Array) -> Array:
    y = np.empty((len(x), 2, 6, 8))
    for i in range(2):
        for j in range(2):
            y[:, :, i::2, j::2] = x[:, 2 * i + j :: 4]
    return y


FORMULAS: dict[str, Callable[[Array], Array]] = {  # by the first name of an entry
    "HSwish": lambda x: x * np.clip(x + 3, 0, 6) / 6,
    "HSigmoid": lambda x: np.clip(0.3 * x + 0.7, 0, 1),
    "Mish": lambda x: x * np.tanh(np.log1p(np.exp(x))),
    "SiLU": lambda x: x * sigmoid(x),
    "SeLU": lambda x: 1.0507009873554805 * np.where(x > 0, x, 1.6732632423543772 * np.expm1(x)),
    "CELU": lambda x: np.maximum(x, 0) + np.minimum(0.3 * np.expm1(x / 0.3), 0),
    "SoftPlus": lambda x: np.log1p(np.exp(x)),
    "SoftSign": lambda x: x / (1 + np.abs(x)),
    "LogSoftmax": lambda x: log_softmax(x, axis=1),
    "LogSigmoid": lambda x: np.log(sigmoid(x)),
    "LeakyReLU": lambda x: np.where(x > 0, x, 0.3 * x),
    "ThresholdedReLU": lambda x: np.where(x > 0.3, x, 0),
    "CReLU": lambda x: np.concatenate([np.maximum(x, 0), np.maximum(-x, 0)], axis=1),
    "NegReLU": lambda x: np.minimum(x, 0),
    "HardTanh": lambda x: np.clip(x, -1, 1),
    "ReLU1": lambda x: np.clip(x, 0, 1),
    "Clamp": lambda x: np.clip(x, 0.3, 0.7),
    "Abs": np.abs,
    "Square": np.square,
    "Sqrt": np.sqrt,
    "Neg": np.negative,
    "Reciprocal": np.reciprocal,
    "Tanhshrink": lambda x: x - np.tanh(x),
    "GlobalAveragePooling": lambda x: x.mean((2, 3), keepdims=True),
    "GlobalMaxPooling": lambda x: x.max((2, 3), keepdims=True),
    "PixelShuffle": pixel_shuffle,
    "ChannelShuffle": shuffled,
    "ChannelNorm": lambda x: np.linalg.norm(x, axis=1, keepdims=True),
    "L2Norm": lambda x: x / np.linalg.norm(x, axis=1, keepdims=True),
}
POSITIVE = {"Sqrt", "Reciprocal"}
STEP = re.compile(r"(\w+)((?: \{.*\})?)( with x)?")


def chain(layers: str) -> str:
    """The prototxt of the layers in the table, with numbers for its letters."""
    text, below = "", "x"
    for i, step in enumerate(re.split(r", (?=[A-Z])", layers)):
        match = STEP.fullmatch(step)
        assert match, step
        kind, options, with_x = match.groups()
        options = re.sub(r"(?<=: )[^\s{]+", lambda value: OPTIONS.get(value[0], value[0]), options)
        block = f"{block_name(LAYER_TYPES[kind], kind)}{options}" if options else ""
        bottoms = f'bottom: "x" bottom: "{below}"' if with_x else f'bottom: "{below}"'
        text += f'layer {{ name: "l{i}" type: "{kind}" {bottoms} top: "l{i}" {block} }} '
        below = f"l{i}"
    return text


@pytest.mark.parametrize(
    ("names", "layers"), [(names, layers) for names, _, layers in EQUIVALENTS], ids=lambda v: v[:20]
)
def test_the_layers_in_the_table_compute_its_formulas(
    names: str, layers: str, net_of: Callable[..., Net], rng: np.random.Generator
) -> None:
    first = names.split()[0]
    if first not in FORMULAS:  # the same layer under another name
        assert layers.split()[0].strip(",") in LAYER_TYPES
        return
    net = net_of(inputs(x=SHAPE) + chain(layers))
    x = rng.normal(size=SHAPE) * 2
    x = np.abs(x) + 0.1 if first in POSITIVE else x
    (found,) = net.forward(x=x).values()
    np.testing.assert_allclose(found, FORMULAS[first](x), rtol=2e-4, atol=1e-5)


def test_the_markers_of_crnn(net_of: Callable[..., Net]) -> None:
    """As UNSUPPORTED says: two DummyData layers and a Concat."""
    assert "two DummyData" in UNSUPPORTED["ContinuationIndicator"]
    fills = ((1, 0), (3, 1))
    data = "".join(
        f'layer {{ name: "d{value}" type: "DummyData" top: "d{value}" dummy_data_param {{ '
        f"shape {{ dim: {steps} dim: 2 }} data_filler {{ value: {value} }} }} }}"
        for steps, value in fills
    )
    join = 'layer { name: "c" type: "Concat" bottom: "d0" bottom: "d1" top: "c" concat_param { axis: 0 } }'
    assert net_of(data + join).forward()["c"].tolist() == [[0, 0], [1, 1], [1, 1], [1, 1]]


@pytest.mark.parametrize(
    ("name", "advice"),
    [
        ("Convolutoin", "did you mean 'Convolution'?"),
        ("convolution", "did you mean 'Convolution'?"),
        ("Inner_Product", "did you mean 'InnerProduct'?"),
        ("Poolin", "did you mean 'Pooling'?"),
        ("Poolling", "did you mean 'Pooling'?"),
        ("Deconvplution", "did you mean 'Deconvolution'?"),
        ("Relu6", "did you mean 'ReLU6'?"),
        ("ROIpooling", "did you mean 'ROIPooling'?"),
        ("hard_swish", "x ReLU6(x + 3) / 6; write it as Power { shift: 3 }, ReLU6"),
        ("Silu", "x sigmoid(x); write it as Swish"),
        ("MultiBoxLoss", "the training layers of SSD are not supported; its deploy nets are"),
        ("MultiStageMeanfield", "the mean field of CRF-RNN"),
        ("ImageLabelmapData", "HED's reader of images"),
        ("LabelMapData", "a reader of another program's files"),
        ("QuadrupletLoss", "a loss of another program"),
    ],
)
def test_advice_on_unknown_types(name: str, advice: str) -> None:
    assert type_advice(name, LAYER_TYPES).startswith(f" ({advice}")


@pytest.mark.parametrize(
    "name",
    [
        "XReLU",
        "ReLUX",
        "ReLU7",
        "Unpooling",
        "Pooling3D",
        "Convolution3D",
        "MyConvolution",
        "DilatedConvolution",
        "BatchReNorm",
        "SmoothL2Loss",
        "SoftmaxWithFocalLoss",
        "SoftmaxWithLosses",
        "ScaleBias",
        "Flip",
        "Slope",
        "",
    ],
)
def test_names_of_other_layers_are_not_taken_for_misspellings(name: str) -> None:
    advice = type_advice(name, LAYER_TYPES)
    assert "did you mean" not in advice
    assert "nearest" not in advice


def test_the_table_has_each_name_once_and_no_known_type() -> None:
    names = [
        name
        for entry in [*(names for names, _, _ in EQUIVALENTS), *UNSUPPORTED]
        for name in entry.split()
    ]
    assert len(ADVICE) == len(names)
    assert not set(names) & LAYER_TYPES.keys()
