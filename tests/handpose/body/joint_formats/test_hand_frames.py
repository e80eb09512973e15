"""handpose/body/joint_formats/frames.py: best_rotation recovers rotations from moved points, without reflections."""

import numpy as np
from scipy.spatial.transform import Rotation

from handpose.body.joint_formats.frames import best_rotation

RNG = np.random.default_rng(0)
POINTS = RNG.standard_normal((7, 3))


def test_a_rotation_is_found_again() -> None:
    """A rotation is recovered from the points that it moved."""
    for wanted in Rotation.random(20, random_state=RNG).as_matrix():
        np.testing.assert_allclose(best_rotation(POINTS, POINTS @ wanted.T), wanted, atol=1e-12)


def test_of_a_mirror_image() -> None:
    """For mirrored points the result is a rotation, with determinant 1."""
    found = best_rotation(POINTS, POINTS * (-1, 1, 1))
    np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(found) > 0


def test_with_noise() -> None:
    """With noise, no small rotation away from the result has a lower error."""
    moved = POINTS + 0.1 * RNG.standard_normal(POINTS.shape)
    best = best_rotation(POINTS, moved)

    def error(R: np.ndarray) -> float:
        return float(((moved - POINTS @ R.T) ** 2).sum())

    for turn in Rotation.from_rotvec(0.01 * RNG.standard_normal((20, 3))).as_matrix():
        assert error(turn @ best) > error(best)
