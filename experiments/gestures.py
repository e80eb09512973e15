"""Gesture recognition on synthetic recordings of one hand: confusion matrix and delay.

    python -m experiments gestures --seeds 100 101 102 103
    python -m experiments gestures --seconds 5 --cameras kinect2 --truth

Each recording shows the gestures in random order, each held for 0.4 to 1.2 s. Rows are the gestures
shown, columns those recognized, in percent of the frames in which the fingers have been at rest for
0.2 s; "none" means no gesture, "lost" no hand. --truth recognizes gestures from the true joints
instead of a tracker's.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from handpose import CAMERAS, Tracker, load_predictor
from handpose.body.gestures import GESTURES, GestureReader
from handpose.sequences.acts import Act
from handpose.sequences.movements import fingers_of
from handpose.sequences.recordings import Script, SyntheticRecording
from handpose.synthetic.prior_file import PartParameter, PoseParameter
from handpose.tracking.track import TrackedFrame, TrackHeader
from tools.common.arguments import add_engine, seconds, seed
from tools.common.console import DONE, aligned, say

SETTLED_S = 0.2  # delay after the fingers came to rest, before a gesture is scored
NONE, LOST = "none", "lost"
READ = (*GESTURES, NONE, LOST)

# The gestures that recordings show. Unlike the poses of the prior files, about which training
# data are drawn, the thumb is out or across the palm as in the gesture's definition, and a
# pinch touches.
_OUT = {
    "thumb_pip_rot_y": 0.5,
    "thumb_pip_rot_z": 0.1,
    "thumb_dip_rot_z": 0.7,
    "thumb_tip_rot_z": 0.4,
}
_ACROSS = {
    "thumb_pip_rot_y": 0.3,
    "thumb_pip_rot_z": 0.75,
    "thumb_dip_rot_z": 0.8,
    "thumb_tip_rot_z": 0.3,
}
_FOLDED = {
    "thumb_pip_rot_y": 0.7,
    "thumb_pip_rot_z": 0.72,
    "thumb_dip_rot_z": 0.97,
    "thumb_tip_rot_z": 0.94,
}
_TOUCHING = {
    "thumb_pip_rot_y": 0.39,
    "thumb_pip_rot_z": 0.57,
    "thumb_dip_rot_z": 0.68,
    "thumb_tip_rot_z": 0.59,
    "index_base_rot_x": 0.58,
    "index_base_rot_z": 0.46,
    "index_pip_rot_x": 0.33,
    "index_dip_rot_x": 0.33,
}


def _pose(
    name: str, bends: tuple[float, float, float, float], at: dict[str, float]
) -> PoseParameter:
    """A pose: the bends of index to little finger with their knuckles, and DoFs as fractions
    of their ranges.
    """
    bent = [
        PartParameter(chain, bend)
        for of, bend in zip(("index", "middle", "ring", "little"), bends)
        for chain in (of, f"{of}_knuckle")
        if bend >= 0
    ]
    return PoseParameter(
        name, tuple(bent), tuple(PartParameter(of, part) for of, part in at.items())
    )


SHOWN = (
    _pose("open", (0.12, 0.12, 0.12, 0.12), _OUT),
    _pose("fist", (0.8, 0.8, 0.8, 0.8), _FOLDED),
    _pose("point", (0.1, 0.8, 0.8, 0.8), _FOLDED),
    _pose("pinch", (-1, 0.2, 0.15, 0.1), _TOUCHING),
    _pose("thumb_up", (0.8, 0.8, 0.8, 0.8), _OUT),
    _pose("two", (0.1, 0.1, 0.8, 0.8), _FOLDED),
    _pose("three", (0.1, 0.1, 0.1, 0.8), _FOLDED),
    _pose("four", (0.1, 0.1, 0.1, 0.1), _ACROSS),
)
SHOWING = Script(
    30, {"right": (Act("gestures", 30, tuple(pose.name for pose in SHOWN)),)}, poses=SHOWN
)


@dataclass
class GestureFigures:
    """Counts over recordings.

    counts  frames (shown, read), in the order of ``GESTURES`` and of ``READ``
    delays  s from the rest of the fingers to the recognition of the gesture, for recognised ones
    """

    counts: np.ndarray = field(
        default_factory=lambda: np.zeros((len(GESTURES), len(READ)), dtype=int)
    )
    delays: list[float] = field(default_factory=list)

    def right(self) -> float:
        """The share of frames in which the gesture is recognised; NaN without frames."""
        return (
            float(np.trace(self.counts[:, : len(GESTURES)]) / self.counts.sum())
            if self.counts.any()
            else np.nan
        )


class _Shown:
    """The gestures of the first role of a recording, each with the time at which its
    fingers come to rest.
    """

    def __init__(self, recording: SyntheticRecording) -> None:
        self._shown = recording.movements[0].fingers
        fingers = {name: fingers_of(name, recording.person, recording.sampler) for name in GESTURES}
        self._names = [
            next((name for name, own in fingers.items() if np.array_equal(own, key)), "")
            for key in self._shown.keys
        ]

    def at(self, time: float) -> tuple[str, float]:
        """The gesture, or "" while fingers move or hold another pose; and its start in s."""
        done = self._shown.done(time)
        if ((done > 0) & (done < 1)).any():
            return "", time
        count = int(np.count_nonzero(done == 1))
        return self._names[count], self._shown.begins[count - 1] + self._shown.lasts[
            count - 1
        ] if count else 0.0


def measure(
    recordings: Iterable[SyntheticRecording],
    track: Callable[[SyntheticRecording], tuple[TrackHeader, Iterable[TrackedFrame]]],
) -> GestureFigures:
    """Read the gestures of the tracks of recordings, which show one hand. Raises NetlibError.

    track  gives the track of a recording: a tracker's, or the true one
    """
    found = GestureFigures()
    for recording in recordings:
        shown, pending = _Shown(recording), ""
        header, frames = track(recording)
        reader = GestureReader(header.skeleton)
        for frame in frames:
            read = LOST
            for hand in frame.hands[:1]:
                read = reader.read(hand.id, hand.hand, hand.xyz, frame.time).name or NONE
            name, since = shown.at(frame.time)
            if not name:
                pending = ""
                continue
            if read == name and pending != name:
                found.delays.append(max(0.0, frame.time - since))
                pending = name
            if frame.time - since >= SETTLED_S and recording.truth(frame.number).hands:
                found.counts[GESTURES.index(name), READ.index(read)] += 1
    return found


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "--seeds",
        type=seed,
        nargs="+",
        default=[100],
        metavar="N",
        help="seeds of the recordings (default: 100)",
    )
    parser.add_argument(
        "--cameras",
        choices=CAMERAS,
        nargs="+",
        default=["nyu"],
        metavar="NAME",
        help=f"some of {', '.join(CAMERAS)} (default: nyu)",
    )
    parser.add_argument(
        "--seconds", type=seconds, metavar="S", help="duration of each (default: 30)"
    )
    parser.add_argument(
        "--truth", action="store_true", help="use the true joints instead of a tracker"
    )
    parser.add_argument("--left", action="store_true", help="use the left hand")
    add_engine(parser)


def run(args: argparse.Namespace) -> int:
    """Measure gesture recognition. Raises NetlibError."""
    recordings = [
        SyntheticRecording(
            SHOWING, CAMERAS[camera], seconds=args.seconds, seed=seed, mirrored=args.left
        )
        for camera in args.cameras
        for seed in args.seeds
    ]

    def tracked(recording: SyntheticRecording) -> tuple[TrackHeader, Iterable[TrackedFrame]]:
        if args.truth:
            return recording.header, recording.truths()
        tracker = Tracker(
            load_predictor(recording.camera, fit="fast", hand="either", engine=args.engine),
            hands=1,
            min_confidence=0,
        )
        return tracker.header(recording.name), map(tracker.step, recording)

    found = measure(recordings, tracked)
    rows = [["shown", "frames", *READ]]
    for name, row in zip(GESTURES, found.counts):
        rows.append(
            [name, str(row.sum()), *(f"{100 * n / row.sum():.0f}" if n else "" for n in row)]
        )
    print(aligned(rows))
    right = f"{found.right():.1%} of " if found.counts.any() else ""
    delay, times = np.median(found.delays or [0.0]), len(found.delays)
    say(
        f"{right}{found.counts.sum()} frames are recognized correctly; "
        f"median delay {delay:.2f} s after the fingers come to rest, {times} times"
    )
    return DONE
