"""Slice."""

import numpy as np
import pytest

import netlib

pytestmark = pytest.mark.both_engines


@pytest.mark.parametrize(
    ("options", "tops", "sizes", "axis"),
    [("", 3, [2, 2, 2], 1), ("slice_point: 1 slice_point: 4", 3, [1, 3, 2], 1), ("axis: 0", 2, [2, 2], 0),
     ("axis: -1 slice_point: 3", 2, [3, 2], 2), ("slice_dim: 0 slice_point: 1", 2, [1, 3], 0), ("", 1, [6], 1),
     ("slice_point: 2 slice_point: 6", 3, [2, 4, 0], 1)],
)  # fmt: skip
def test_parts(run, rng, options, tops, sizes, axis):
    """The bottom is split into equal parts or at the slice points; the gradient is concatenated."""
    x = rng.normal(size=(4, 6, 5))
    done = run(f'type: "Slice" slice_param {{ {options} }}', x, tops=tops)
    assert [y.shape[axis] for y in done.ys] == sizes
    assert np.array_equal(np.concatenate(done.ys, axis), x)
    parts = [rng.normal(size=y.shape) for y in done.ys]
    assert np.array_equal(done.backward(*parts)[0], np.concatenate(parts, axis))


def test_gradient(check, rng):
    """The gradient agrees with differences for two parts."""
    check('type: "Slice" slice_param { slice_point: 1 }', rng.normal(size=(2, 3)), tops=2)


@pytest.mark.parametrize(
    ("options", "tops", "message"),
    [
        ("", 4, r"axis 1 of \(4, 6\) cannot be split into 4 equal parts"),
        ("slice_point: 2", 3, "must be 2 increasing numbers from 1 to 6"),
        ("slice_point: 4 slice_point: 2", 3, "must be 2 increasing numbers"),
        ("slice_point: 7", 2, "must be 1 increasing numbers"),
        ("axis: 0 slice_point: 1 slice_point: 2 slice_point: 3 slice_point: 4", 5, "and 5 tops at most 4"),
        ("axis: 1 slice_dim: 1", 2, "axis and slice_dim are the same option"),
        ("slice_point: 0", 2, "must be 1 increasing numbers"),
        ("axis: 2", 2, "axis 2 is out of range"),
    ],
)
def test_mistakes(run, options, tops, message):
    """Invalid slice points, axes and numbers of tops raise an error."""
    with pytest.raises(netlib.LayerError, match=message):
        run(f'type: "Slice" slice_param {{ {options} }}', np.zeros((4, 6)), tops=tops)
