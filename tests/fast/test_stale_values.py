"""Memory that is reused, and blobs that are computed again, have no values of another pass."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import netlib
from tests.support.nets import inputs

Agree = MakeNet = Callable[..., netlib.Net]

CONVOLUTION = """
    layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 3 dim: 1 dim: 9 dim: 6 } } }
    layer { name: "c" type: "Convolution" bottom: "x" top: "c"
            convolution_param { num_output: 1 kernel_size: 2 weight_filler { type: "gaussian" std: 1 } } }
    %s
    layer { name: "l" type: "Reduction" bottom: "%s" top: "l" loss_weight: 1 reduction_param { operation: SUMSQ } }
"""
POOLING = """
    layer { name: "r" type: "ReLU" bottom: "c" top: "c" }
    layer { name: "p" type: "Pooling" bottom: "c" top: "p" pooling_param { kernel_size: 2 stride: 2 } }
"""
IN_PLACE = """
    layer { name: "f" bottom: "p" top: "p" %s }
    layer { name: "d" type: "Convolution" bottom: "p" top: "d"
            convolution_param { num_output: 1 kernel_size: 1 weight_filler { type: "gaussian" std: 1 } } }
"""


def both(net_of: MakeNet, text: str, **options: int) -> tuple[netlib.Net, netlib.Net]:
    """Create the same net with the fast and the plain engine, in float64."""
    fast, plain = (
        net_of(text, engine=engine, dtype=np.float64, **options) for engine in ("fast", "plain")
    )
    return fast, plain


@pytest.mark.parametrize(
    "between, loss", [("", "c"), (POOLING, "p")], ids=["convolution", "pooling"]
)
def test_narrower_and_lower_images_after_wider_and_higher_ones(
    agree: Agree, rng: np.random.Generator, between: str, loss: str
) -> None:
    """The padding of tiles has no values of larger images whose tiles had the same shape."""
    sizes = [(9, 6), (9, 5), (9, 6), (8, 6), (8, 5), (9, 5)]
    batches = [{"x": rng.normal(size=(3, 1, *size))} for size in sizes]
    agree(CONVOLUTION % (between, loss), *batches, tolerance=1e-11)


@pytest.mark.parametrize(
    "function",
    [
        'type: "Power" power_param { scale: -1 shift: 0.5 }',
        'type: "Power" power_param { shift: 1 }',
        'type: "Sigmoid"',
        'type: "TanH"',
        'type: "ReLU" relu_param { negative_slope: 0.1 }',
        'type: "ReLU"',
    ],
)
def test_a_layer_that_overwrites_pooled_values(
    agree: Agree, rng: np.random.Generator, function: str
) -> None:
    """A ReLU is not moved behind a pooling whose values are overwritten, because its backward
    reads their signs.
    """
    text = CONVOLUTION % (POOLING + IN_PLACE % function, "d")
    agree(text, {"x": rng.normal(size=(3, 1, 9, 6))}, tolerance=1e-11)


@pytest.mark.parametrize("half", ["data", "diff"])
def test_the_first_read_after_parameters_were_shared(
    net_of: MakeNet, rng: np.random.Generator, half: str
) -> None:
    """It returns the values of the last pass."""
    text = CONVOLUTION % (POOLING + IN_PLACE % 'type: "Sigmoid"', "d")
    fast, plain = both(net_of, text)
    x = rng.normal(size=(3, 1, 9, 6))
    for net, other in zip((fast, plain), both(net_of, text, seed=2)):
        net.forward(x=x)
        net.backward()
        net.share_params(other)
    for name in ("c", "p"):
        found, expected = (getattr(net.blobs[name], half) for net in (fast, plain))
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-11)


def test_a_read_does_not_write_shared_parameters(net_of: MakeNet, rng: np.random.Generator) -> None:
    """Computing a blob again does not write to parameters, which another net may be using."""
    fast, _ = both(net_of, CONVOLUTION % (POOLING, "p"))
    fast.forward(x=rng.normal(size=(3, 1, 9, 6)))
    weights = fast.params["c"][0].data
    weights[...] = 7
    weights.flags.writeable = False
    assert fast.blobs["c"].data.any()


def test_a_pooling_of_no_items(net_of: MakeNet) -> None:
    """A pooling with one window over the whole image accepts a batch without items."""
    net = net_of(
        inputs(x=(2, 3, 4, 4))
        + 'layer { name: "p" type: "Pooling" bottom: "x" top: "p" pooling_param { kernel_size: 4 } }'
    )
    assert net.forward(x=np.empty((0, 3, 4, 4)))["p"].shape == (0, 3, 1, 1)
