"""Shared parts of the hand exercises: skeletons, poses and training."""

from __future__ import annotations

import numpy as np

from exercises import network
from exercises.exercise import Part, replaced
from layers import LAYER_TYPES
from layers.hand.hand_model import HandModel
from layers.hand.skeleton import NYU_HAND, Skeleton, load
from layers.hand.skeleton_file import SkeletonParameter
from netlib.blob import Array
from netlib.proto import prototxt, schema

# Three joints, with a shared DoF, a fixed DoF and a rotation about a negative axis.
FINGER_TEXT = """
name: "finger"
dof { name: "slide" } dof { name: "yaw" initial: 0.3 } dof { name: "bend" }
dof { name: "stiff" initial: 0.4 fixed: true }
joint { name: "base" translate { axis: X dof: "slide" }
        rotate { axis: Z dof: "stiff" } rotate { axis: NEG_Y dof: "yaw" } bone { axis: Y length: 0.5 } }
joint { name: "middle" parent: "base" rotate { axis: X dof: "bend" } bone { axis: Y length: 1 } }
joint { name: "tip" parent: "middle" translate { axis: NEG_Z dof: "slide" } rotate { axis: X dof: "bend" }
        rotate { axis: Z dof: "stiff" } bone { axis: NEG_Z length: 0.75 } }
"""
FINGER = Skeleton(schema.read(prototxt.parse(FINGER_TEXT, "<finger>"), SkeletonParameter))
# two random poses of the finger (2, D)
POSES = np.random.default_rng(0).uniform(-1, 1, (2, len(FINGER.dof_names)))
NYU = load(NYU_HAND)  # the paper's hand


def losses(part: Part, iterations: int) -> Array:
    """Train the paper's network with the class Kinematics of the part; returns the loss of
    each iteration.
    """
    exercised = type("Exercised", (HandModel,), {"kinematics_type": part.Kinematics})
    with replaced(LAYER_TYPES, "HandModel", exercised):
        return network.losses(iterations)
