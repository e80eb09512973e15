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
the two most certain places of the finder, is as wrong as a lost hand and has half the weight. In
copies of some labelled frames, a part of the hand is cut off, covered, or not read ("hidden").
The packaged network and its fit must be those for which the confidence is computed. --scenes adds
hands in rendered scenes, as `experiments scenes` finds and fits them.

A row has the labelled hands, those with a confidence of 90% or more, the share of these that is
more than 30 mm off, the correlation of expected and true error, both in mm; then the other poses,
and those of 30% or more, which would have joints. Rows are for the weights in use, for the new
ones, and for those fitted without the recording. No weight is fitted to the recordings --apart.
"""

from __future__ import annotations

import argparse
import functools
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from experiments.confidence_poses import (
    Poses,
    Source,
    gathered,
    hidden_poses,
    scene_poses,
    tracked_poses,
    true_labels,
)
from experiments.constants import OFF_MM, SURE, labels_of, tracked_labels
from experiments.tables import mean, tabulated
from handpose import CAMERAS, open_recording
from handpose.fit.pose_confidence import (
    FINGER_SIGNS,
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
from handpose.sequences.recordings import SCRIPTS, SyntheticRecording
from handpose.tracking.settings import TrackSettings
from netlib.blob import Array
from netlib.files import atomic
from tools.common import outputs
from tools.common.arguments import count, real, seconds, seed
from tools.common.console import say
from tools.common.progress import ProgressBar

SCENE_SEEDS = (9000, 9001)  # of rendered scenes
KEEP = 0.3  # of 0, 0.3, 1, 3 and 10; up to 1 they are alike when a recording is left out
COMMENT = """Weights of the confidence of poses: handpose/fit/pose_confidence.py has the formulas.
Fitted by `python -m experiments confidence` to {count} poses of {names},
each as it is and mirrored; --seed {seed} --keep {keep:g}."""


# -------------------------------------------------------------------------------------- regressions


def fitted(takes: Sequence[Poses], in_use: Regressions, keep: float = KEEP) -> Regressions:
    """The weights that explain the errors of recordings; ``keep`` is the weight of the squared
    change of a weight.
    """
    evidence = Evidence.concatenate([take.evidence for take in takes])
    share = np.concatenate([take.share for take in takes])
    error_mm = np.concatenate([take.error_mm for take in takes])

    def hand_mean(regression: Regression) -> Array:
        return mean_log_error(evidence.signs, evidence.lag_mm, regression)

    hand = _regression(hand_mean, np.log(error_mm), share, in_use.hand, keep)
    fingers_mm = np.concatenate([take.fingers_mm for take in takes])
    known = np.isfinite(fingers_mm)
    expected = Judge(FitSettings()).as_wholes(evidence, hand)[0]
    signs = finger_signs(expected, evidence)[known]

    def finger_mean(regression: Regression) -> Array:
        return np.asarray(signs @ regression.weights + regression.constant)

    share = np.repeat(share[:, None], known.shape[1], axis=1)[known]
    share = share / share.sum() * len(takes)
    finger = _regression(finger_mean, np.log(fingers_mm[known]), share, in_use.finger, keep)
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

    def weighted_errors(x: Array) -> Array:
        error = mean(Regression(x[:-1], x[-1], np.nan)) - log_error
        return np.asarray(error * np.sqrt(share))

    def residuals(x: Array) -> Array:
        return np.append(weighted_errors(x), keep * (x[:-1] - in_use.weights))

    start = np.append(in_use.weights, in_use.constant)
    lower = np.append(np.zeros(len(in_use.weights)), -np.inf)
    x = least_squares(residuals, start, bounds=(lower, np.inf)).x
    spread = np.sqrt((weighted_errors(x) ** 2).sum() / share.sum())
    return Regression(x[:-1], float(x[-1]), float(spread))


# -------------------------------------------------------------------------------------- the results


def text_of(weights: Regressions, comment: str) -> str:
    """The text of a file of weights, with a comment at the top."""
    lines = [f"# {line}" for line in comment.splitlines()]
    for name, signs, regression in zip(("hand", "finger"), (SIGNS, FINGER_SIGNS), weights):
        values = (*regression.weights, regression.constant, regression.spread)
        fields = zip((*signs, "constant", "spread"), values)
        lines += [f"{name} {{", *(f"  {field}: {value:.3f}" for field, value in fields), "}"]
    return "\n".join(lines) + "\n"


def cells_of(name: str, takes: Sequence[Poses], weights: Regressions) -> dict[str, str]:
    """The columns of recordings, judged by these weights."""
    evidence = Evidence.concatenate([take.evidence for take in takes])
    judged = Judge(FitSettings()).judged(evidence, weights)
    is_hand = np.concatenate([take.is_hand for take in takes])
    true = np.concatenate([take.error_mm for take in takes])[is_hand]
    expected = judged.error_mm[is_hand]
    correlation = f"{np.corrcoef(expected, true)[0, 1]:.2f}" if len(true) > 1 else ""
    sure = judged.confidence[is_hand] >= SURE
    others = judged.confidence[~is_hand]
    with_joints = others >= TrackSettings().follow.enough
    return {
        "recording": name,
        "hands": str(len(true)),
        "sure": str(sure.sum()),
        "off": mean("{:.1%}", true[sure] > OFF_MM),
        "correlation": correlation,
        "expected": f"{expected.mean():.1f}",
        "true": f"{true.mean():.1f}",
        "others": str(len(others)),
        "with joints": str(with_joints.sum()),
    }


def compared(
    takes: Sequence[Poses], apart: Sequence[Poses], new: Regressions, keep: float
) -> Iterator[dict[str, str]]:
    """Rows of each recording and of all."""
    in_use = read_weights()
    names = list(dict.fromkeys(take.name for take in takes))
    for name in names:
        own = [take for take in takes if take.name == name]
        others = [take for take in takes if take.name != name]
        yield cells_of(f"{name}, in use", own, in_use)
        if others:
            yield cells_of(f"{name}, left out", own, fitted(others, in_use, keep))
    for title, group in (("all fitted to", takes), ("all apart", apart)):
        if group:
            yield cells_of(f"{title}, in use", group, in_use)
            yield cells_of(f"{title}, new", group, new)


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
    parser.add_argument(
        "--scenes",
        type=count,
        metavar="N",
        help="also hands in N rendered scenes for each of two seeds",
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


def run(args: argparse.Namespace) -> None:
    """Track, fit, compare and write. Raises NetlibError."""
    if args.out:
        outputs.check_place(args.out, [labels for _, labels in (*args.recording, *args.apart)])
    recorded, apart = ([*map(_recorded, pairs)] for pairs in (args.recording, args.apart))
    own = [*recorded, *_synthetic(args)]
    with ProgressBar(2 * len(own + apart), "recordings", "tracking") as progress:
        takes, others = (_tracked(sources, args.seed, progress) for sources in (own, apart))
    takes += _hidden(recorded, args.seed)
    others += _hidden(apart, args.seed)
    if args.scenes:
        takes += [gathered("scenes", scene_poses(args.scenes, n)) for n in SCENE_SEEDS]
    new = fitted(takes, read_weights(), args.keep)
    print(tabulated([*compared(takes, others, new, args.keep)]))
    count = sum(len(take.error_mm) for take in takes)
    names = ", ".join(dict.fromkeys(take.name for take in takes))
    text = text_of(new, COMMENT.format(count=count, names=names, **vars(args)))
    if args.out:
        atomic.replace_text(args.out, text)
        say(f"wrote {args.out}")
    else:
        print(text, end="")


def _recorded(pair: tuple[str, str]) -> Source:
    source, labels = pair
    return Source(Path(source).name, lambda: open_recording(source), labels_of(Path(labels)))


def _synthetic(args: argparse.Namespace) -> Iterator[Source]:
    for script in args.synthetic:
        for camera in args.cameras:
            make = functools.partial(
                SyntheticRecording, script, CAMERAS[camera], seconds=args.seconds, seed=args.seed
            )
            yield Source(f"synthetic {script} of {camera}", make, true_labels(make()))


def _hidden(sources: Sequence[Source], seed: int) -> list[Poses]:
    return [gathered(f"{source.name} hidden", hidden_poses(source, seed)) for source in sources]


def _tracked(sources: Sequence[Source], seed: int, progress: ProgressBar) -> list[Poses]:
    takes = []
    for source in sources:
        for mirrored in (False, True):
            with source.open() as recording:
                frames = tracked_labels(recording, source.labels, seed, mirrored, min_confidence=0)
                takes.append(gathered(source.name, tracked_poses(frames)))
            progress(1)
    return takes
