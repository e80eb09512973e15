"""Shared parts of the hand exercises: skeletons, poses and training."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import numpy as np

from exercises import network
from exercises.exercise import Progress
from exercises.layers import in_place_of
from layers.hand.hand_model import HandModel
from layers.hand.kinematics import Kinematics
from layers.hand.skeleton import NYU_HAND, Skeleton, load
from layers.hand.skeleton_file import SkeletonParameter
from netlib.blob import Array
from netlib.proto import prototxt, schema

FINGER = """
name: "finger"
dof { name: "slide" } dof { name: "yaw" initial: 0.3 } dof { name: "bend" }
dof { name: "stiff" initial: 0.4 fixed: true }
joint { name: "base" translate { axis: X dof: "slide" }
        rotate { axis: Z dof: "stiff" } rotate { axis: NEG_Y dof: "yaw" } bone { axis: Y length: 0.5 } }
joint { name: "middle" parent: "base" rotate { axis: X dof: "bend" } bone { axis: Y length: 1 } }
joint { name: "tip" parent: "middle" translate { axis: Z dof: "slide" } rotate { axis: X dof: "bend" }
        bone { axis: NEG_Z length: 0.75 } }
"""


def finger() -> Skeleton:
    """Return a skeleton of three joints with a shared DoF, a fixed DoF and a rotation about a negative axis."""
    return Skeleton(schema.read(prototxt.parse(FINGER, "<finger>"), SkeletonParameter))


def nyu_hand() -> Skeleton:
    """Return the skeleton of the paper's hand."""
    return load(NYU_HAND)


def poses(skeleton: Skeleton, count: int = 2, seed: int = 0) -> Array:
    """Return random inputs (count, D)."""
    return np.asarray(np.random.default_rng(seed).uniform(-1, 1, (count, len(skeleton.dof_names))))


@contextlib.contextmanager
def in_hand_model(kinematics: type[Kinematics]) -> Iterator[None]:
    """Make HandModel layers use this class."""

    class Exercised(HandModel):
        kinematics_type = kinematics

    with in_place_of("HandModel", Exercised):
        yield


def losses(kinematics: type[Kinematics], iterations: int, progress: Progress) -> Array:
    """Train the paper's network with this class; returns the loss of each iteration."""
    with in_hand_model(kinematics):
        return network.losses(iterations, progress)
