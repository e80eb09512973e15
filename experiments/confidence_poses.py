"""Tracked poses with their true errors, from which the weights of the confidence are fitted."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from experiments.constants import TrackedLabels
from experiments.hidden_parts import Shown, hidden_parts
from experiments.scenes import FINER, hands_in, predictors
from handpose.body.model import FINGERS, Fingers, Surface
from handpose.body.sides import SideView
from handpose.fit.body import CapsuleModel
from handpose.fit.pose_confidence import LOST_MM, Evidence
from handpose.frames.recording import Recording
from handpose.sequences.recordings import SyntheticRecording
from handpose.synthetic.whole_scenes import SceneGenerator
from handpose.tracking.hand_track import HandTrack
from handpose.tracking.output import variables_of
from netlib.blob import Array
from netlib.errors import DataError

# Weight of a pose that is not the labelled hand. With 1, 0.5 and 0.25, 58, 73 and 80% of the hands
# in P1, P4 and hpx have 90% or more; of the others 10, 16 and 21% have 30% or more, 0.2, 0.9
# and 2.0% the 60% that a second hand needs.
OTHER_WEIGHT = 0.5
MAX_PLACES = 2  # of the finder in a frame: the hand, and another one
HIDDEN_FRAMES = 48  # labelled frames of a recording that are copied with hidden parts
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
