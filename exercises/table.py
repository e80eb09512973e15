"""The exercises in the order of the book."""

from __future__ import annotations

from exercises import (
    convolution,
    dropout,
    euclidean_loss,
    inner_product,
    joint_transform,
    phys_limit,
    pooling,
    relu,
    resume,
    sgd,
    split,
    torque_gradient,
)
from exercises.exercise import Exercise

EXERCISES: dict[str, Exercise] = {
    module.EXERCISE.name: module.EXERCISE
    for module in (
        relu,
        inner_product,
        convolution,
        pooling,
        split,
        euclidean_loss,
        sgd,
        dropout,
        resume,
        joint_transform,
        torque_gradient,
        phys_limit,
    )
}
