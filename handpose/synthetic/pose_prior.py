"""How hands are held, and whose they are: the prior of synthetic poses, as numbers, and hands drawn from it.

Whose flesh is about them: ``flesh_prior``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from handpose.facts.cameras import Camera
from handpose.facts.nyu import CENTER_IN_PALM, CUBE_MM
from handpose.flesh.flesh import Flesh
from layers.hand import skeleton as skeletons
from layers.hand.bodies import kinematics_of
from netlib.blob import Array

FINGERS = ("little", "ring", "middle", "index")


@dataclass(frozen=True)
class PosePrior:
    """How hands are held, and whose they are. Angles in degrees are of the whole palm, R = Rz Rx Ry."""

    # Global rotation.
    roll_mean: float = 5.0  # Rz, most hands: normal
    roll_std: float = 40.0
    roll_uniform: float = 0.15  # Rz, this fraction: any angle
    pitch_mean: float = -12.0  # Rx: normal
    pitch_std: float = 32.0
    pitch_limit: float = 85.0  # largest |Rx|
    yaw_std: float = 50.0  # Ry, most hands: normal about 0
    yaw_uniform: float = 0.40  # Ry, this fraction: any angle

    # Fingers, as fractions of the skeleton's limits: 0 straight, 1 bent.
    curl_shared: tuple[float, float] = (0.7, 1.0)  # Beta: one curl for all fingers of a hand
    independent: float = 0.40  # this fraction of hands has ...
    curl_own: tuple[float, float] = (0.6, 0.8)  # ... Beta: a curl for each finger
    finger_noise: float = 0.18  # normal, of each angle about its curl, and of the spread about the initial pose
    thumb: tuple[float, float] = (1.3, 1.3)  # Beta: each thumb angle
    penetration: float = 5.0  # mm that fingers may sink into each other or the palm; deeper ones are drawn again
    redraws: int = 8  # at most so often

    # Place. The crop centre is NYU's annotated joint 34, which the model does not have.
    center_in_palm: tuple[float, float, float] = CENTER_IN_PALM  # mm, palm frame
    center_jitter: float = 3.0  # mm, normal, each axis
    center_jitter_wide: float = 7.5  # the same ...
    wide: float = 0.20  # ... for this fraction
    depth: tuple[float, float] = (550.0, 1000.0)  # mm, uniform
    lateral_x: tuple[float, float] = (-0.08, 0.08)  # x / z of the centre: normal, mean and deviation
    lateral_y: tuple[float, float] = (-0.03, 0.07)  # y / z of the centre: normal, mean and deviation

    # Bones, relative to the skeleton's.
    scale_std: float = 0.06  # the whole hand
    bone_std: float = 0.04  # each bone
    scale_clip: float = 2.5  # both are cut at so many deviations


DEFAULT_PRIOR = PosePrior()
# Hands in front of any camera: every roll, so that hands pointing down are as common as others, near and far.
ANY_ROLL = PosePrior(
    roll_uniform=0.6, pitch_std=36.0, depth=(250.0, 1200.0), center_jitter=4.0, center_jitter_wide=10.0
)


class Hands(NamedTuple):
    """N posed hands, in half-cubes from their crop centres."""

    inputs: Array  # (N, 47) parameters of the model
    bones: Array  # (N, 33) bone lengths, the flesh's own, too
    joints: Array  # (N, 31, 3)
    scale: Array  # (N,) size relative to the skeleton


class HandSampler:
    """Draws hands and their crop centres.

    skeleton  the NYU hand, whose limits bound the fingers and whose bones are varied
    flesh     that of the hands, which keeps fingers from running through each other

    rotation, translation, thumb  the DoFs of the palm, about z, x, y and along x, y, z, and of the thumb
    flexions, spreads             (4, 3), (4,) those that bend the fingers of ``FINGERS``, and that spread them
    """

    def __init__(self, prior: PosePrior = DEFAULT_PRIOR, cube_mm: float = CUBE_MM) -> None:
        self.prior, self.cube_mm = prior, cube_mm
        self.skeleton = skeletons.load()
        self.flesh = Flesh(self.skeleton)
        self.kinematics = kinematics_of(self.skeleton)
        dof = self.skeleton.dof_names.index
        self._palm = self.skeleton.joint_names.index("palm")
        self.rotation = [dof(f"palm_rot_{axis}") for axis in "zxy"]
        self.translation = [dof(f"palm_{axis}") for axis in "xyz"]
        self.flexions = np.array([[dof(f"{f}_{part}_rot_x") for part in ("base", "pip", "dip")] for f in FINGERS])
        self.spreads = np.array([dof(f"{f}_base_rot_z") for f in FINGERS])
        self.thumb = np.array([dof(f"thumb_{d}") for d in ("pip_rot_y", "pip_rot_z", "dip_rot_z", "tip_rot_z")])

    def hands(self, rng: np.random.Generator, count: int) -> Hands:
        """Draw ``count`` hands in poses in which fingers do not run through each other."""
        p, sk, flesh, kinematics = self.prior, self.skeleton, self.flesh, self.flesh.kinematics
        scale = 1 + p.scale_std * cut_normal(rng, (count,), p.scale_clip)
        whole_bones = flesh.whole.bones
        bones = (
            whole_bones * scale[:, None] * (1 + p.bone_std * cut_normal(rng, (count, len(whole_bones)), p.scale_clip))
        )
        inputs = np.zeros((count, len(flesh.whole.initial)))
        inputs[:, self.rotation] = self.rotations(rng, count) - sk.initial[self.rotation]
        todo = np.arange(count)
        depth = np.full(count, np.inf)
        for _ in range(p.redraws):
            trial = inputs[todo]
            self._draw_fingers(rng, trial)
            ends = flesh.ends(kinematics.forward(trial, bones[todo]), scale[todo])
            found = flesh.penetration(ends, flesh.radii * scale[todo, None, None]) * (self.cube_mm / 2)
            better = found < depth[todo]
            inputs[todo[better]] = trial[better]
            depth[todo[better]] = found[better]
            todo = np.flatnonzero(depth > p.penetration)
            if not len(todo):
                break
        # The crop centre hangs on the palm; the origin is the crop centre.
        wide = rng.random((count, 1)) < p.wide
        jitter = rng.standard_normal((count, 3)) * np.where(wide, p.center_jitter_wide, p.center_jitter)
        palm = kinematics.rotation_of(kinematics.forward(inputs, bones), self._palm)
        center = np.einsum("nij,j->ni", palm, p.center_in_palm) * scale[:, None] + jitter
        inputs[:, self.translation] = -center / (self.cube_mm / 2) - sk.initial[self.translation]
        joints = kinematics.joints(inputs, bones)[:, : len(sk.joint_names)]
        return Hands(inputs[:, : len(sk.initial)], bones, joints, scale)

    def rotations(self, rng: np.random.Generator, count: int) -> Array:
        """Draw angles (count, 3) of whole palms about z, x, y in radians."""
        p = self.prior
        z = np.where(
            rng.random(count) < p.roll_uniform,
            rng.uniform(-180, 180, count),
            p.roll_mean + p.roll_std * rng.standard_normal(count),
        )
        x = np.clip(p.pitch_mean + p.pitch_std * rng.standard_normal(count), -p.pitch_limit, p.pitch_limit)
        y = np.where(
            rng.random(count) < p.yaw_uniform,
            rng.uniform(-180, 180, count),
            p.yaw_std * rng.standard_normal(count),
        )
        return np.asarray(np.deg2rad(np.stack([z, x, y], axis=1)))

    def _draw_fingers(self, rng: np.random.Generator, inputs: Array) -> None:
        """Set the angles of fingers and thumb in ``inputs`` (N, 47), within their limits."""
        p, N = self.prior, len(inputs)
        lower, upper = self.skeleton.lower, self.skeleton.upper
        own = rng.beta(*p.curl_own, (N, len(FINGERS)))
        shared = rng.beta(*p.curl_shared, (N, 1))
        curl = np.where(rng.random((N, 1)) < p.independent, own, shared)[:, :, None]
        bent = np.clip(curl + p.finger_noise * rng.standard_normal((N, *self.flexions.shape)), 0, 1)
        inputs[:, self.flexions] = upper[self.flexions] - bent * (upper - lower)[self.flexions]
        d = self.spreads
        spread = p.finger_noise * rng.standard_normal((N, len(d))) * (upper - lower)[d]
        inputs[:, d] = np.clip(spread, lower[d], upper[d])
        d = self.thumb
        inputs[:, d] = lower[d] + rng.beta(*p.thumb, (N, len(d))) * (upper - lower)[d]

    def centers(self, rng: np.random.Generator, count: int, camera: Camera) -> Array:
        """Crop centres (count, 3): px, px, mm; exact in float32, as the labels store them."""
        p = self.prior
        z = rng.uniform(*p.depth, count)
        x = (p.lateral_x[0] + p.lateral_x[1] * rng.standard_normal(count)) * z
        y = (p.lateral_y[0] + p.lateral_y[1] * rng.standard_normal(count)) * z
        uvd = camera.project(np.stack([x, y, z], axis=1))
        return uvd.astype(np.float32).astype(np.float64)


def cut_normal(rng: np.random.Generator, shape: tuple[int, ...], cut: float) -> Array:
    """Standard normal numbers, those beyond ``cut`` moved there."""
    return np.clip(rng.standard_normal(shape), -cut, cut)
