"""handpose/body/model.py"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from handpose.body.capsules import Capsules
from handpose.body.model import FINGERS, Fingers, Surface, has_fingers
from handpose.fit.body import CapsuleModel
from layers.hand.skeleton_file import text_of
from netlib.errors import NetlibError, PrototxtError
from tests.support.bad_input import bad_inputs
from tests.support.made_tracks import any_skeleton, skeleton_of
from tests.support.packaged_hand import SKELETON
from tests.support.tables import pairs_of

SURFACE_BLOCK = Surface(SKELETON)
ARM = """name: "arm"
dof { name: "x" } dof { name: "shoulder" } dof { name: "elbow" }
joint { name: "root" translate { axis: X dof: "x" } rotate { axis: Z dof: "shoulder" } }
joint { name: "end" parent: "root" rotate { axis: Z dof: "elbow" } bone { axis: X length: 2 } }
flesh {
  dof { name: "bend" deviation: 0.5 }
  joint { name: "tip" parent: "end" rotate { axis: Y dof: "bend" } bone { axis: X length: 1 } }
  offset { joint: "end" axes: "root" y: 0.5 }
  offset { joint: "tip" axes: "tip" z: -0.25 }
  capsule { from: "root" to: "end" radius: 0.2 part: "upper" }
  capsule { from: "end" to: "tip" radius: 0.2 radius: 0.1 }
}
"""


def test_the_table_of_an_arm() -> None:
    """Names become indices; the surface's own joint and DoF follow the skeleton's."""
    surface = Surface(skeleton_of(ARM))
    assert surface.whole.joint_names == ["root", "end", "tip"]
    assert surface.skeleton.joint_names == ["root", "end"]
    assert (surface.start.tolist(), surface.end.tolist()) == ([0, 1], [1, 2])
    assert surface.limbs.tolist() == [False, True]
    assert_array_equal(surface.radii, [[0.2, 0.2], [0.2, 0.1]])
    assert_array_equal(surface.deviation, [np.inf, np.inf, np.inf, 0.5])


def test_the_table_of_wedges() -> None:
    """Edges shared by two wedges are one capsule; the file's own capsules follow."""
    wedges = """wedge { joint: "root" joint: "end" joint: "tip" radius: 0.3 radius: 0.2 radius: 0.1 part: "web" }
      wedge { joint: "tip" joint: "end" joint: "side" radius: 0.1 radius: 0.2 radius: 0.4 }
      joint { name: "side" parent: "root" bone { axis: Y length: 1 } }"""
    surface = Surface(skeleton_of(ARM.replace("  offset", wedges + "\n  offset", 1)))
    ends = list(zip(surface.start.tolist(), surface.end.tolist()))
    assert ends == [(0, 1), (0, 2), (1, 2), (2, 3), (1, 3), (0, 1), (1, 2)]
    assert surface.parts == ["web", "web", "web", "", "", "upper", ""]
    joints = np.stack([surface.start, surface.end], axis=1).ravel()
    assert joints[surface.facets].tolist() == [[0, 1, 2], [2, 1, 3]]
    radii = surface.radii.ravel()[surface.facets]
    assert radii.tolist() == [[0.3, 0.2, 0.1], [0.1, 0.2, 0.4]]


def test_offsets_turn_with_their_axes() -> None:
    """With the shoulder at a quarter turn and the elbow back, the offsets equal those
    worked out by hand.
    """
    surface = Surface(skeleton_of(ARM))
    pose = surface.kinematics.forward(np.array([[0, np.pi / 2, -np.pi / 2, 0.0]]))
    ends = [0, 0, 0], [2 - 0.5, 0, 0], [3, 0, -0.25]
    assert_allclose(surface.ends(pose)[0], ends, atol=1e-12)
    assert_allclose(surface.ends(pose, size=2.0, offset=0.5)[0, 1], [1.5, 0, 0], atol=1e-12)
    assert_allclose(surface.ends(pose, offset=0.0), pose.joints, atol=1e-12)


def test_parts_of_different_digits_are_kept_apart() -> None:
    """Parts of different digits, and digits and palm, are pairs; parts that touch at rest, or have
    no name, are not.
    """
    names = SURFACE_BLOCK.whole.joint_names
    ends = [(names[a], names[b]) for a, b in zip(SURFACE_BLOCK.start, SURFACE_BLOCK.end)]
    pairs = {frozenset((ends[i], ends[j])) for i, j in zip(*SURFACE_BLOCK.apart)}
    tip = ("index_dip", "index_tip")
    thumb = ("thumb_dip", "thumb_tip")
    ring = ("ring_dip", "ring_tip")
    for one, other in (
        (tip, ("middle_base", "middle_pip_a")),
        (thumb, ("wrist_left", "little_mcp")),
        (("thumb_pip", "thumb_dip"), ("index_base", "index_pip_a")),
        (("ring_pip_b", "ring_dip"), ("wrist_middle", "index_mcp")),
    ):
        assert frozenset((one, other)) in pairs
    for one, other in (
        (tip, ("index_base", "index_pip_a")),
        (("index_mcp", "index_base"), ("middle_mcp", "middle_base")),
        (("ring_base", "ring_pip_a"), ("wrist_left", "ring_mcp")),
        (ring, ("thumb_mcp", "thumb_pip")),
        (ring, ("forearm", "elbow")),
    ):
        assert frozenset((one, other)) not in pairs


def test_penetration_of_two_arms() -> None:
    crossed = skeleton_of(
        """dof { name: "y" } joint { name: "a" } joint { name: "b" parent: "a" bone { axis: X length: 2 } }
        joint { name: "c" translate { axis: Y dof: "y" } } joint { name: "d" parent: "c" bone { axis: Z length: 2 } }
        joint { name: "e" parent: "c" bone { axis: Y length: 5 } }
        flesh { joint { name: "f" parent: "e" bone { axis: X length: 2 } }
        capsule { from: "a" to: "b" radius: 0.3 part: "one" } capsule { from: "e" to: "f" radius: 0.5 part: "two" } }"""
    )
    surface = Surface(crossed)
    ends = surface.ends(surface.kinematics.forward(np.array([[0.0], [-4.4]])))
    assert_allclose(surface.penetration(ends, np.stack([surface.radii] * 2)), [-4.2, 0.2])
    a = ends[:, surface.start]
    b = ends[:, surface.end]
    radii = np.stack([surface.radii] * 2)
    assert_allclose(
        surface.mean_penetration(Capsules(a, b, radii[..., 0], radii[..., 1])), [0, 0.2]
    )
    alone = Surface(skeleton_of(ARM))
    assert alone.penetration(np.zeros((1, 3, 3)), alone.radii[None]) == -np.inf


def test_surface_is_written_and_scaled_with_its_body() -> None:
    assert skeleton_of(text_of(SKELETON.param, "hand", "")).param.flesh == SKELETON.param.flesh
    surface, twice = Surface(skeleton_of(ARM)), Surface(skeleton_of(ARM).scaled(2))
    inputs = np.full((1, 4), 0.3)
    inputs[:, 0] = 0
    assert_allclose(twice.radii, 2 * surface.radii)
    small, large = (one.ends(one.kinematics.forward(inputs)) for one in (surface, twice))
    assert_allclose(large, 2 * small)


FLESH = ARM[ARM.index("flesh") :]


MISTAKES = [
    *pairs_of(Path(__file__).with_name("surface_mistakes.txt")),
    ((FLESH, "flesh { }"), "5:7: error: no capsule and no wedge in the flesh"),
]


@bad_inputs(
    PrototxtError,
    {
        **{" -> ".join(change): (change, f"body.prototxt:{line}") for change, line in MISTAKES},
        "no flesh": (
            (FLESH, ""),
            NetlibError,
            "skeleton 'arm' has no flesh { ... }; expected capsules around its bones",
        ),
    },
)
def test_mistakes(given: Sequence[str], rejected: Any) -> None:
    assert ARM.count(given[0]) == 1
    with rejected:
        Surface(skeleton_of(ARM.replace(*given)))


def test_the_joints_of_each_finger(model: CapsuleModel, rng: np.random.Generator) -> None:
    """Three points of each finger: the middle of its two points at the PIP joint, the DIP
    joint and the tip.
    """
    names = model.skeleton.joint_names
    joints = rng.normal(size=(2, len(names), 3))
    found = Fingers(model.surface).joints(joints)
    assert found.shape == (2, 5, 3, 3)
    a, b = (joints[1, names.index(f"ring_pip_{end}")] for end in "ab")
    assert_allclose(found[1, FINGERS.index("ring"), 0], (a + b) / 2)
    for row, point in enumerate(("thumb_pip", "thumb_dip", "thumb_tip")):
        assert_allclose(found[0, 0, row], joints[0, names.index(point)])


def test_the_surface_of_each_finger(model: CapsuleModel) -> None:
    """Every finger has capsules, to its tip; none belongs to two fingers or to the arm."""
    surface = model.surface
    capsules = Fingers(surface).capsules
    assert capsules.sum(axis=0).max() == 1 and not (capsules & surface.limbs).any()
    for finger, own in zip(FINGERS, capsules, strict=True):
        assert model.skeleton.joint_names.index(f"{finger}_tip") in surface.end[own]


def test_bodies_without_fingers() -> None:
    assert has_fingers(SKELETON) and not has_fingers(any_skeleton(1))
