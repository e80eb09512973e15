"""Bias, Scale and PReLU: learned numbers per channel."""

import numpy as np
import pytest

SCALE = "Scale scale_param { bias_term: true }"
SHARED = "PReLU prelu_param { channel_shared: true }"


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
    layer = run(f'type: "{kind}" {options}', np.ones((2, 3))).layer
    assert [blob.data.tolist() for blob in layer.blobs] == initial


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
