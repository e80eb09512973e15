"""experiments/hidden_parts.py"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from experiments.hidden_parts import NEARER, Shown, hidden_parts
from handpose.frames.cameras import NYU
from netlib.errors import DataError

CAMERA = replace(NYU, width=640, height=480)
JOINTS = np.array([[x, y, 700.0] for x in (-60, 0, 60) for y in (-60, 0, 60)])


@pytest.mark.parametrize("seed", range(8))
def test_a_part_of_a_square_is_outside_covered_and_not_read(seed: int) -> None:
    """The rest of the square and the wall behind it stay as they are."""
    depth = np.full((CAMERA.height, CAMERA.width), 1500, np.float32)
    corners = CAMERA.project(JOINTS)[:, :2]
    (left, top), (right, bottom) = corners.min(axis=0).astype(int), corners.max(axis=0).astype(int)
    square = np.s_[top : bottom + 1, left : right + 1]
    depth[square] = 700
    rng = np.random.default_rng(seed)
    cut, covered, unread = hidden_parts(rng, Shown(depth, CAMERA), JOINTS)
    assert cut.depth.shape == (cut.camera.height, cut.camera.width)
    assert cut.depth.size < depth.size and (cut.depth == 700).any()
    for point in JOINTS:  # a place remains the same pixel of the scene
        u, v, _ = cut.camera.project(point)
        if 1 < u < cut.camera.width - 1 and 1 < v < cut.camera.height - 1:
            assert cut.depth[int(v), int(u)] in (700, 1500)
    for shown, low, high in ((covered, *NEARER), (unread, 0.0, 0.0)):
        changed = shown.depth != depth
        assert shown.camera == CAMERA and changed.any() and not changed[depth == 1500].any()
        assert 0 < changed[square].mean() < 1
        values = shown.depth[changed]
        assert (700 * low <= values).all() and (values <= 700 * high).all()


def test_a_hand_without_readings_has_no_part_to_hide() -> None:
    depth = np.full((CAMERA.height, CAMERA.width), 1500, np.float32)
    parts = hidden_parts(np.random.default_rng(0), Shown(depth, CAMERA), JOINTS)
    next(parts)
    with pytest.raises(DataError, match="no reading of the hand at 700 mm"):
        next(parts)
