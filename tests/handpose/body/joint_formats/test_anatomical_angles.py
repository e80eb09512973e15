"""handpose/body/joint_formats/formats.py"""

from __future__ import annotations

import numpy as np
import pytest
from posed_hands import MIRROR, PEOPLE, any_pose, right_hand

from handpose.body.joint_formats.formats import ANGLES, anatomical_angles, turned
from handpose.body.joint_formats.frames import FINGERS
from netlib.blob import Array


def angles(inputs: Array) -> dict[str, float]:
    """The anatomical angles of a right hand."""
    return anatomical_angles(PEOPLE, "right", right_hand(inputs))


def with_dof(name: str, value: float) -> Array:
    """The initial pose with one input changed."""
    inputs = np.zeros(len(PEOPLE.initial))
    inputs[PEOPLE.dof_names.index(name)] = value
    return inputs


@pytest.mark.parametrize("seed", range(5))
def test_hinges_are_the_models(seed: int) -> None:
    """PIP, DIP and the thumb's hinges equal the model's angles in any pose and place, in degrees, up to the sign."""
    inputs = any_pose(np.random.default_rng(seed))
    theta = dict(zip(PEOPLE.dof_names, np.degrees(PEOPLE.theta(inputs[None])[0])))
    found = angles(inputs)
    for finger in FINGERS:
        assert found[f"{finger}_pip_flexion"] == pytest.approx(-theta[f"{finger}_pip_rot_x"], abs=1e-6)
        assert found[f"{finger}_dip_flexion"] == pytest.approx(-theta[f"{finger}_dip_rot_x"], abs=1e-6)
    assert found["thumb_mcp_flexion"] == pytest.approx(theta["thumb_dip_rot_z"], abs=1e-6)
    assert found["thumb_ip_flexion"] == pytest.approx(theta["thumb_tip_rot_z"], abs=1e-6)


@pytest.mark.parametrize("finger", FINGERS)
@pytest.mark.parametrize("spread", ["lower", "upper"])
def test_a_closed_finger(finger: str, spread: str) -> None:
    """At the limits a finger is bent by 90, 110 and 80 degrees, also if its first phalanx points backwards."""
    inputs = np.zeros(len(PEOPLE.initial))
    for joint in ("base", "pip", "dip"):
        d = PEOPLE.dof_names.index(f"{finger}_{joint}_rot_x")
        inputs[d] = PEOPLE.lower[d]
    d = PEOPLE.dof_names.index(f"{finger}_base_rot_z")
    inputs[d] = getattr(PEOPLE, spread)[d]
    found = angles(inputs)
    assert found[f"{finger}_mcp_flexion"] == pytest.approx(90, abs=1)
    assert found[f"{finger}_pip_flexion"] == pytest.approx(110, abs=1e-4)
    assert found[f"{finger}_dip_flexion"] == pytest.approx(80, abs=1e-4)


@pytest.mark.parametrize("finger", FINGERS)
def test_noise_near_a_right_angle(finger: str) -> None:
    """Where the knuckle's bend does not determine the spread, noise of 0.1 mm changes the other bends little."""
    rng = np.random.default_rng(0)
    for bend in np.radians([-88, -90, -92]):
        inputs = np.zeros(len(PEOPLE.initial))
        knuckle, pip = (PEOPLE.dof_names.index(f"{finger}_{joint}_rot_x") for joint in ("base", "pip"))
        inputs[knuckle], inputs[pip] = bend - PEOPLE.initial[knuckle], -1.0
        exact = -np.degrees(PEOPLE.theta(inputs[None])[0, pip])
        for _ in range(20):
            joints = right_hand(inputs) + rng.uniform(-0.1, 0.1, (len(PEOPLE.joint_names), 3))
            found = anatomical_angles(PEOPLE, "right", joints)
            assert found[f"{finger}_pip_flexion"] == pytest.approx(exact, abs=30)


@pytest.mark.parametrize("seed", range(5))
def test_place_turn_size_and_side_do_not_matter(seed: int) -> None:
    """The angles do not depend on place, orientation and size, and are equal for the mirrored left hand."""
    inputs = any_pose(np.random.default_rng(seed))
    elsewhere = np.where(np.arange(len(inputs)) < 6, 0.3, inputs)
    found = np.array(list(angles(inputs).values()))
    smaller = anatomical_angles(PEOPLE, "right", right_hand(elsewhere, 90.0))
    left = anatomical_angles(PEOPLE, "left", right_hand(inputs) * MIRROR)
    assert list(smaller) == list(left) == list(ANGLES)
    assert np.allclose(found, list(smaller.values()), atol=1e-6)
    assert np.allclose(found, list(left.values()), atol=1e-6)


@pytest.mark.parametrize("finger", FINGERS)
def test_signs(finger: str) -> None:
    """Bending a knuckle raises its flexion; a turn to the thumb lowers the abduction of ring and little finger only."""
    rest = angles(with_dof("palm_x", 0.0))
    low = PEOPLE.lower[PEOPLE.dof_names.index(f"{finger}_base_rot_x")]
    bent = angles(with_dof(f"{finger}_base_rot_x", low))
    assert bent[f"{finger}_mcp_flexion"] > rest[f"{finger}_mcp_flexion"] + np.degrees(-low) / 2
    towards_thumb = angles(with_dof(f"{finger}_base_rot_z", -0.2))  # positive turns lead away from the thumb at x
    change = towards_thumb[f"{finger}_mcp_abduction"] - rest[f"{finger}_mcp_abduction"]
    assert change < -5 if finger in ("ring", "little") else change > 5


def test_the_thumb_spreads() -> None:
    """Radial abduction changes with the rotation about z, palmar abduction with the rotation about y."""
    rest = angles(with_dof("palm_x", 0.0))
    across = angles(with_dof("thumb_pip_rot_z", 0.5))
    before = angles(with_dof("thumb_pip_rot_y", -0.4))
    assert across["thumb_cmc_radial_abduction"] < rest["thumb_cmc_radial_abduction"] - 10
    assert before["thumb_cmc_palmar_abduction"] > rest["thumb_cmc_palmar_abduction"] + 10


def test_a_straight_finger_has_zeros() -> None:
    """A finger in line with its metacarpal has flexion 0."""
    inputs = np.zeros(len(PEOPLE.initial))
    for joint in ("pip", "dip"):
        inputs[PEOPLE.dof_names.index(f"index_{joint}_rot_x")] = -PEOPLE.initial[
            PEOPLE.dof_names.index(f"index_{joint}_rot_x")
        ]
    found = angles(inputs)
    assert found["index_pip_flexion"] == pytest.approx(0, abs=1e-6)
    assert found["index_dip_flexion"] == pytest.approx(0, abs=1e-6)


def test_the_smallest_turn() -> None:
    """The rotation from x to y keeps z and maps y to -x; half a turn is handled as well."""
    x, y, z = np.eye(3)
    assert np.allclose([turned(x, x, y), turned(y, x, y), turned(z, x, y)], [y, -x, z])
    assert np.allclose(turned(z, x, -x), -z)
