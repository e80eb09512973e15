"""ArgMax."""

import pytest

X = [[[3.0, 1], [4, 2]], [[0, -1], [-2, 0]]]  # two items; the second has equal values


def text(options=""):
    return f'type: "ArgMax" argmax_param {{ {options} }}'


@pytest.mark.parametrize(("options", "y"), [
    ("", [[[2]], [[3]]]),  # of the equal values of item 1, at 0 and 3, the last one
    ("top_k: 3", [[[2, 0, 3]], [[3, 0, 1]]]),
    ("top_k: 2 out_max_val: true", [[[2, 0], [4, 3]], [[3, 0], [0, 0]]]),
    ("axis: 1", [[[1, 1]], [[0, 1]]]),
    ("axis: -1", [[[0], [0]], [[0], [1]]]),
    ("axis: 1 out_max_val: true", [[[4, 2]], [[0, 0]]]),  # values instead of indices
    ("axis: 2 top_k: 2", [[[0, 1], [0, 1]], [[0, 1], [1, 0]]]),
    ("axis: 0", [[[0, 0], [0, 0]]]),
])
def test_by_hand(run, options, y):
    """Indices or values are found within the whole item or along an axis."""
    assert run(text(options), X).y.tolist() == y


@pytest.mark.parametrize(
    ("shape", "options", "top"),
    [((4, 6), "", (4, 1, 1)), ((4,), "", (4, 1, 1)), ((4, 6), "top_k: 2 out_max_val: true", (4, 2, 2)),
     ((4, 3, 2, 5), "top_k: 7", (4, 1, 7, 1)), ((4, 3, 2, 5), "axis: 1 top_k: 2", (4, 2, 2, 5))],
)
def test_shapes(run, rng, shape, options, top):
    """Without ``axis`` the top has at least three axes, with it those of the bottom."""
    assert run(text(options), rng.normal(size=shape)).y.shape == top
