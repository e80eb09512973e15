"""Canonical angles: one representative for all angles of the same pose."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from handpose.fit.joints import angles
from layers.hand import skeleton as skeletons
from layers.hand.bodies import kinematics_of
from tests.support.made_tracks import skeleton_of

NYU_HAND = skeletons.load()  # the labels that are fitted are of NYU's joints


def draw(rng, N=20, spread=np.pi):
    """Inputs with arbitrary rotations."""
    x = np.zeros((N, 47))
    x[:, :3] = rng.normal(size=(N, 3))
    x[:, angles.rotations(NYU_HAND)] = rng.uniform(-spread, spread, (N, 23))
    return x


def test_wrap():
    """Angles are wrapped into (-180, 180] degrees."""
    assert np.allclose(
        angles.wrap([0, np.pi, -np.pi, 3 * np.pi / 2, -7]),
        [0, np.pi, np.pi, -np.pi / 2, -7 + 2 * np.pi],
    )


def test_the_hand_has_six_pairs():
    """The pairs belong to the palm, four fingers and the thumb; 23 rotations are free."""
    found = angles.flips(NYU_HAND)
    names = NYU_HAND.dof_names
    assert len(angles.rotations(NYU_HAND)) == 23
    assert sum(flip.whole for flip in found) == 1 and len(found) == 6
    thumb = next(flip for flip in found if names[flip.mirrored].startswith("thumb"))
    assert [names[d] for d in (*thumb.turned, thumb.mirrored, *thumb.negated)] == [
        "thumb_pip_rot_z",
        "thumb_pip_rot_y",
        "thumb_dip_rot_z",
        "thumb_tip_rot_z",
    ]


def test_canonical_keeps_the_pose_and_is_unique(rng):
    """Joints are unchanged; all 64 combinations of flips, and whole turns, give the same angles."""
    x = draw(rng, 5)
    want = angles.canonical(NYU_HAND, x)
    assert np.allclose(
        kinematics_of(NYU_HAND).joints(want), kinematics_of(NYU_HAND).joints(x), atol=1e-12
    )
    assert np.allclose(angles.canonical(NYU_HAND, want), want, atol=1e-12)
    turns = angles.rotations(NYU_HAND)
    for pattern in range(64):
        theta = NYU_HAND.theta(x)
        for bit, flip in enumerate(angles.flips(NYU_HAND)):
            if pattern >> bit & 1:
                theta[:, list(flip.turned)] -= np.pi
                theta[:, flip.mirrored] = np.pi - theta[:, flip.mirrored]
                theta[:, list(flip.negated)] *= -1
        theta[:, turns] += 2 * np.pi * rng.integers(-2, 3, (5, 23))
        assert (
            np.abs(angles.wrap(angles.canonical(NYU_HAND, theta - NYU_HAND.initial) - want)).max()
            < 1e-9
        )


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_angles_within_limits_stay(seed):
    """Fingers within their limits and the palm in its initial pose are already canonical."""
    rng = np.random.default_rng(seed)
    x = np.zeros((50, 47))
    fingers = np.setdiff1d(angles.rotations(NYU_HAND), (3, 4, 5))
    lower, upper = NYU_HAND.lower[fingers], NYU_HAND.upper[fingers]
    x[:, fingers] = rng.uniform(lower, upper, (50, 20))
    assert np.allclose(angles.canonical(NYU_HAND, x), x)


def test_angle_errors_wrap_around():
    """179 and -179 degrees differ by 2 degrees."""
    a, b = np.zeros((2, 1, 47))
    palm_z = NYU_HAND.dof_names.index("palm_rot_z")
    a[:, palm_z], b[:, palm_z] = np.deg2rad(179), np.deg2rad(-179)
    errors = angles.angle_errors(NYU_HAND, a, b)
    assert errors.shape == (1, 23) and errors.sum() == pytest.approx(2)


def test_flips_that_would_change_the_pose_are_ruled_out():
    """A bone across the flip's axis, a fixed rotation below it, or a DoF of two joints
    rules the flip out.
    """

    def skeleton(second, extra=""):
        dofs = (
            "".join(f'dof {{ name: "{d}" }} ' for d in "abcd")
            + 'dof { name: "f" initial: 0.5 fixed: true } '
        )
        first = (
            'joint { name: "r" rotate { axis: Z dof: "a" } rotate { axis: X dof: "b" } bone { '
            "axis: Y length: 1 } } "
        )
        text = dofs + first + f'joint {{ name: "t" parent: "r" {second} }} {extra}'
        return skeleton_of(text)

    assert (
        len(angles.flips(skeleton('rotate { axis: X dof: "c" } bone { axis: Y length: 1 }'))) == 1
    )
    assert not angles.flips(skeleton('rotate { axis: X dof: "c" } bone { axis: X length: 1 }'))
    assert not angles.flips(skeleton('rotate { axis: X dof: "f" } bone { axis: Y length: 1 }'))
    assert not angles.flips(skeleton('rotate { axis: X dof: "b" } bone { axis: Y length: 1 }'))
    assert (
        angles.flips(skeleton('rotate { axis: Y dof: "c" } bone { axis: Y length: 1 }'))[0].negated
        == []
    )
