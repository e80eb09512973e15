"""Bias, Scale and PReLU: learned numbers per channel.

Their gradients are compared in test_gradients.py.
"""

import numpy as np
import pytest

SCALE = "Scale scale_param { bias_term: true }"
SHARED = "PReLU prelu_param { channel_shared: true }"
SIGNS = [[-2, -2, 3], [0, 1, -1]]  # at 0 the gradient of PReLU is that of the negative side


@pytest.mark.parametrize(
    ("layer", "x", "params", "y", "dy", "dx", "dparams"),
    [
        (
            "Bias",
            [[1, 2], [3, 4]],
            [[10, 20]],
            [[11, 22], [13, 24]],
            [[1, 2], [3, 5]],
            [[1, 2], [3, 5]],
            [[4, 7]],
        ),
        (
            SCALE,
            [[1, 2], [3, 3]],
            [[2, 3], [1, 0]],
            [[3, 6], [7, 9]],
            [[1, 1], [1, 0]],
            [[2, 3], [2, 0]],
            [[4, 2], [2, 1]],
        ),
        (
            "PReLU",
            SIGNS,
            [[0.5, -1, 2]],
            [[-1, 2, 3], [0, 1, -2]],
            np.ones((2, 3)),
            [[0.5, -1, 1], [0.5, 1, 2]],
            [[-2, -2, -1]],
        ),
        (
            SHARED,
            SIGNS,
            [0.5],
            [[-1, -1, 3], [0, 1, -0.5]],
            [[1, 2, 3], [4, 5, 6]],
            [[0.5, 1, 3], [2, 5, 3]],
            [-2 - 4 - 6],
        ),
        # 0 times infinity is not added
        (SHARED, [[np.inf, 1]], [0], [[np.inf, 1]], [[1, 1]], [[1, 1]], [0]),
        # the axis is ignored
        ("Scale scale_param { num_axes: 0 axis: 5 }", [2.0, 3], [2], [4, 6], [1, 1], [2, 2], [5]),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
@pytest.mark.parametrize("in_place", [False, True])
def test_by_hand(by_hand, layer, x, params, y, dy, dx, dparams, in_place):
    by_hand(layer, [x], [y], [dy], [dx], dparams, params=params, in_place=in_place)


@pytest.mark.parametrize(
    ("layer", "initial"),
    [
        ("Bias", [[0] * 3]),
        (SCALE, [[1] * 3, [0] * 3]),
        ("PReLU", [[0.25] * 3]),
        (SHARED, [0.25]),
        # without a value it is 0, as in Caffe
        ('PReLU prelu_param { filler { type: "constant" } }', [[0] * 3]),
    ],
)
def test_initial_values(run, layer, initial):
    kind, _, options = layer.partition(" ")
    assert [
        blob.data.tolist() for blob in run(f'type: "{kind}" {options}', np.ones((2, 3))).layer.blobs
    ] == initial


@pytest.mark.parametrize(
    ("options", "shape"),
    [
        ("", (3,)),
        ("axis: 0", (2,)),
        ("num_axes: 2", (3, 4)),
        ("axis: 0 num_axes: -1", (2, 3, 4)),
        ("num_axes: 0", ()),
        ("axis: -1", (4,)),
    ],
)
@pytest.mark.parametrize(("kind", "add"), [("Bias", np.add), ("Scale", np.multiply)])
def test_shapes(run, rng, kind, add, options, shape):
    x = rng.normal(size=(2, 3, 4))
    done = run(
        f'type: "{kind}" {kind.lower()}_param {{ filler {{ type: "gaussian" }} {options} }}', x
    )
    value = done.layer.blobs[0].data
    assert value.shape == shape
    after = {"": 1, "axis: 0": 2}.get(options, 0)
    assert np.array_equal(done.y, add(x, value.reshape(shape + (1,) * after)))


@pytest.mark.parametrize("second", [(3, 4), (3,), ()])
@pytest.mark.parametrize(("kind", "add"), [("Bias", np.add), ("Scale", np.multiply)])
def test_a_second_bottom_replaces_the_parameter_and_num_axes(run, rng, kind, add, second):
    """As in Caffe; a number fits whatever the axis."""
    x, value = rng.normal(size=(2, 3, 4)), rng.normal(size=second)
    options = "axis: 5" if second == () else "num_axes: 9"
    done = run(f'type: "{kind}" {kind.lower()}_param {{ {options} }}', x, value)
    assert np.array_equal(done.y, add(x, value[:, None] if second == (3,) else value))
    assert not done.layer.blobs
