"""Fit the weights of the confidence of poses to recordings with labelled joints, and write them.

    python -m experiments confidence --recording P1 P1_joints.npy --recording P4 P4_joints.npy \\
        --seed 1 --apart P3 P3_joints.npy --out models/synthetic_hand/confidence.prototxt
    python -m experiments confidence --synthetic gestures moving --cameras kinect2 --seconds 10

Labels are those of ``python -m experiments constants``, of the only hand in view; the joints of
synthetic recordings are known. Each recording is tracked as it is and mirrored, by earlier frames
only, and every pose counts, however sure. The logarithms of the errors are then explained by the
signs that handpose/fit/pose_confidence.py describes, first of hands, then of fingers. All
recordings have the same total weight, no weight of a sign is below 0, and weights are drawn towards
those in use (--keep). What is tracked in addition to the labelled hand, and a pose at another of
the two most certain places of the finder, is as wrong as a lost hand and counts a tenth. The
packaged network and its fit must be those for which the confidence is computed.

A row has the labelled hands, those with a confidence of 90% or more, the share of these that is
more than 30 mm off, the correlation of expected and true error, both in mm; then the other poses,
and those of 30% or more, which would have joints. Rows are for the weights in use, for the new
ones, and for those fitted without the recording. No weight is fitted to the recordings --apart.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from experiments.constants import OFF_MM, SURE, TrackedLabels, labels_of, tracked_labels
from handpose import CAMERAS, open_recording
from handpose.body.model import FINGERS, Fingers, Surface
from handpose.fit.body import CapsuleModel
from handpose.fit.pose_confidence import (
    FINGER_SIGNS,
    LOST_MM,
    SIGNS,
    Evidence,
    Judge,
    Regression,
    Regressions,
    finger_signs,
    mean_log_error,
    read_weights,
)
from handpose.fit.settings import FitSettings
from handpose.frames.recording import Recording
from handpose.sequences.recordings import SCRIPTS, SyntheticRecording
from handpose.tracking.hand_track import HandTrack
from handpose.tracking.output import variables_of
from handpose.tracking.settings import TrackSettings
from netlib.blob import Array
from netlib.errors import DataError
from netlib.files import atomic
from tools.common import outputs
from tools.common.arguments import real, seconds, seed
from tools.common.console import DONE, aligned, say
from tools.common.progress import ProgressBar

# Of 1, 0.25, 0.1 and 0.05: with 1, 12% of the hands have less than 50%, with 0.05 more of the
# others have more.
OTHERS = 0.1
PLACES = 2  # of the finder in a frame: the hand, and another one
KEEP = 0.3  # of 0, 0.3, 1, 3 and 10; up to 1 they are alike when a recording is left out
COMMENT = """Weights of the confidence of poses: handpose/fit/pose_confidence.py has the formulas.
Fitted by `python -m experiments confidence` to {count} poses of {names},
each as it is and mirrored; --seed {seed} --keep {keep:g}."""
HEAD = [
    "recording",
    "hands",
    "sure",
    "off",
    "correlation",
    "expected",
    "true",
    "others",
    "with joints",
]


class Poses(NamedTuple):
    """N tracked poses of a recording.

    evidence    what their images show of them
    error_mm    (N,) true errors; LOST_MM of what is not the labelled hand
    fingers_mm  (N, 5) true errors of the fingers; NaN likewise
    """

    name: str
    evidence: Evidence
    error_mm: Array
    fingers_mm: Array

    @property
    def share(self) -> Array:
        """The weight (N,) of each pose; their sum is 1."""
        weight = np.where(self.is_hand, 1.0, OTHERS)
        return np.asarray(weight / weight.sum())

    @property
    def is_hand(self) -> NDArray[np.bool_]:
        """True (N,) for the labelled hand."""
        return np.isfinite(self.fingers_mm[:, 0])


class Labelled(NamedTuple):
    """A recording, and its labels (frames, 5, 3, 3): PIP, DIP and tip of each finger, y up;
    NaN without any.
    """

    name: str
    open: Callable[[], Recording]
    labels: Array


# ------------------------------------------------------------------------------------ tracked poses


def poses_of(name: str, frames: Iterator[TrackedLabels]) -> Poses:
    """The poses that are tracked in labelled frames. Raises DataError if there is none."""
    evidence, fingers = [], []
    lost = np.full(len(FINGERS), np.nan)
    for frame in frames:
        nearest = min((apart.mean() for apart in frame.apart), default=np.inf)
        for hand, apart in zip(frame.hands, frame.apart):
            is_labelled = apart.mean() == nearest < LOST_MM
            evidence.append(evidence_of_track(frame.tracker.track_of(hand), frame.tracker.model))
            fingers.append(apart.mean(axis=1) if is_labelled else lost)
        others = evidence_of_others(frame)
        evidence += others
        fingers += [lost] * len(others)
    if np.isnan(fingers).all():
        raise DataError(f"{name}: no hand is tracked in any labelled frame")
    of_fingers = np.array(fingers)
    error = of_fingers.mean(axis=1)
    return Poses(
        name, Evidence.concatenate(evidence), np.where(np.isnan(error), LOST_MM, error), of_fingers
    )


def evidence_of_others(frame: TrackedLabels) -> list[Evidence]:
    """What an image shows of poses at the finder's places away from the only hand."""
    predictor, middle, found = frame.tracker.predictor, frame.label.mean(axis=(0, 1)), []
    for other in frame.tracker.finder.hands(frame.depth, predictor.camera, most=PLACES):
        with contextlib.suppress(DataError):  # the pose leads out of the image
            hand = predictor.in_frame(frame.depth, predictor.camera.project(other.middle))
            if (
                min(np.linalg.norm(place - middle) for place in (other.middle, hand.center_mm))
                > LOST_MM
            ):
                assert hand.evidence is not None
                found.append(hand.evidence)
    return found


def evidence_of_track(track: HandTrack, model: CapsuleModel) -> Evidence:
    """What the last image shows of a tracked hand's reported pose."""
    seen = track.best
    hand = seen.estimate
    assert hand.evidence is not None  # the errors of the packaged network are measured
    x = variables_of(model, [seen.smooth], hand.view_center_mm[None], track.size)
    return hand.evidence.lagging(model, model.joints(x), hand.the_fit.joints)


def true_labels(recording: SyntheticRecording) -> Array:
    """The labels (frames, 5, 3, 3) of the only hand in view; NaN without one."""
    fingers = Fingers(Surface(recording.header.skeleton))
    labels = np.full((recording.count, 5, 3, 3), np.nan)
    for n, truth in enumerate(recording.truths()):
        if len(truth.hands) == 1:
            labels[n] = fingers.joints(truth.hands[0].xyz[None])[0]
    return labels


# -------------------------------------------------------------------------------------- regressions


def fitted(takes: Sequence[Poses], in_use: Regressions, keep: float = KEEP) -> Regressions:
    """The weights that explain the errors of recordings; ``keep`` is the weight of the squared
    change of a weight.
    """
    evidence = Evidence.concatenate([take.evidence for take in takes])
    share = np.concatenate([take.share for take in takes])
    log_error = np.log(np.concatenate([take.error_mm for take in takes]))
    hand = _regression(
        lambda to: mean_log_error(evidence.signs, evidence.lag_mm, to),
        log_error,
        share,
        in_use.hand,
        keep,
    )
    of_fingers = np.concatenate([take.fingers_mm for take in takes])
    known = np.isfinite(of_fingers)
    judge = Judge(FitSettings())
    signs = finger_signs(judge.as_wholes(evidence, hand)[0], evidence)[known]
    finger_share = np.repeat(share[:, None], known.shape[1], axis=1)[known]
    finger_share = finger_share / finger_share.sum() * len(takes)
    log_error = np.log(of_fingers[known])
    finger = _regression(
        lambda to: signs @ to.weights + to.constant, log_error, finger_share, in_use.finger, keep
    )
    return Regressions(hand, finger)


def _regression(
    mean: Callable[[Regression], Array],
    log_error: Array,
    share: Array,
    in_use: Regression,
    keep: float,
) -> Regression:
    """The regression with the least squares of ``mean`` - ``log_error``; the shares of each
    take add up to 1.
    """

    def off(x: Array) -> Array:
        difference = mean(Regression(x[:-1], x[-1], np.nan)) - log_error
        return np.asarray(difference * np.sqrt(share))

    def residuals(x: Array) -> Array:
        return np.append(off(x), keep * (x[:-1] - in_use.weights))

    start = np.append(in_use.weights, in_use.constant)
    lower = np.append(np.zeros(len(in_use.weights)), -np.inf)
    x = least_squares(residuals, start, bounds=(lower, np.inf)).x
    spread = np.sqrt((off(x) ** 2).sum() / share.sum())
    return Regression(x[:-1], float(x[-1]), float(spread))


# -------------------------------------------------------------------------------------- the results


def text_of(weights: Regressions, comment: str) -> str:
    """The text of a file of weights, with a comment at the top."""
    lines = [f"# {line}" for line in comment.splitlines()]
    for name, signs, of in (
        ("hand", SIGNS, weights.hand),
        ("finger", FINGER_SIGNS, weights.finger),
    ):
        values = zip((*signs, "constant", "spread"), (*of.weights, of.constant, of.spread))
        lines += [f"{name} {{", *(f"  {sign}: {value:.3f}" for sign, value in values), "}"]
    return "\n".join(lines) + "\n"


def cells_of(name: str, takes: Sequence[Poses], weights: Regressions) -> list[str]:
    """The columns of recordings, judged by these weights."""
    evidence = Evidence.concatenate([take.evidence for take in takes])
    found = Judge(FitSettings()).judged(evidence, weights)
    is_hand = np.concatenate([take.is_hand for take in takes])
    error, expected = (
        np.concatenate([take.error_mm for take in takes])[is_hand],
        found.error_mm[is_hand],
    )
    sure, others = found.confidence[is_hand] >= SURE, found.confidence[~is_hand]
    off = f"{(error[sure] > OFF_MM).mean():.1%}" if sure.any() else ""
    correlation = f"{np.corrcoef(expected, error)[0, 1]:.2f}" if len(error) > 1 else ""
    means = f"{expected.mean():.1f}", f"{error.mean():.1f}"
    enough = TrackSettings().follow.enough
    of_others = str(len(others)), str((others >= enough).sum())
    return [name, str(len(error)), str(sure.sum()), off, correlation, *means, *of_others]


def compared(
    takes: Sequence[Poses], apart: Sequence[Poses], new: Regressions, keep: float
) -> Iterator[list[str]]:
    """Rows of each recording and of all."""
    in_use = read_weights()
    names = list(dict.fromkeys(take.name for take in takes))
    for name in names:
        own, others = (
            [take for take in takes if (take.name == name) == same] for same in (True, False)
        )
        yield cells_of(f"{name}, in use", own, in_use)
        if others:
            yield cells_of(f"{name}, left out", own, fitted(others, in_use, keep))
    for title, of in (("all fitted to", takes), ("all apart", apart)):
        if of:
            yield cells_of(f"{title}, in use", of, in_use)
            yield cells_of(f"{title}, new", of, new)


# ------------------------------------------------------------------------------------- command line


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    fitted_to = parser.add_mutually_exclusive_group(required=True)
    pair: dict[str, Any] = {
        "nargs": 2,
        "action": "append",
        "default": [],
        "metavar": ("SOURCE", "LABELS.npy"),
    }
    fitted_to.add_argument(
        "--recording", **pair, help="a recording and its labels; may be given several times"
    )
    fitted_to.add_argument(
        "--synthetic",
        choices=SCRIPTS,
        nargs="+",
        default=[],
        metavar="SCRIPT",
        help=f"instead, synthetic recordings, some of {', '.join(SCRIPTS)}",
    )
    parser.add_argument("--apart", **pair, help="a recording to which nothing is fitted, likewise")
    parser.add_argument(
        "--cameras",
        choices=CAMERAS,
        nargs="+",
        default=["nyu"],
        metavar="NAME",
        help=f"of these, some of {', '.join(CAMERAS)} (default: nyu)",
    )
    parser.add_argument(
        "--seconds", type=seconds, metavar="S", help="their duration (default: the script's)"
    )
    parser.add_argument(
        "--seed",
        type=seed,
        default=0,
        metavar="N",
        help="of fits and of synthetic recordings (default: 0)",
    )
    parser.add_argument(
        "--keep",
        type=real(0.0, 1e6),
        default=KEEP,
        metavar="W",
        help="how much weights are drawn towards those in use (default: %(default)s)",
    )
    parser.add_argument("--out", metavar="FILE", type=Path, help="file of weights to write")


def run(args: argparse.Namespace) -> int:
    """Track, fit, compare and write. Raises NetlibError."""
    if args.out:
        outputs.check_place(args.out, [labels for _, labels in (*args.recording, *args.apart)])
    own = [*map(_recorded, args.recording), *_synthetic(args)]
    apart = [*map(_recorded, args.apart)]
    with ProgressBar(2 * len(own + apart), "recordings", "tracking") as progress:
        takes, others = (_tracked(sources, args.seed, progress) for sources in (own, apart))
    new = fitted(takes, read_weights(), args.keep)
    print(aligned([HEAD, *compared(takes, others, new, args.keep)]))
    count = sum(len(take.error_mm) for take in takes)
    text = text_of(
        new,
        COMMENT.format(count=count, names=", ".join(source.name for source in own), **vars(args)),
    )
    if args.out:
        atomic.replace(args.out, lambda fresh: fresh.write_text(text, encoding="utf-8"))
        say(f"wrote {args.out}")
    else:
        print(text, end="")
    return DONE


def _recorded(pair: tuple[str, str]) -> Labelled:
    source, labels = pair
    return Labelled(Path(source).name, lambda: open_recording(source), labels_of(Path(labels)))


def _synthetic(args: argparse.Namespace) -> Iterator[Labelled]:
    for script in args.synthetic:
        for camera in args.cameras:
            make = functools.partial(
                SyntheticRecording, script, CAMERAS[camera], seconds=args.seconds, seed=args.seed
            )
            yield Labelled(f"synthetic {script} of {camera}", make, true_labels(make()))


def _tracked(sources: Sequence[Labelled], seed: int, progress: ProgressBar) -> list[Poses]:
    takes = []
    for source in sources:
        for mirrored in (False, True):
            with source.open() as recording:
                frames = tracked_labels(recording, source.labels, seed, mirrored, min_confidence=0)
                takes.append(poses_of(source.name, frames))
            progress(1)
    return takes
