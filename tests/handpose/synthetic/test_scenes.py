"""handpose/synthetic/scenes.py"""

from __future__ import annotations

import numpy as np

from handpose.frames.cameras import KINECT2, NYU
from handpose.synthetic.prior_file import RangeParameter
from handpose.synthetic.scenes import KINDS, draw_scenes, prior_of


def test_scenes() -> None:
    """Kinds alternate, scenes are reproducible, hands are in sight, and forearms are nearer than their hands."""
    images, hands = draw_scenes(np.random.default_rng(7), 9)
    np.testing.assert_array_equal(images, draw_scenes(np.random.default_rng(7), 9)[0])
    assert images.shape == (9, 480, 640)
    for depth, joints, kind in zip(images, hands, KINDS * 3):
        center = joints.mean(axis=0)
        u, v, d = NYU.project(center)
        assert 0 < u < 640 and 0 < v < 480 and 400 < d < 950
        assert np.linalg.norm(joints - center, axis=1).max() < 250
        seen = depth[depth > 0]
        if kind == "forearm":
            assert np.percentile(seen[seen < 1200], 2) < joints[:, 2].min() + 5
    assert ((images[1] > 700) & (images[1] < 1400)).sum() > 3000  # a body


def test_other_cameras_and_distances() -> None:
    """Another camera and other distances are used, and scenes may start at any number."""
    prior = prior_of(RangeParameter(1100.0, 1200.0))
    images, joints = draw_scenes(np.random.default_rng(7), 2, KINECT2, None, prior, first=2)
    assert images.shape == (2, 424, 512) and (np.abs(joints[..., 2].mean(axis=1) - 1150) < 100).all()
