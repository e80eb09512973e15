"""handpose/synthetic/flesh.py"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.data.crops import crop
from handpose.facts.cameras import NYU
from handpose.synthetic.flesh import HandShape, pairs_that_keep_apart
from handpose.synthetic.pose_prior import HandSampler
from handpose.synthetic.render import Capsules, normalise_depth, render_crop
from tests.handpose.whole_images import render_image


@pytest.fixture(scope="module")
def sampler() -> HandSampler:
    """The default sampler."""
    return HandSampler()


def test_flesh_lies_towards_the_palm(sampler: HandSampler) -> None:
    """A hand seen from its palm has more before its wrist than one seen from its back; its joints are the same."""
    skeleton = sampler.skeleton
    inputs = np.stack([-skeleton.initial, -skeleton.initial])
    inputs[1, skeleton.dof_names.index("palm_rot_y")] += np.pi
    joints = sampler.kinematics.joints(inputs) * 150 + (0, 0, 800)
    flesh = sampler.flesh.capsules(np.random.default_rng(0), joints, np.ones(2))
    hand = Capsules(*(values[:, :-1] for values in flesh))  # a forearm would hide the wrist
    at = NYU.project(joints)
    for joint, least, most in (("wrist_middle", 14, 24), ("ring_mcp", 8, 18), ("ring_tip", -3, 3)):
        k = skeleton.joint_names.index(joint)
        palm, back = (
            joints[n, k, 2] - image[round(at[n, k, 1]), round(at[n, k, 0])]
            for n, image in enumerate(render_image(hand, NYU))
        )
        assert least < palm - back < most
    wrist = joints[:, [skeleton.joint_names.index(f"wrist_{part}") for part in ("left", "middle")]].mean(axis=1)
    back_of_hand = sampler.flesh.palm_axes(joints)[2]
    shift = ((flesh.a[:, -1] - wrist) * back_of_hand).sum(axis=1)
    np.testing.assert_allclose(shift, -HandShape().forearm_towards_palm)


def test_rendered_hand_equals_its_cropped_image(sampler: HandSampler) -> None:
    """A hand drawn along the crop's rays is the crop of the hand drawn on the whole image."""
    rng = np.random.default_rng(5)
    hands = sampler.hands(rng, 3)
    centers = sampler.centers(rng, 3, NYU)
    flesh = sampler.flesh.capsules(rng, hands.joints * 150 + NYU.unproject(centers)[:, None], hands.scale)
    direct = normalise_depth(render_crop(flesh, centers, 300.0), centers[:, 2], 300.0)
    for n, whole in enumerate(render_image(flesh, NYU, background=9999.0)):
        assert (np.abs(direct[n] - crop(whole, centers[n], 300.0)) > 1e-3).sum() <= 5


def test_forearm_does_not_point_at_the_camera(sampler: HandSampler) -> None:
    """The last capsule, the forearm, keeps to the side, and is in all crops long enough to leave them or the cube."""
    rng = np.random.default_rng(0)
    hands = sampler.hands(rng, 300)
    flesh = sampler.flesh.capsules(rng, hands.joints * 150 + (0, 0, 800), hands.scale)
    arm = flesh.b[:, -1] - flesh.a[:, -1]
    assert (arm[:, 2] / np.linalg.norm(arm, axis=1)).min() >= -HandShape().forearm_towards_camera - 1e-9


def test_what_keeps_apart() -> None:
    """Bones of two digits, but for the first of neighbouring fingers; ends of digits and the spokes of the palm."""
    shape = HandShape()
    name = [f"{a}-{b}" for a, b, _, _ in shape.capsules]
    pairs = {frozenset((name[i], name[j])) for i, j in zip(*pairs_that_keep_apart(shape))}
    for one, other in (
        ("index_dip-index_tip", "middle_base-middle_pip_a"),
        ("index_base-index_pip_a", "ring_base-ring_pip_a"),
        ("thumb_pip-thumb_dip", "index_base-index_pip_a"),
        ("thumb_dip-thumb_tip", "wrist_left-little_mcp"),
        ("ring_pip_b-ring_dip", "wrist_middle-index_mcp"),
    ):
        assert frozenset((one, other)) in pairs
    for one, other in (
        ("index_base-index_pip_a", "middle_base-middle_pip_a"),
        ("index_dip-index_tip", "index_base-index_pip_a"),
        ("thumb_pip-thumb_dip", "wrist_left-little_mcp"),
        ("index_mcp-index_base", "middle_base-middle_pip_a"),
        ("ring_dip-ring_tip", "wrist_middle-thumb_mcp"),
    ):
        assert frozenset((one, other)) not in pairs
    digits = 6 * 4 * 4 - 3 + 4 * 4 * 2  # fingers among each other without neighbours' first ones, fingers and thumb
    assert len(pairs) == digits + (4 * 2 + 1) * 5  # ends and spokes
