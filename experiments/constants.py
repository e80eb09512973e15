"""The tuned numbers of fits and of the tracker: how many there are, and the errors on labelled
recordings with other values of some.

    python -m experiments constants
    python -m experiments constants --recording take joints.npy --recording other other.npy \\
        --seeds 0 1 2 3 4 --mirrored
    python -m experiments constants ... --set track.follow.kept=1 track.follow.new=1

Without recordings the numbers are listed: the fields of ``handpose.fit.settings`` and of
``handpose.tracking.settings``, those of tables one by one.

Labels are joints (frames, 5 fingers from the thumb on, MCP PIP DIP tip, 3) of a right hand in mm, x
right, y down, z away, NaN where there are none. The error is the mean over PIP, DIP and tip of all
fingers, absolute and unaligned, of the nearest hand with joints: mean, lowest and highest over the
seeds. "without" is the share of frames without joints, "side" that of the others with the right
side, "sure" that of poses with a confidence of 90% or more, "off" the share of these that are more
than 30 mm off. A rule stays if its gain is larger than the spread of the seeds.

What rules gain, as mean errors in mm over P1, P4 and hpx (docs/fit.md), as recorded and mirrored,
seeds 0 to 2: 13.19 with all. The means of other seeds differ by up to 0.3, so most rules have no
measurable gain on these sequences. The remarks on synthetic hands, jitter, sides and joint_starts
are measurements with earlier networks.

    switched off                          error   and
    track.follow.kept=0 .new=1 .max_jump_mm=1e9
                                          13.07   a synthetic hand, 15 frames/s: 3.9 to 5.1 mm,
                                                  found 96 to 89%
    fit.expected.unread=2 .hiding=2       13.10   wrong poses of covered hands
    fit.steady.cost_factor=1 .limb_precision=1
                                          13.16   jitter at rest 0.87 to 1.12 mm
    fit.search.step_factor=1 .momentum=0 .min_gain=0
                                          13.28   P1 lost in 2 to 4% of the frames; before 14.72
    fit.thin_px=1e9                       13.54   hpx 12.6 to 13.2 mm, P1 sure and wrong
    track.size.min_interval_s=0 .min_confidence=0
                                          13.00   as good; for hands that rest at first
    track.follow.first_credit=1 .sure=0.5 track.sides.clear=0
                                          13.34   P1 16.7 to 17.7 mm
    fit.judge.least_shown=0.01 .max_ratio=1e9 fit.support.self_mm=0
                                          12.86   hidden hands are sure; P1 lost in 3%
    fit.crops.max_move_mm=1e9 .from_middle_mm=1e9 fit.expected.leaving=1
                                          12.94   a wrong side in hpx
    track.start.beside=0 .both=0 .first=0 track.present.look=1 .still=1 .max_pause_s=0.2
                                          13.15   one hand only; for scenes
    handpose/fit/joint_starts.py          +0.38   hpx mirrored 12.6 to 14.0 mm, a wrong
                                                  side in 20% of P7
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from experiments.tables import mean, tabulated
from handpose import Recording, Tracker, load_tracker, open_recording
from handpose.fit.settings import FitSettings
from handpose.frames.images import errors_of
from handpose.tracking.settings import TrackSettings
from handpose.tracking.track import TrackedHand
from netlib.blob import Array
from netlib.errors import DataError, did_you_mean
from tools.common.arguments import seed
from tools.common.console import say
from tools.common.progress import ProgressBar

SURE = 0.9  # minimum confidence of a sure pose
OFF_MM = 30.0  # minimum error of a pose that is off
LABELS_SHAPE = (5, 4, 3)  # of a frame: fingers, joints, coordinates


@dataclasses.dataclass(frozen=True)
class Settings:
    """All tuned numbers."""

    fit: FitSettings = FitSettings()
    track: TrackSettings = TrackSettings()


class Seen(NamedTuple):
    """A labelled frame with a pose: its error in mm, its confidence, and whether its
    side is right.
    """

    error_mm: float
    confidence: float
    is_right_side: bool


def numbers_of(settings: Any, name: str = "") -> dict[str, float]:
    """The numbers in settings by their names; an entry of a table is named by its index."""
    if isinstance(settings, (int, float)):
        return {name: settings}
    found: dict[str, float] = {}
    for key, part in parts_of(settings).items():
        found |= numbers_of(part, f"{name}.{key}" if name else key)
    return found


def parts_of(settings: object) -> dict[str, Any]:
    """The fields of a group, or the entries of a table, by their names; empty for all else."""
    if dataclasses.is_dataclass(settings):
        return vars(settings)
    if isinstance(settings, tuple):
        names = getattr(settings, "_fields", map(str, range(len(settings))))
        return dict(zip(names, settings))
    return {}


def changed(settings: Any, name: str, value: float) -> Any:
    """The settings with another value of one of their numbers."""
    first, _, rest = name.partition(".")
    parts = dict(parts_of(settings))
    parts[first] = changed(parts[first], rest, value) if rest else value
    if dataclasses.is_dataclass(settings):
        return dataclasses.replace(settings, **parts)  # type: ignore[type-var]
    return settings._make(parts.values()) if hasattr(settings, "_make") else (*parts.values(),)


def settings_of(texts: Sequence[str]) -> Settings:
    """The settings with every NAME=VALUE. Raises DataError."""
    settings = Settings()
    known = numbers_of(settings)
    for text in texts:
        name, _, value = text.partition("=")
        if name not in known:
            raise DataError(
                f"--set {text}: no such number{did_you_mean(name, known)}; python -m experiments "
                "constants lists them"
            )
        try:
            number = type(known[name])(value)
        except ValueError:
            kind = "whole number" if isinstance(known[name], int) else "number"
            raise DataError(f"--set {text}: {value!r} is no {kind}") from None
        settings = changed(settings, name, number)
    return settings


def joints_in(path: Path) -> Array:
    """The array (frames, ..., 3) in mm of a file of labels. Raises DataError."""
    damaged = "not an array of numbers, expected an .npy of joints (frames, ..., 3)"
    with errors_of(str(path), "the labels", damaged):
        values = np.asarray(np.load(path, allow_pickle=False))
    if values.ndim < 2 or values.shape[-1] != 3 or values.dtype.kind != "f":
        raise DataError(
            f"{path}: {values.dtype} {values.shape}, expected joints (frames, ..., 3) in mm"
        )
    return values


def labels_of(path: Path) -> Array:
    """The labels (frames, 5, 3, 3) of PIP, DIP and tip, y up. Raises DataError."""
    values = joints_in(path)
    if values.shape[1:] != LABELS_SHAPE:
        raise DataError(f"{path}: {values.shape}, expected joints (frames, 5, 4, 3) in mm")
    return values[:, :, 1:] * (1, -1, 1)


class TrackedLabels(NamedTuple):
    """A labelled frame after the tracker has seen it, and how far its hands are from the labels.

    tracker    that has seen this frame last
    depth      (height, width) mm, the frame
    label      (5, 3, 3) mm, PIP, DIP and tip of each finger, y up
    hands      that the tracker reports
    errors_mm  of each of these: (5, 3), distances of PIP, DIP and tip of each finger from the
               labels
    """

    tracker: Tracker
    depth: NDArray[np.float32]
    label: Array
    hands: Sequence[TrackedHand]
    errors_mm: Sequence[Array]


def tracked_labels(
    recording: Recording,
    labels: Array,
    seed: int,
    mirrored: bool,
    settings: Settings = Settings(),
    **options: Any,
) -> Iterator[TrackedLabels]:
    """Track a recording, or its mirror image; yields its labelled frames.

    Raises DataError, NetlibError.

    labels   (frames, 5, 3, 3) of PIP, DIP and tip, y up
    options  of the tracker
    """
    camera, flip = recording.camera, 1
    if mirrored:
        camera, flip = camera.mirrored(), -1
    tracker = load_tracker(
        camera, seed=seed, fit_settings=settings.fit, settings=settings.track, **options
    )
    fingers = tracker.model.fingers
    assert fingers is not None  # the packaged body is a hand
    for frame, label in itertools.zip_longest(recording, labels):
        if frame is None or label is None:
            raise DataError(f"{recording.name}: expected as many frames as labels, {len(labels)}")
        frame, label = frame._replace(depth=frame.depth[:, ::flip]), label * (flip, 1, 1)
        hands = tracker.step(frame).hands
        if not np.isnan(label).any():
            joints = [fingers.joints(hand.xyz[None])[0] for hand in hands]
            errors_mm = [np.linalg.norm(xyz - label, axis=-1) for xyz in joints]
            yield TrackedLabels(tracker, frame.depth, label, hands, errors_mm)


def followed(
    source: str, labels: Array, seed: int, mirrored: bool, settings: Settings
) -> Iterator[Seen | None]:
    """Track a recording; for every labelled frame its nearest hand, None without one.

    Raises NetlibError.
    """
    side = "left" if mirrored else "right"
    with open_recording(source) as recording:
        for frame in tracked_labels(recording, labels, seed, mirrored, settings):
            poses = [
                Seen(float(error_mm.mean()), hand.confidence, hand.hand == side)
                for error_mm, hand in zip(frame.errors_mm, frame.hands)
            ]
            yield min(poses, key=lambda pose: pose.error_mm, default=None)


def cells_of(runs: list[list[Seen | None]]) -> dict[str, str]:
    """The columns of a recording, of a run for each seed."""
    means = [np.mean([pose.error_mm for pose in run if pose] or [np.nan]) for run in runs]
    frames = [pose for run in runs for pose in run]
    seen = [pose for pose in frames if pose]
    sure = [pose for pose in seen if pose.confidence >= SURE]
    return {
        "mm": f"{np.mean(means):.2f}",
        "lowest": f"{min(means):.2f}",
        "highest": f"{max(means):.2f}",
        "without": mean("{:.1%}", [pose is None for pose in frames]),
        "side": mean("{:.1%}", [pose.is_right_side for pose in seen]),
        "sure": mean("{:.1%}", [pose.confidence >= SURE for pose in seen]),
        "off": mean("{:.1%}", [pose.error_mm > OFF_MM for pose in sure]),
    }


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "--recording",
        nargs=2,
        action="append",
        default=[],
        metavar=("SOURCE", "LABELS.npy"),
        help="a recording and its labels; may be given several times",
    )
    parser.add_argument(
        "--seeds",
        type=seed,
        nargs="+",
        default=[0],
        metavar="N",
        help="of random starts (default: 0)",
    )
    parser.add_argument(
        "--mirrored", action="store_true", help="also each recording's mirror image, of a left hand"
    )
    parser.add_argument(
        "--set", nargs="+", default=[], metavar="NAME=VALUE", help="other values of numbers"
    )


def run(args: argparse.Namespace) -> None:
    """List the numbers, or measure. Raises NetlibError."""
    settings = settings_of(args.set)
    if not args.recording:
        _list(numbers_of(settings))
        return
    takes = [
        (source, labels_of(Path(path)), mirrored)
        for source, path in args.recording
        for mirrored in ((False, True) if args.mirrored else (False,))
    ]
    rows = []
    with ProgressBar(len(takes) * len(args.seeds), what="tracking") as progress:
        for source, labels, mirrored in takes:
            runs = []
            for number in args.seeds:
                runs.append(list(followed(source, labels, number, mirrored, settings)))
                progress(1)
            name = Path(source).name + " mirrored" * mirrored
            rows.append({"recording": name, **cells_of(runs)})
    print(tabulated(rows))


def _list(numbers: dict[str, float]) -> None:
    """Print a line for each group of numbers."""
    groups: dict[str, list[str]] = {}
    for name, number in numbers.items():
        group, _, field = name.rpartition(".")
        groups.setdefault(group, []).append(f"{field}={number:g}")
    for group, values in groups.items():
        print(f"{group:34}{len(values):3}  {' '.join(values)}")
    say(f"{len(numbers)} tuned numbers")
