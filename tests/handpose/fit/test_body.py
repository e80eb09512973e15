"""handpose/fit/body.py"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handpose.fit.body import SIZE_INDEX, THICKNESS_INDEX, CapsuleModel
from layers.hand.bodies import kinematics_of
from tests.handpose.body.test_surface_model import ARM
from tests.handpose.fit.conftest import slopes
from tests.support.made_tracks import skeleton_of

COUPLED = ARM.replace('rotate { axis: Z dof: "elbow" }', 'rotate { axis: Z dof: "shoulder" }')


def body(text: str) -> CapsuleModel:
    """The surface of a skeleton given as text; one unit is 10 mm."""
    return CapsuleModel(skeleton_of(text), 10.0)


def exact_ends(model: CapsuleModel, x: np.ndarray) -> np.ndarray:
    """The ends (N, E, 3) in mm, in float64, computed from the surface itself."""
    inputs = np.zeros((len(x), len(model.whole.initial)))
    inputs[:, model.free] = x[:, :SIZE_INDEX]
    size, kinematics = np.exp(x[:, SIZE_INDEX]), kinematics_of(model.whole)
    pose = kinematics.forward(inputs, model.whole.bones * size[:, None])
    used = np.unique(np.concatenate([model.surface.start, model.surface.end]))
    return model.surface.ends(pose, size)[:, used] * model.unit_mm


@pytest.mark.parametrize("text", [None, ARM, COUPLED], ids=["hand", "arm", "coupled"])
def test_ends_and_their_motion_equal_those_of_the_surface(
    model: CapsuleModel, text: str | None, rng: np.random.Generator
) -> None:
    """The motion is compared with central differences, with all kinds of variables."""
    surface = model if text is None else body(text)
    x = rng.normal(0, 0.2, (5, surface.variables))
    posed = surface.posed(x)
    scale = surface.unit_mm
    assert_allclose(posed.ends, exact_ends(surface, x), atol=1e-6 * scale)
    expected = slopes(lambda x: exact_ends(surface, x), x, 1e-5)
    assert_allclose(posed.motion, expected, atol=3e-6 * scale)
    assert_allclose(posed.thickness, np.exp(x[:, SIZE_INDEX] + x[:, THICKNESS_INDEX]), rtol=1e-6)
    assert (posed.motion[..., THICKNESS_INDEX] == 0).all()


def test_variables_of_the_hand(model: CapsuleModel) -> None:
    """The skeleton has 26 variables, the forearm 2; size and thickness are one each.

    Knuckles and wrist are rigid.
    """
    assert model.variables == 30
    assert (len(model.root), len(model.limbs), len(model.own)) == (6, 20, 2)
    used = np.unique(np.concatenate([model.surface.start, model.surface.end]))
    rigid = {model.whole.joint_names[j] for j in used[model.rigid]}
    knuckles = {f"{finger}_mcp" for finger in ("little", "ring", "middle", "index", "thumb")}
    assert rigid == {"wrist_left", "wrist_middle", "forearm"} | knuckles


def test_inputs_survive_conversion_to_variables_and_back(model: CapsuleModel) -> None:
    """Limbs are clipped to their limits; size scales the joints."""
    inputs = np.zeros((3, 47))
    inputs[:, ~model.skeleton.fixed] = np.random.default_rng(1).normal(0, 0.05, (3, 26))
    lower, upper = model.skeleton.lower, model.skeleton.upper
    inputs = np.where(model.skeleton.fixed, 0, np.clip(inputs, lower, upper))
    x = model.variables_of(inputs)
    assert_allclose(model.inputs_of(x), inputs)
    assert_allclose(model.joints(x), kinematics_of(model.skeleton).joints(inputs) * 150, atol=1e-9)
    x[:, SIZE_INDEX] = np.log(1.1)
    root = model.joints(x)[:, model.skeleton.joint_names.index("palm")]
    larger = model.joints(x) - root[:, None]
    same = model.joints(model.variables_of(inputs)) - root[:, None]
    assert_allclose(larger, 1.1 * same, atol=1e-9)
    wild = model.variables_of(np.full((1, 47), 50.0))
    assert_array_equal(wild[0, model.limbs], model.upper[model.limbs])


def test_capsules_for_the_renderer(model: CapsuleModel) -> None:
    """The capsules are moved to the centre, and their radii are scaled by the thickness."""
    x = np.zeros((1, model.variables))
    x[0, THICKNESS_INDEX] = np.log(1.2)
    capsules = model.capsules(x, np.array([[1.0, 2, 700]]))
    assert_allclose(capsules.radius_a[0], model.radii[:, 0] * 1.2, rtol=1e-6)
    assert_allclose(capsules.a[0] - (1, 2, 700), model.posed(x).ends[0, model.start], atol=1e-4)


def test_flat_parts_for_the_renderer(model: CapsuleModel) -> None:
    """Each wedge of the skeleton file is flat between the spheres at its joints, also of a
    mirrored hand.
    """
    capsules = model.capsules(np.zeros((1, model.variables)), np.zeros((1, 3)))
    flesh, names = model.skeleton.param.flesh, model.whole.joint_names
    assert flesh is not None and flesh.wedge
    ends = np.stack([model.surface.start, model.surface.end], axis=1).reshape(-1)
    corners = [[names[joint] for joint in ends[spheres]] for spheres in capsules.facets]
    assert corners == [list(wedge.joint) for wedge in flesh.wedge]
    assert_array_equal(capsules.mirrored(np.array([-1.0, 1, 1])).facets, capsules.facets)
