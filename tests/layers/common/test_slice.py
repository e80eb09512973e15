"""Slice."""

import numpy as np
import pytest

pytestmark = pytest.mark.both_engines


@pytest.mark.parametrize(
    ("options", "tops", "sizes", "axis"),
    [("", 3, [2, 2, 2], 1), ("slice_point: 1 slice_point: 4", 3, [1, 3, 2], 1), ("axis: 0", 2, [2, 2], 0),
     ("axis: -1 slice_point: 3", 2, [3, 2], 2), ("slice_dim: 0 slice_point: 1", 2, [1, 3], 0), ("", 1, [6], 1),
     ("slice_point: 2 slice_point: 6", 3, [2, 4, 0], 1)],
)
def test_parts(run, rng, options, tops, sizes, axis):
    """The bottom is split into equal parts or at the slice points; the gradient is concatenated."""
    x = rng.normal(size=(4, 6, 5))
    done = run(f'type: "Slice" slice_param {{ {options} }}', x, tops=tops)
    assert [y.shape[axis] for y in done.ys] == sizes
    assert np.array_equal(np.concatenate(done.ys, axis), x)
    parts = [rng.normal(size=y.shape) for y in done.ys]
    assert np.array_equal(done.backward(*parts)[0], np.concatenate(parts, axis))
