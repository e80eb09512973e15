"""Weights of the confidence of tracked poses, from recordings with labelled joints.

    python -m experiments.confidence RECORDING=JOINTS.npy [RECORDING=JOINTS.npy ...] [--apart RECORDING=JOINTS.npy ...]

JOINTS.npy has mm in the camera's axes, x right, y down, z away: (frames, 5 fingers from the thumb on, 4 joints from the
hand to the tip, 3), of the only hand; frames without a label are NaN. Each recording is tracked with the defaults of
``tools/track.py`` and ``--min-confidence 0``, as it is and mirrored. The weights of ``handpose.fit.pose_confidence``
are then fitted to the errors of the first recordings, each recording with the same total weight, and drawn towards
those in use. Whatever else is tracked, such as an object, is as wrong as a lost hand, and counts OTHERS. The report
gives, for the weights in use and for the new ones, the correlation of expected and true error, and how many poses with
a confidence of 90% or more are over 30 mm off: in each of these recordings when it is left out, and in those
``--apart``, which no weight is fitted to.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple
from unittest import mock

import numpy as np
from scipy.optimize import least_squares

from handpose import load_tracker, open_recording
from handpose.body.fingers import Fingers
from handpose.body.model import Surface
from handpose.fit import pose_confidence
from handpose.fit.network_errors import GOOD_MM, LOST_MM
from handpose.fit.pose_confidence import SIGNS, SPREAD, Evidence, Judged, judged, mean_log_error
from handpose.frames.cameras import Camera
from handpose.frames.recording import Recording
from netlib.blob import Array
from netlib.errors import DataError, NetlibError

SURE = 0.9
# Chosen by recordings left out. Of 1, 0.25, 0.1 and 0.05 for what is no hand: with 1, 12% of the hands have less than
# 50%, with 0.05 more of the others have more. Of 0, 0.3, 1, 3 and 10 for the weights in use: up to 1 they are alike.
OTHERS, SHRINK = 0.1, 0.3


class Poses(NamedTuple):
    """N tracked poses of one recording: what was seen of them, and their true errors (N,) in mm."""

    name: str
    evidence: Evidence
    error_mm: Array

    def judged(self, weights: Array, constant: float) -> Judged:
        """The expected errors and the confidence with other weights (9,)."""
        return judged(self.evidence, weights, constant)


def tracked(recording: Recording, labels: Array, mirrored: bool) -> Poses:
    """The poses that the tracker reports; the labels are (frames, 5, 3, 3). Raises DataError, NetlibError.

    All but the nearest to the labels are no hands: as wrong as a lost one.
    """
    seen: list[Evidence] = []  # in this frame

    def recorded(*args: object) -> Evidence:
        seen.append(observe(*args))  # type: ignore[arg-type]
        return seen[-1]

    observe = pose_confidence.evidence_of
    reported: list[Evidence] = []
    errors = []
    tracker = load_tracker(_mirrored(recording.camera) if mirrored else recording.camera, min_confidence=0)
    fingers = Fingers(Surface(tracker.predictor.skeleton))
    with recording, mock.patch.object(pose_confidence, "evidence_of", recorded):
        for frame, truth in zip_longest(recording, labels):
            if frame is None or truth is None:
                raise DataError(f"{recording.name}: expected as many frames as labels, {len(labels)}")
            if mirrored:
                frame, truth = frame._replace(depth=frame.depth[:, ::-1]), truth * (-1, 1, 1)
            seen.clear()
            hands = tracker.step(frame).hands
            if np.isnan(truth).any() or not hands:
                continue
            apart = [np.linalg.norm(labelled(fingers, hand.xyz) - truth, axis=2).mean() for hand in hands]
            # What is reported is judged last, and first as a hand of its side.
            reported += [one.take(slice(1)) for one in seen[-len(hands) :]]
            errors += [min(one, LOST_MM) if one == min(apart) else LOST_MM for one in apart]
    if not reported:
        raise DataError(f"{recording.name}: no hand is tracked in any labelled frame")
    return Poses(Path(recording.name).name, Evidence.concatenate(reported), np.array(errors))


def fitted(recordings: Sequence[Poses], shrink: float = SHRINK) -> tuple[Array, float, float]:
    """Weights (9,), constant and spread of the log errors; every recording counts alike, no weight is below 0.

    shrink  weight of the squared difference from the weights in use, against the mean squares of one recording
    """
    counts = [np.where(one.error_mm < LOST_MM, 1.0, OTHERS) for one in recordings]
    own = np.sqrt(np.concatenate([count / count.sum() for count in counts]))
    signs, lag = (np.concatenate([getattr(one.evidence, key) for one in recordings]) for key in ("signs", "lag_mm"))
    error = np.concatenate([one.error_mm for one in recordings])

    def differences(x: Array) -> Array:
        return np.asarray((mean_log_error(signs, lag, x[:-1], x[-1]) - np.log(error)) * own)

    def residuals(x: Array) -> Array:
        return np.append(differences(x), shrink * (x[:-1] - pose_confidence.WEIGHTS))

    start = np.append(pose_confidence.WEIGHTS, pose_confidence.CONSTANT)
    x = least_squares(residuals, start, bounds=(np.append(np.zeros(len(SIGNS)), -np.inf), np.inf)).x
    return x[:-1], float(x[-1]), float(np.sqrt((differences(x) ** 2).sum() / len(recordings)))


def row(name: str, poses: Sequence[Poses], judgements: Sequence[Judged]) -> str:
    """One line of the report, on poses with these expected errors and confidences."""
    expected, confidence, _ = (np.concatenate(part) for part in zip(*judgements))
    error = np.concatenate([one.error_mm for one in poses])
    sure = confidence >= SURE
    wrong = (error[sure] > GOOD_MM).mean() if sure.any() else np.nan
    return (f"{name:28}{len(error):6}{sure.sum():8}{wrong:8.1%}{np.corrcoef(expected, error)[0, 1]:8.2f}"
            f"{expected.mean():10.1f}{error.mean():8.1f}")


def _print_left_out(recordings: Sequence[Poses]) -> None:
    """Rows of each recording, with the weights in use and with those fitted to the others."""
    names = list(dict.fromkeys(one.name for one in recordings))
    judgements: list[Judged] = []
    for name in names:
        left = [one for one in recordings if one.name == name]
        print(row(name, left, _in_use(left)))
        if len(names) > 1:
            weights, constant, _ = fitted([one for one in recordings if one.name != name])
            own = [one.judged(weights, constant) for one in left]
            print(row(f"{name}, left out", left, own))
            judgements += own
    if len(names) > 1:
        print(row("all, each left out", [one for name in names for one in recordings if one.name == name], judgements))


def _in_use(poses: Sequence[Poses]) -> list[Judged]:
    return [one.judged(pose_confidence.WEIGHTS, pose_confidence.CONSTANT) for one in poses]


def labelled(fingers: Fingers, xyz: Array) -> Array:
    """PIP, DIP and tip (5, 3, 3) of each finger (of the thumb MCP, IP and tip) of joints (K, 3); axes of the labels."""
    return fingers.joints(xyz[None])[0] * (1, -1, 1)


def _mirrored(camera: Camera) -> Camera:
    return replace(camera, u0=camera.width - 1 - camera.u0)


def _pair(text: str) -> tuple[Path, Path]:
    recording, _, joints = text.rpartition("=")
    if not recording:
        raise argparse.ArgumentTypeError(f"{text!r}, expected RECORDING=JOINTS.npy")
    return Path(recording), Path(joints)


def _labels(path: Path) -> Array:
    """PIP, DIP and tip (frames, 5, 3, 3) of a file of labels. Raises DataError."""
    try:
        labels = np.load(path)
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: {error}") from None
    if labels.ndim != 4 or labels.shape[1:] != (5, 4, 3):
        raise DataError(f"{path}: shape {labels.shape}, expected (frames, 5, 4, 3)")
    return np.asarray(labels[:, :, 1:], np.float64)


def main(argv: Sequence[str] | None = None) -> int:
    """Track, fit, print."""
    parser = argparse.ArgumentParser(prog="experiments.confidence", description=__doc__.split("\n")[0])
    parser.add_argument("recordings", nargs="+", type=_pair, metavar="RECORDING=JOINTS.npy")
    parser.add_argument("--apart", nargs="+", type=_pair, default=[], metavar="RECORDING=JOINTS.npy")
    args = parser.parse_args(argv)
    try:
        labelled_recordings = [[(path, _labels(joints)) for path, joints in pairs]
                               for pairs in (args.recordings, args.apart)]
        own, apart = ([tracked(open_recording(path), labels, mirrored) for path, labels in pairs
                       for mirrored in (False, True)] for pairs in labelled_recordings)
    except NetlibError as error:
        print(error, file=sys.stderr)
        return 1
    weights, constant, spread = fitted(own)
    for sign, now, new in zip(SIGNS, pose_confidence.WEIGHTS, weights):
        print(f"{sign:14}{now:8.2f}{new:8.2f}")
    print(f"{'constant':14}{pose_confidence.CONSTANT:8.2f}{constant:8.2f}\n{'spread':14}{SPREAD:8.2f}{spread:8.2f}\n")
    print(f"{'recording':28}{'poses':>6}{'>= 90%':>8}{'> 30mm':>8}{'corr':>8}{'expected':>10}{'true':>8}")
    _print_left_out(own)
    for title, poses in (("all fitted to", own), ("all apart", apart)):
        if poses:
            print(row(title, poses, _in_use(poses)))
            print(row(f"{title}, new", poses, [one.judged(weights, constant) for one in poses]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
