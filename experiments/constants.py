"""The tracker's tuned numbers: how many there are, and the errors on labelled recordings with other
values of some.

    python -m experiments constants
    python -m experiments constants --recording take joints.npy --recording other other.npy \\
        --seeds 0 1 2 3 4 --mirrored
    python -m experiments constants ... --set tracking.hand_track.KEPT=1 tracking.hand_track.NEW=1

Without recordings the tuned numbers that modules of handpose/fit, handpose/tracking and
handpose/estimate name are listed.

Labels are joints (frames, 5 fingers from the thumb on, MCP PIP DIP tip, 3) of a right hand in mm, x
right, y down, z away, NaN where there are none. The error is the mean over PIP, DIP and tip of all
fingers, absolute and unaligned, of the nearest hand with joints: mean, lowest and highest over the
seeds. "without" is the share of frames without joints, "side" that of the others with the right
side, "sure" that of poses with a confidence of 90% or more, "off" the share of these that are more
than 30 mm off. A rule stays if its gain is larger than the spread of the seeds.

What rules gain, as mean errors in mm over P1, P4 and hpx (docs/fit.md), as recorded and mirrored,
seeds 0 to 2: 13.38 with all. The means of other seeds differ by up to 0.3.

    switched off                          error   and
    KEPT=0 NEW=1 MAX_JUMP_MM=1e9          13.19   a synthetic hand, 15 frames/s: 3.9 to 5.1 mm,
                                                  found 96 to 89%
    UNREAD=2 HIDING=2                     13.70   wrong poses of covered hands
    STAY=1 HOLD=1                         13.43   jitter at rest 0.87 to 1.12 mm
    FURTHER=1 MOMENTUM=0 MIN_GAIN=0       14.72
    THIN_PX=1e9                           13.57   hpx mirrored 12.7 to 13.8 mm
    EVERY=0 CONFIDENT=0                   13.30   as good; for hands that rest at first
    FIRST_CREDIT=1 SURE=0.5 CLEAR=0       13.52   P1 up to 19.7 mm
    COVERED=0 MAX_RATIO=1e9 SELF_MM=0     13.52   covered hands are sure
    MAX_MOVE_MM=1e9 NEAREST_MM=0 LEAVING=1
                                          13.47   a wrong side in hpx
    BESIDE=0 ENOUGH_BOTH=0 ENOUGH_FIRST=0 LOOK=1 STILL=1 MAX_PAUSE=0.2
                                          13.32   one hand only; for scenes
    fit/joint_starts.py                   +0.38   hpx mirrored 12.6 to 14.0 mm, a wrong
                                                  side in 20% of P7
"""

from __future__ import annotations

import argparse
import ast
import dataclasses
import dis
import importlib
import io
import itertools
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import CodeType, ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from netlib import files
from netlib.blob import Array
from netlib.errors import DataError
from netlib.files.paths import ROOT
from tools.common.arguments import seed
from tools.common.console import DONE, aligned, say
from tools.common.progress import ProgressBar

if TYPE_CHECKING:
    from handpose.frames.recording import Recording
    from handpose.tracking.track import TrackedHand
    from handpose.tracking.tracker import Tracker

ROOMS = ("fit", "tracking", "estimate")
# Numbers that are not tuned: indices, units, and what a measure or a format is by
# definition; bounds of rounding and of convergence; sizes of blocks, and limits of what is
# held, tried or accepted.
NOT_TUNED = {
    module: names.split()
    for module, names in {
        "fit.body": "SIZE_INDEX THICKNESS_INDEX",
        "fit.depth_fit": "EMPTY_CROP STARTS_TOGETHER",
        "fit.joint_starts": "START_RIDGE",
        "fit.joints.companions": "ANGLES_VERSION",
        "fit.joints.fit_joints": "CHUNK GRID_STEP MAX_ITERATIONS COST_TOLERANCE EXACT MIN_MU DEFAULT_RIDGE",
        "fit.joints.particle_swarm": "CONSTRICTION ATTRACTION",
        "fit.objective": "MIN_SIZE_STD",
        "fit.observation": "_CROSS",
        "fit.pose_confidence": "GOOD_MM LOST_MM MAX_SIGN",
        "fit.residuals": "_TINY POSITION_BITS DIRECTION_STEP _UPPER _DIAGONAL _FULL",
        "fit.rounding": "NETWORK_STEP PLACE_STEP_MM FIT_STEP",
        "fit.search": "MAX_MU EXACT_COST LOW_MU HIGH_MU DESCENT_RIDGE",
        "fit.support": "ALONG ACROSS",
        "tracking.hand_track": "MOST_FOUND MAX_SIDE_CONFIDENCE",
        "tracking.later_frames": "MAX_UNDECIDED LOOKAHEAD_FRAMES",
        "tracking.sizing": "POPULATION",
        "tracking.smoothing": "NO_SPEED",
        "tracking.summary": "LENGTH_MM",
        "tracking.tracker": "MAX_HANDS AGAIN ARM_PLACES",
        "estimate.crop_fits": "MAX_CROPS",
        "estimate.finder": "FOCAL_PX VOTE_MM BEYOND_MM MIDDLE_MM STRIDE MAX_PIXELS CHANCE_STEP MIN_VOTES OUTPUTS",
        "estimate.nets": "SIZES",
        "estimate.predictor": "CROP_DEPTH_MM MOST MAX_REFINE",
    }.items()
}
SURE, OFF_MM = 0.9, 30.0


class Seen(NamedTuple):
    """A labelled frame with a pose: its error in mm, its confidence, and whether its
    side is right.
    """

    error_mm: float
    confidence: float
    is_right_side: bool


def numbers_of(path: Path) -> list[str]:
    """The names of the constants with numbers in a module: in capitals, of literals alone."""
    names = []
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if not isinstance(node, ast.Assign) or not any(
            _is_number(part) for part in ast.walk(node.value)
        ):
            continue
        for target in node.targets:
            parts = target.elts if isinstance(target, ast.Tuple) else [target]
            names += [part.id for part in parts if isinstance(part, ast.Name) and part.id.isupper()]
    return names


def _is_number(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and type(node.value) in (int, float)


def constants() -> dict[str, list[str]]:
    """The constants of every module that has some, by its name after ``handpose.``."""
    found = {}
    for room in ROOMS:
        for path in sorted((ROOT / "handpose" / room).rglob("*.py")):
            if names := numbers_of(path):
                found[".".join(path.relative_to(ROOT / "handpose").with_suffix("").parts)] = names
    return found


def tuned() -> dict[str, list[str]]:
    """Those of ``constants`` that were chosen by their effect."""
    every = {
        module: [name for name in names if name not in NOT_TUNED.get(module, ())]
        for module, names in constants().items()
    }
    return {module: names for module, names in every.items() if names}


def set_constants(texts: Sequence[str]) -> None:
    """Set every MODULE.NAME=VALUE before other modules import it. Raises DataError."""
    if "handpose.tracking.tracker" in sys.modules:
        raise DataError("--set: the tracker is already loaded, with the old values")
    for text in texts:
        name, _, value = text.partition("=")
        module, _, constant = name.rpartition(".")
        if constant not in constants().get(module, ()):
            raise DataError(
                f"--set {text}: no such constant; python -m experiments constants lists them"
            )
        try:
            number = float(value)
        except ValueError:
            raise DataError(f"--set {text}: {value!r} is no number") from None
        owner = importlib.import_module(f"handpose.{module}")
        if not isinstance(vars(owner)[constant], (int, float)):
            raise DataError(f"--set {text}: its value is more than a number; edit {owner.__file__}")
        for loaded in [owner, *_importers(owner.__name__, constant)]:
            used = [step.argval for step in _steps(_code_of(loaded)) if step.opname == "LOAD_NAME"]
            if constant in used:
                raise DataError(
                    f"--set {text}: {loaded.__file__} has used its value on import; edit it there"
                )
            setattr(loaded, constant, number)


def _importers(owner: str, constant: str) -> list[ModuleType]:
    """The loaded modules that import a constant from its module."""
    found = []
    for module in [loaded for name, loaded in sys.modules.items() if name.startswith("handpose.")]:
        source = ""
        for step in _steps(_code_of(module)):
            source = step.argval if step.opname == "IMPORT_NAME" else source
            if step.opname == "IMPORT_FROM" and (source, step.argval) == (owner, constant):
                found.append(module)
    return found


def _code_of(module: ModuleType) -> CodeType:
    """What Python runs to import a module: in it and in its classes, but not in functions, names
    are LOAD_NAME.
    """
    return compile(
        files.read_text(str(module.__file__), "the module"), str(module.__file__), "exec"
    )


def _steps(code: CodeType) -> Iterator[dis.Instruction]:
    yield from dis.get_instructions(code)
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield from _steps(inner)


def array_in(path: Path) -> object:
    """What a file of labels contains, mostly an array. Raises DataError."""
    try:
        return np.load(
            io.BytesIO(files.read_bytes(path, "the labels", DataError)), allow_pickle=False
        )
    except ValueError:
        raise DataError(
            f"{path}: not an array of numbers, expected an .npy of joints (frames, ..., 3)"
        ) from None


def labels_of(path: Path) -> Array:
    """The labels (frames, 5, 3, 3) of PIP, DIP and tip, y up. Raises DataError."""
    values = array_in(path)
    if (
        not isinstance(values, np.ndarray)
        or values.shape[1:] != (5, 4, 3)
        or values.dtype.kind != "f"
    ):
        raise DataError(f"{path}: expected an .npy of joints (frames, 5, 4, 3) in mm")
    return np.asarray(values[:, :, 1:] * (1, -1, 1))


class TrackedLabels(NamedTuple):
    """A labelled frame after the tracker has seen it, and how far its hands are from the labels.

    tracker  that has seen this frame last
    depth    (height, width) mm, the frame
    label    (5, 3, 3) mm, PIP, DIP and tip of each finger, y up
    hands    that the tracker reports
    apart    of each of these: mm (5, 3), distances of PIP, DIP and tip of each finger
             from the labels
    """

    tracker: Tracker
    depth: NDArray[np.float32]
    label: Array
    hands: Sequence[TrackedHand]
    apart: Sequence[Array]


def tracked_labels(
    recording: Recording, labels: Array, seed: int, mirrored: bool, **options: Any
) -> Iterator[TrackedLabels]:
    """Track a recording, or its mirror image; yields its labelled frames.

    Raises DataError, NetlibError.

    labels   (frames, 5, 3, 3) of PIP, DIP and tip, y up
    options  of the tracker
    """
    from handpose.tracking.tracker import load_tracker  # imported here, after constants are set

    camera, flip = recording.camera, -1 if mirrored else 1
    if mirrored:
        camera = dataclasses.replace(camera, u0=camera.width - 1 - camera.u0)
    tracker = load_tracker(camera, seed=seed, **options)
    fingers = tracker.model.fingers
    assert fingers is not None  # the packaged body is a hand
    for frame, label in itertools.zip_longest(recording, labels):
        if frame is None or label is None:
            raise DataError(f"{recording.name}: expected as many frames as labels, {len(labels)}")
        frame, label = frame._replace(depth=frame.depth[:, ::flip]), label * (flip, 1, 1)
        hands = tracker.step(frame).hands
        if not np.isnan(label).any():
            off = [fingers.joints(hand.xyz[None])[0] - label for hand in hands]
            apart = [np.linalg.norm(one, axis=-1) for one in off]
            yield TrackedLabels(tracker, frame.depth, label, hands, apart)


def followed(source: str, labels: Array, seed: int, mirrored: bool) -> Iterator[Seen | None]:
    """Track a recording; for every labelled frame its nearest hand, None without one.

    Raises NetlibError.
    """
    from handpose.frames.formats import open_recording  # imported here, after constants are set

    with open_recording(source) as recording:
        for found in tracked_labels(recording, labels, seed, mirrored):
            near = [(float(apart.mean()), hand) for apart, hand in zip(found.apart, found.hands)]
            error, hand = min(near, key=lambda one: one[0], default=(np.nan, None))
            yield (
                Seen(error, hand.confidence, hand.hand == ("left" if mirrored else "right"))
                if hand
                else None
            )


def cells_of(runs: list[list[Seen | None]]) -> list[str]:
    """The columns of a recording, of a run for each seed."""
    means = [np.mean([one.error_mm for one in run if one] or [np.nan]) for run in runs]
    every = [one for run in runs for one in run]
    seen = [one for one in every if one]
    sure = [one for one in seen if one.confidence >= SURE]

    def share(part: int, whole: int) -> str:
        return f"{part / whole:.1%}" if whole else ""

    return [
        f"{np.mean(means):.2f}",
        f"{min(means):.2f}",
        f"{max(means):.2f}",
        share(len(every) - len(seen), len(every)),
        share(sum(one.is_right_side for one in seen), len(seen)),
        share(len(sure), len(seen)),
        share(sum(one.error_mm > OFF_MM for one in sure), len(sure)),
    ]


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
        "--set",
        nargs="+",
        default=[],
        metavar="MODULE.NAME=VALUE",
        help="other values of constants",
    )


def run(args: argparse.Namespace) -> int:
    """List the constants, or measure. Raises NetlibError."""
    if not args.recording:
        found = tuned()
        for module, names in found.items():
            print(f"{module:26}{len(names):3}  {', '.join(names)}")
        say(f"{sum(map(len, found.values()))} tuned numbers in {len(found)} modules")
        return DONE
    if args.set:
        set_constants(args.set)
    takes = [
        (source, labels_of(Path(path)), flip)
        for source, path in args.recording
        for flip in ((False, True) if args.mirrored else (False,))
    ]
    rows = []
    with ProgressBar(len(takes) * len(args.seeds), what="tracking") as progress:
        for source, labels, flip in takes:
            runs = []
            for number in args.seeds:
                runs.append(list(followed(source, labels, number, flip)))
                progress(1)
            rows.append([Path(source).name + " mirrored" * flip, *cells_of(runs)])
    print(
        aligned([["recording", "mm", "lowest", "highest", "without", "side", "sure", "off"], *rows])
    )
    return DONE
