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
import contextlib
import functools
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from experiments.constants import OFF_MM, SURE, TrackedLabels, labels_of, tracked_labels
from experiments.hidden_parts import Shown, hidden_parts
from experiments.scenes import FINER, hands_in, predictors
from experiments.tables import mean, tabulated
from handpose import CAMERAS, open_recording
from handpose.body.model import FINGERS, Fingers, Surface
from handpose.body.sides import SideView
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
from handpose.synthetic.whole_scenes import SceneGenerator
from handpose.tracking.hand_track import HandTrack
from handpose.tracking.output import variables_of
from handpose.tracking.settings import TrackSettings
from netlib.blob import Array
from netlib.errors import DataError
from netlib.files import atomic
from tools.common import outputs
from tools.common.arguments import count, real, seconds, seed
from tools.common.console import say
from tools.common.progress import ProgressBar

# Weight of a pose that is not the labelled hand. With 1, 0.5 and 0.25, 58, 73 and 80% of the hands
# in P1, P4 and hpx have 90% or more; of the others 10, 16 and 21% have 30% or more, 0.2, 0.9
# and 2.0% the 60% that a second hand needs.
OTHER_WEIGHT = 0.5
MAX_PLACES = 2  # of the finder in a frame: the hand, and another one
SCENE_SEEDS = (9000, 9001)  # of rendered scenes
HIDDEN_FRAMES = 48  # labelled frames of a recording that are copied with hidden parts
KEEP = 0.3  # of 0, 0.3, 1, 3 and 10; up to 1 they are alike when a recording is left out
COMMENT = """Weights of the confidence of poses: handpose/fit/pose_confidence.py has the formulas.
Fitted by `python -m experiments confidence` to {count} poses of {names},
each as it is and mirrored; --seed {seed} --keep {keep:g}."""
NO_HAND = np.full(len(FINGERS), np.nan)  # errors of the fingers of a pose that is no labelled hand

# What an image shows of a pose, and the errors (5,) in mm of its fingers
Pose = tuple[Evidence, Array]


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
        weight = np.where(self.is_hand, 1.0, OTHER_WEIGHT)
        return np.asarray(weight / weight.sum())

    @property
    def is_hand(self) -> NDArray[np.bool_]:
        """True (N,) for the labelled hand."""
        return np.isfinite(self.fingers_mm[:, 0])


class Source(NamedTuple):
    """A recording, and its labels (frames, 5, 3, 3): PIP, DIP and tip of each finger, y up;
    NaN without any.
    """

    name: str
    open: Callable[[], Recording]
    labels: Array


# ------------------------------------------------------------------------------------ tracked poses


def gathered(name: str, poses: Iterable[Pose]) -> Poses:
    """Some poses together. Raises DataError if none is that of a labelled hand."""
    evidence, errors = [], []
    for one, fingers_mm in poses:
        evidence.append(one)
        errors.append(fingers_mm)
    if np.isnan(errors).all():
        raise DataError(f"{name}: no labelled hand is found in any frame")
    fingers_mm = np.array(errors)
    error_mm = np.nan_to_num(fingers_mm.mean(axis=1), nan=LOST_MM)
    return Poses(name, Evidence.concatenate(evidence), error_mm, fingers_mm)


def tracked_poses(frames: Iterator[TrackedLabels]) -> Iterator[Pose]:
    """The poses that are tracked in labelled frames, and those at other places of the finder."""
    for frame in frames:
        least = min((error_mm.mean() for error_mm in frame.errors_mm), default=np.inf)
        for hand, error_mm in zip(frame.hands, frame.errors_mm):
            is_labelled = error_mm.mean() == least < LOST_MM
            evidence = evidence_of_track(frame.tracker.track_of(hand), frame.tracker.model)
            yield evidence, error_mm.mean(axis=1) if is_labelled else NO_HAND
        for evidence in evidence_of_others(frame):
            yield evidence, NO_HAND


def evidence_of_others(frame: TrackedLabels) -> Iterator[Evidence]:
    """What an image shows of poses at the finder's places away from the only hand."""
    predictor, middle = frame.tracker.predictor, frame.label.mean(axis=(0, 1))
    view = SideView("right", predictor.camera, frame.depth, frame.depth)
    for found in frame.tracker.finder.hands(frame.depth, predictor.camera, most=MAX_PLACES):
        with contextlib.suppress(DataError):  # the pose leads out of the image
            hand = predictor.at_found(view, found)
            distances_mm = np.linalg.norm([found.middle - middle, hand.center_mm - middle], axis=1)
            if distances_mm.min() > LOST_MM:
                assert hand.evidence is not None
                yield hand.evidence


def hidden_poses(source: Source, number: int) -> Iterator[Pose]:
    """The poses of a right hand with a hidden part, at its true place, in some labelled frames."""
    rng = np.random.default_rng(number)
    labelled = np.flatnonzero(np.isfinite(source.labels).all(axis=(1, 2, 3)))
    chosen = {*labelled[:: max(len(labelled) // HIDDEN_FRAMES, 1)].tolist()}
    predictor_of = predictors("accurate", hand="right")
    with source.open() as recording:
        for frame in recording:
            if frame.number not in chosen:
                continue
            label = source.labels[frame.number]
            joints = label.reshape(-1, 3)
            for shown in hidden_parts(rng, Shown(frame.depth, recording.camera), joints):
                predictor = predictor_of(shown.camera)
                with contextlib.suppress(DataError):  # the pose leads out of the image
                    place = shown.camera.project(joints.mean(axis=0))
                    found = predictor.in_frame(shown.depth, place)
                    fingers = found.the_model.fingers
                    assert found.evidence is not None
                    assert fingers is not None  # the packaged body is a hand
                    yield found.evidence, finger_errors(fingers.joints(found.xyz[None])[0], label)


def scene_poses(scenes: int, number: int) -> Iterator[Pose]:
    """The poses of hands in rendered scenes (``experiments.scenes``), and of what the finder
    takes for one.
    """
    generator = SceneGenerator(number, "test", finer=FINER)
    fingers = Fingers(generator.sampler.surface)
    for scene in hands_in(generator, scenes, predictors("accurate")):
        for hand in scene.hands:
            if hand.estimate and hand.estimate.evidence:
                own, true = fingers.joints(np.stack([hand.estimate.xyz, hand.joints]))
                yield hand.estimate.evidence, finger_errors(own, true)
        for other in scene.false:
            if other.evidence:
                yield other.evidence, NO_HAND


def finger_errors(own: Array, true: Array) -> Array:
    """The mean errors (5,) of joints (5, 3, 3) in mm, at most LOST_MM."""
    return np.minimum(np.linalg.norm(own - true, axis=-1).mean(axis=1), LOST_MM)


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
    sure = judged.confidence[is_hand] >= SURE
    others = judged.confidence[~is_hand]
    return {
        "recording": name,
        "hands": str(len(true)),
        "sure": str(sure.sum()),
        "off": mean("{:.1%}", true[sure] > OFF_MM),
        "correlation": f"{np.corrcoef(expected, true)[0, 1]:.2f}" if len(true) > 1 else "",
        "expected": f"{expected.mean():.1f}",
        "true": f"{true.mean():.1f}",
        "others": str(len(others)),
        "with joints": str((others >= TrackSettings().follow.enough).sum()),
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
