"""Hands with known poses, and their depth images."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from handpose.fit.body import SIZE_INDEX, THICKNESS_INDEX, CapsuleModel, Posed
from handpose.fit.observation import HandCrops, Observation, observe
from handpose.fit.residuals import Residuals
from handpose.frames.cameras import NYU
from handpose.synthetic.generator import Generator, Recipe, SyntheticCamera
from tests.support.packaged_hand import EXACT


class Scene(NamedTuple):
    """N frames: crops (N, 128, 128), centres (N, 3), the truth as variables (N, V) and as joints
    (N, 31, 3) mm.
    """

    crops: np.ndarray
    center_uvd: np.ndarray
    truth: np.ndarray
    joints: np.ndarray
    seen: Observation


@pytest.fixture(scope="session")
def scene(model: CapsuleModel) -> Scene:
    """Twelve hands with the packaged bones, without noise."""
    drawn = Generator(5, "train", Recipe(prior=EXACT, views=(SyntheticCamera(NYU, None),))).scene(0)
    crops, uvd = drawn.depth[:12], drawn.center_uvd[:12]
    truth = model.variables_of(drawn.bodies.inputs[:12])
    return Scene(
        crops,
        uvd,
        truth,
        drawn.bodies.joints[:12] * 150,
        observe(HandCrops(crops, uvd, NYU, 300.0), 400, 3.0),
    )


@pytest.fixture(scope="session")
def few(scene: Scene) -> Scene:
    """Six of the hands."""
    crops, center_uvd, truth, joints, seen = scene
    return Scene(crops[:6], center_uvd[:6], truth[:6], joints[:6], seen.take(slice(6)))


def written_out(model: CapsuleModel, posed: Posed, r: Residuals) -> np.ndarray:
    """The Jacobian (N, 2, R, V) of residuals, computed row by row from the motion of the
    capsules' ends.
    """
    n, s = np.arange(len(posed.ends))[:, None], r.place[..., None, None]
    motion = (
        posed.motion[n, model.start[r.capsule]] * (1 - s)
        + posed.motion[n, model.end[r.capsule]] * s
    )
    J = np.einsum("nitr,nriv->ntrv", r.direction.astype(float), motion)
    J[..., [SIZE_INDEX, THICKNESS_INDEX]] += r.swell[..., None]
    return J


def slopes(function, x: np.ndarray, step: float = 1e-3) -> np.ndarray:
    """Central differences of a function of x (N, V) along each variable, (N, ..., V)."""
    columns = []
    for v in range(x.shape[1]):
        d = np.zeros(x.shape[1])
        d[v] = step
        columns.append((np.asarray(function(x + d), float) - function(x - d)) / (2 * step))
    return np.stack(columns, axis=-1)


def start_of(scene: Scene, model: CapsuleModel) -> np.ndarray:
    """The truth with errors of about 0.15 radians in every angle and 15 mm in every direction."""
    off = np.random.default_rng(1).normal(0, 0.15, scene.truth.shape)
    off[:, :3] *= 0.6
    off[:, -2:] = 0
    return np.clip(scene.truth + off, model.lower, model.upper)


def error(model: CapsuleModel, x: np.ndarray, scene: Scene) -> np.ndarray:
    """Mean error (N,) in mm."""
    return np.linalg.norm(model.joints(x) - scene.joints, axis=2).mean(axis=1)
