"""Expected error and confidence of a pose as it is reported, by the image in which it was found.

The cost of a fit does not tell: a fit to the visible part of a covered hand costs no more than one
of a whole hand, its joints may be in empty space, and the reported pose may be smoothed. So it is
judged by several signs, all 0 or more:

    surface, outline, prior  of the fit: parts of its cost
    behind       mm, by which its joints are behind the surface that was read: the hand
                 hides them itself
    before       mm, by which they are in front of it, in empty space
    penetration  mm, mean over the capsules of how deep another part penetrates them
    guessed      share of the fingers' own surface towards the camera that was not seen at its
                 place, mean over the fingers; of a body without fingers, of its whole surface

The logarithm of the error in mm is taken to be normally distributed, with the deviation
``spread``. Its mean is

    mean = log √(fit² + lag² + before²)        log fit = Σ weight log(1 + sign) + constant

with the lag, the mean distance in mm of the reported joints from those of the fit, because no
reported pose can be better than that. So

    whole = exp(mean + spread² / 2)
    confidence = P(error < 30 mm) = Φ((log 30 - mean) / spread)

If only a small share of the hand's own surface was seen at its place, the pose is a guess, and the
confidence is reduced in proportion to that share (``JudgeSettings.least_shown``).

The expected error of a hand is the geometric mean of ``whole`` and of the mean of its fingers'
expected errors, because what is wrong with a hand that is found is mostly a finger; without fingers
it is ``whole``. It is at least 30 mm times the probability of a larger one (Markov's inequality).

The error of a hand is a mean over its joints, and a hand that is right as a whole may have a finger
that is a guess: because the palm or another finger hides it, because it is in empty space, or
because the smoothed pose lags. With means over the finger's PIP joint, DIP joint and tip
(of the thumb: MCP joint, IP joint and tip), the logarithm of a finger's error in mm is taken to be
normally distributed, too, with the mean

    mean = weights · (log whole, log(1 + behind), log(1 + before), log(1 + lag), 1 - seen)
           + constant

    behind, before  mm, by which the joints are behind and in front of the readings
                    (``ImageSupport.joint_depths``)
    lag             mm, distance of the reported joints from those of the fit
    seen            share of the finger's own surface that was seen at its place; 0 if the hand
                    itself covers all of it

so that the expected error is exp(mean + spread² / 2), at most LOST_MM.

Weights, constants and spreads are data, in ``PACKAGED``. ``python -m experiments confidence`` fits
them to recordings with labelled joints; the model card says to which, and docs/fit.md has the
results on others.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.body.model import FINGERS
from handpose.fit.body import CapsuleModel
from handpose.fit.depth_fit import DepthFit
from handpose.fit.settings import FitSettings
from handpose.fit.support import ImageSupport, JointDepths
from handpose.frames.cameras import Camera
from netlib.blob import Array
from netlib.errors import PrototxtError
from netlib.files.paths import ROOT
from netlib.proto import prototxt, schema
from netlib.proto.schema import Double

PACKAGED = ROOT / "models" / "synthetic_hand" / "confidence.prototxt"
GOOD_MM = 30.0  # a pose with a larger error has failed
LOST_MM = 150.0  # upper bound of expected errors: then the hand is elsewhere
SIGNS = ("surface", "outline", "prior", "behind", "before", "penetration", "guessed")
FINGER_SIGNS = ("whole", "behind", "before", "lag", "unseen")
MAX_SIGN = 1e6  # instead of the infinite signs of an empty crop


@dataclass(frozen=True)
class HandParameter:
    """The ``hand { ... }`` of a file of weights."""

    surface: Double
    outline: Double
    prior: Double
    behind: Double
    before: Double
    penetration: Double
    guessed: Double
    constant: Double
    spread: Double


@dataclass(frozen=True)
class FingerParameter:
    """The ``finger { ... }`` of a file of weights."""

    whole: Double
    behind: Double
    before: Double
    lag: Double
    unseen: Double
    constant: Double
    spread: Double


@dataclass(frozen=True)
class WeightsParameter:
    """A whole file of weights."""

    hand: HandParameter
    finger: FingerParameter


class Regression(NamedTuple):
    """Weights (S,) of signs, the constant, and the deviation of the logarithm of
    the error in mm.
    """

    weights: Array
    constant: float
    spread: float


class Regressions(NamedTuple):
    """The regressions of hands, by ``SIGNS``, and of fingers, by ``FINGER_SIGNS``."""

    hand: Regression
    finger: Regression


@functools.lru_cache(maxsize=4)
def read_weights(path: Path = PACKAGED) -> Regressions:
    """The weights in a file. Raises PrototxtError."""
    read = schema.read(prototxt.parse_file(path), WeightsParameter, f"weights {path}")
    return Regressions(_regression(read.hand, SIGNS), _regression(read.finger, FINGER_SIGNS))


def _regression(read: HandParameter | FingerParameter, signs: Sequence[str]) -> Regression:
    for name in (*signs, "constant", "spread"):
        value = getattr(read, name)
        if not np.isfinite(value) or (value <= 0 and name == "spread"):
            expected = "a number above 0" if name == "spread" else "a finite number"
            raise PrototxtError(
                schema.position_of(read, name), f"{name}: {value:g}; expected {expected}"
            )
    return Regression(np.array([getattr(read, sign) for sign in signs]), read.constant, read.spread)


def pose_signs(parts: Array, depths: JointDepths, penetration_mm: Array, guessed: Array) -> Array:
    """The signs (N, 7) of N poses; ``parts`` (N, 4) are those of the costs of their fits."""
    surface, outline, _, prior = parts.T
    signs = (surface, outline, prior, depths.behind, depths.before, penetration_mm, guessed)
    return np.minimum(np.column_stack(signs), MAX_SIGN)


def mean_log_error(signs: Array, lag_mm: Array, hand: Regression) -> Array:
    """The mean (N,) of the logarithm of the error in mm, of poses with these signs (N, 7)."""
    fit = np.exp(np.log1p(signs) @ hand.weights + hand.constant)
    before = signs[:, SIGNS.index("before")]
    squares = fit**2 + lag_mm**2 + before**2
    return np.log(np.sqrt(squares))


def least_error(confidence: Array) -> Array:
    """The least expected error in mm that agrees with a confidence (Markov's inequality)."""
    return GOOD_MM * (1 - confidence)


def unknown_finger_errors() -> Array:
    """The errors (5,) of fingers about which nothing is known: NaN."""
    return np.full(len(FINGERS), np.nan)


def finger_signs(whole_mm: Array, evidence: Evidence) -> Array:
    """The signs (N, 5, 5), in the order of ``FINGER_SIGNS``, of the fingers of hands with these
    errors (N,) in mm.
    """
    whole = np.broadcast_to(np.log(whole_mm)[:, None], evidence.seen.shape)
    depths = np.log1p(evidence.behind), np.log1p(evidence.before)
    return np.stack([whole, *depths, np.log1p(evidence.finger_lag_mm), 1 - evidence.seen], axis=-1)


def finger_errors(signs: Array, finger: Regression) -> Array:
    """The expected errors (N, 5) in mm of fingers with these signs (N, 5, 5)."""
    mean = signs @ finger.weights + finger.constant
    return np.minimum(np.exp(mean + finger.spread**2 / 2), LOST_MM)


class Evidence(NamedTuple):
    """What an image shows of N poses.

    signs    (N, 7), those of ``SIGNS``
    lag_mm   (N,) distance of the joints from those of the fit
    shown    (N,) share of the hand's own surface towards the camera that was seen at its place
    behind, before, finger_lag_mm, seen  (N, 5) of the fingers (``finger_signs``); (N, 0) of bodies
                                         without fingers
    """

    signs: Array
    lag_mm: Array
    shown: Array
    behind: Array
    before: Array
    finger_lag_mm: Array
    seen: Array

    @classmethod
    def concatenate(cls, parts: Sequence[Evidence]) -> Evidence:
        """What images show of the poses of all parts, of one body."""
        return cls(*map(np.concatenate, zip(*parts)))

    def lagging(self, model: CapsuleModel, joints: Array, fit_joints: Array) -> Evidence:
        """The same for poses with joints (N, K, 3) in mm instead of those of the fits, in one
        system of axes.
        """
        lag = np.linalg.norm(joints - fit_joints, axis=2).mean(axis=1)
        of_fingers = self.finger_lag_mm
        if model.fingers is not None:
            apart = model.fingers.joints(joints) - model.fingers.joints(fit_joints)
            of_fingers = np.linalg.norm(apart, axis=3).mean(axis=2)
        return self._replace(lag_mm=lag, finger_lag_mm=of_fingers)

    def take(self, rows: slice) -> Evidence:
        """What is shown of some of the poses."""
        return Evidence(*(values[rows] for values in self))


class Judged(NamedTuple):
    """What is known of N poses.

    error_mm         (N,) expected error
    confidence       (N,) probability of an error below GOOD_MM
    finger_error_mm  (N, 5) expected error of each finger (``finger_errors``); NaN for bodies
                     without fingers
    """

    error_mm: Array
    confidence: Array
    finger_error_mm: Array


class Judge:
    """Judges poses by the images in which they were found.

    support  compares poses with images
    """

    def __init__(self, settings: FitSettings) -> None:
        self.settings = settings.judge
        self.support = ImageSupport(settings.support)

    def as_wholes(self, evidence: Evidence, hand: Regression) -> tuple[Array, Array]:
        """Expected errors (N,) in mm and confidence (N,) of N poses of which this is seen, whatever
        their fingers show.
        """
        # the distribution function Φ, imported here: few programs need it
        from scipy.special import ndtr as normal

        mean = mean_log_error(evidence.signs, evidence.lag_mm, hand)
        confidence = normal((np.log(GOOD_MM) - mean) / hand.spread)
        confidence *= np.minimum(evidence.shown / self.settings.least_shown, 1)
        error = np.exp(mean + hand.spread**2 / 2)
        return np.clip(error, least_error(confidence), LOST_MM), confidence

    def judged(self, evidence: Evidence, weights: Regressions | None = None) -> Judged:
        """Errors and confidence of N poses of which this is seen, by the packaged weights if there
        are no others.
        """
        hand, finger = weights or read_weights()
        whole, confidence = self.as_wholes(evidence, hand)
        if not evidence.seen.size:
            return Judged(whole, confidence, np.tile(unknown_finger_errors(), (len(whole), 1)))
        of_fingers = finger_errors(finger_signs(whole, evidence), finger)
        error = np.sqrt(whole * of_fingers.mean(axis=1))
        return Judged(np.maximum(error, least_error(confidence)), confidence, of_fingers)

    def evidence_of(
        self,
        model: CapsuleModel,
        fits: DepthFit,
        center_mm: Array,
        readings: NDArray[np.floating],
        camera: Camera,
    ) -> Evidence:
        """What one image (height, width) in mm, 0 without a reading, shows of N fits with the
        origins ``center_mm`` (N, 3).
        """
        fingers = model.fingers
        none = np.zeros(len(fits))
        capsules = model.capsules(fits.x, center_mm)
        parts = () if fingers is None else tuple(fingers.capsules)
        limbs = model.surface.limbs
        support = self.support
        whole, *of_parts = support.support_of_parts(capsules, limbs, parts, readings, camera)
        seen = np.array([part.seen for part in of_parts]).reshape(len(parts), len(fits)).T
        guessed = 1 - (seen.mean(axis=1) if parts else whole.seen)
        in_camera = fits.joints + center_mm[:, None]
        depths = support.joint_depths(in_camera, readings, camera)
        signs = pose_signs(fits.parts, depths, model.surface.mean_penetration(capsules), guessed)
        behind = before = np.zeros(seen.shape)
        if fingers is not None:
            joints = fingers.joints(in_camera).reshape(-1, 3, 3)
            of_joints = support.joint_depths(joints, readings, camera)
            behind, before = (depth.reshape(seen.shape) for depth in of_joints)
        return Evidence(signs, none, whole.seen, behind, before, np.zeros(seen.shape), seen)

    def side_log_ratio(self, cost: float, other_cost: float) -> float:
        """The logarithm of ``other_cost``, of the fit to one image as the other side, over
        ``cost``: above 0 if the side of the fit with ``cost`` is the likelier one, up to a maximum.
        """
        own, other = (np.log(np.clip(one, 1e-9, 1e9)) for one in (cost, other_cost))
        most = self.settings.max_ratio
        return float(np.clip(other - own, -most, most))

    def side_chance(self, log_ratio: float) -> float:
        """The probability of a side with this mean ``side_log_ratio``."""
        return float(1 / (1 + np.exp(-self.settings.side_slope * log_ratio)))
