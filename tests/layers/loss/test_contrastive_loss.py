"""ContrastiveLoss."""

import numpy as np
import pytest

A = np.array([[3, 4], [3, 4], [0, 1], [1, 1]], np.float64)
SIMILAR = [1, 0, 0, 0]  # distances to the origin are 5, 5, 1 and sqrt 2


def text(margin=2.0, legacy="false"):
    return f'type: "ContrastiveLoss" contrastive_loss_param {{ margin: {margin} legacy_version: {legacy} }}'


def test_by_hand(run):
    """A similar pair, a distant pair and two close pairs give (25 + 0 + 1 + (2 - sqrt 2)²) / (2 * 4)."""
    done = run(text(), A, np.zeros((4, 2)), SIMILAR)
    root = np.sqrt(2)
    assert done.y == pytest.approx((26 + (2 - root) ** 2) / 8)
    da, db, _ = done.backward(4, wanted=[True, True, False])
    pushed = [[0, -1 / 1.0001], [-(2 - root) / (root + 1e-4)] * 2]
    assert np.allclose(da, [[3, 4], [0, 0], *pushed], rtol=1e-12)
    assert np.array_equal(db, -da)


def test_legacy_by_hand(run):
    """The legacy version compares the squared distance with the margin: (25 + 0 + 1 + 0) / (2 * 4)."""
    done = run(text(legacy="true"), A, np.zeros((4, 2)), SIMILAR)
    assert done.y == 26 / 8
    da, db, _ = done.backward(4, wanted=[True, True, False])
    assert da.tolist() == [[3, 4], [0, 0], [0, -1], [0, 0]]
    assert np.array_equal(db, -da)


def test_equal_points_do_not_divide_by_zero(run):
    """Equal points that are not similar have the loss of the full margin and gradient 0."""
    done = run(text(), [[1.0, 1]], [[1.0, 1]], [0])
    assert done.y == 2
    assert done.backward(1, wanted=[True, True, False])[0].tolist() == [[0, 0]]


def test_the_fraction_of_similar_is_cut(run):
    """Similar values are truncated to integers: 0.9 and -0.9 are 0, while -1 is nonzero."""
    for value, expected in ((0.9, 0), (-0.9, 0), (-1, 12.5), (2, 12.5)):
        assert run(text(), A[:1], np.zeros((1, 2)), [value]).y == expected


def test_axes_of_size_1_do_not_matter(run):
    """Axes of size 1 are allowed in the vectors and in the similar values."""
    done = run(text(), A.reshape(4, 2, 1, 1), np.zeros((4, 2)), np.reshape(SIMILAR, (4, 1, 1, 1)))
    assert done.y == run(text(), A, np.zeros((4, 2)), SIMILAR).y
    assert done.backward(1, wanted=[True, True, False])[0].shape == (4, 2, 1, 1)


@pytest.mark.parametrize("legacy", ["true", "false"])
def test_gradient(check, rng, legacy):
    """The gradients agree with differences; Caffe's 1e-4 in the divisor makes those of the newer version less exact."""
    a, b = rng.normal(size=(2, 6, 3))
    wrong = 1e-6 if legacy == "true" else 1e-3
    check(text(3, legacy), a, b, [0, 1, 0, 1, 0, 0], wanted=[True, True, False], tolerance=wrong)
    check(text(3, legacy), a, b, [0, 1, 0, 1, 0, 0], wanted=[False, True, False], tolerance=wrong)
