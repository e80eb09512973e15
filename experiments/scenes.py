"""Hands that are found in rendered scenes: their sides, errors and confidence.

    python -m experiments scenes
    python -m experiments scenes --network snapshots/in_scenes_iter_44000.caffemodel.h5 \\
        models/synthetic_hand/deploy.prototxt --scenes 320

Scenes are those of the training's generator with other random numbers ("training"), and of another
setting of it ("other"): more cameras on heads, and more hands that rest, hold something or are near
another one. Frames have twice the resolution of the finder's trainings.

Each hand that the finder finds within 80 mm is fitted as by tools/predict.py. A row has the hands
in sight, the share found, and of these: the share whose side is right, and the mean and the median
error in mm of 14 joints where it is; the share with a confidence of 30% or more, which would have
joints, and of these the share whose side is right and error below 30 mm ("good"); the number with
90% or more ("sure"), and the share of these that is no good ("off"). "false" are hands with joints
where there is none, a frame. "same" is the mean error of a pose that is always the same, at the
true place.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from experiments.constants import SURE
from experiments.finder import WITHIN_MM
from experiments.fit import add_network
from experiments.labelled_frames import camera_of, first_scenes
from experiments.tables import mean, tabulated
from handpose import load_predictor
from handpose.body.sides import Side, SideView, SoughtSide
from handpose.estimate.finder import FoundHand
from handpose.estimate.hand import MIN_CONFIDENCE, HandEstimate
from handpose.estimate.predictor import Predictor
from handpose.fit.pose_confidence import GOOD_MM
from handpose.fit.settings import PLANS, Fit
from handpose.frames.cameras import Camera
from handpose.scoring.metrics import mean_errors_14
from handpose.synthetic.scenes import prior as scene_prior
from handpose.synthetic.scenes.draws import Range
from handpose.synthetic.whole_scenes import SceneGenerator
from netlib.blob import Array
from netlib.errors import DataError
from netlib.net import Net
from netlib.proto.schema import changed
from netlib.training.trained import trained
from tools.common.arguments import add_engine, count, seed
from tools.common.progress import ProgressBar

FINER = 2  # resolution of the frames, relative to the training's


class SceneHand(NamedTuple):
    """A hand in sight, and its estimate if it was found.

    joints  (K, 3) mm
    """

    joints: Array
    side: Side
    estimate: HandEstimate | None

    @property
    def error_mm(self) -> float:
        """The mean error of 14 joints; infinite as the other side."""
        assert self.estimate is not None
        if self.estimate.hand != self.side:
            return np.inf
        return float(mean_errors_14(self.estimate.xyz[None], self.joints[None])[0])


def other_setting() -> scene_prior.ScenePrior:
    """Another setting than the packaged prior's."""
    prior = scene_prior.load()
    distance = Range(350.0, 1100.0)
    return changed(
        prior,
        view=changed(prior.view, on_head=0.6, facing=0.1),
        hands=changed(prior.hands, rests=0.4, second=0.8, close=0.3, distance=distance),
        held=changed(prior.held, share=0.6),
        table=changed(prior.table, share=0.9, near=0.6),
        body=changed(prior.body, share=0.9),
    )


class SceneHands(NamedTuple):
    """The hands in sight in a scene, and the estimates where there is none."""

    hands: list[SceneHand]
    false: list[HandEstimate]


def hands_in(
    generator: SceneGenerator, scenes: int, predictor_of: Callable[[Camera], Predictor]
) -> Iterator[SceneHands]:
    """The hands in some scenes. Raises NetlibError."""
    for block, n in first_scenes(generator, scenes):
        predictor = predictor_of(camera_of(block, n))
        depth, middle = block.depth[n], block.middle[n]
        frame = SideView("right", predictor.camera, depth, depth)
        assert predictor.finder is not None
        left = predictor.finder.hands_in(frame)
        hands = []
        for k in np.flatnonzero(block.present[n]):
            own = _nearest(left, middle[k])
            left = [one for one in left if one is not own]
            side: Side = "right" if block.is_right[n, k] else "left"
            estimate = None if own is None else _estimate(predictor, frame, own)
            hands.append(SceneHand(block.joints[n, k], side, estimate))
        doubtful = middle[block.doubtful[n]]
        others = [one for one in left if all(_apart(one, place) > WITHIN_MM for place in doubtful)]
        estimates = [_estimate(predictor, frame, one) for one in others]
        yield SceneHands(hands, [one for one in estimates if one])


def predictors(
    fit: Fit, net: Net | None = None, hand: SoughtSide = "either"
) -> Callable[[Camera], Predictor]:
    """Predictors of hands, however sure, by the packaged network or another one."""
    packaged = load_predictor(fit=fit)

    def predictor_of(camera: Camera) -> Predictor:
        return Predictor(
            net or packaged.net,
            camera,
            hand=hand,
            fit=fit,
            fitter=packaged.fitter,
            finder=packaged.finder,
            min_confidence=0,
        )

    return predictor_of


def _nearest(found: Sequence[FoundHand], place: Array) -> FoundHand | None:
    """The hand found nearest to a place (3,), if it is near enough."""
    near = [one for one in found if _apart(one, place) < WITHIN_MM]
    return min(near, key=lambda one: _apart(one, place)) if near else None


def _apart(found: FoundHand, place: Array) -> float:
    return float(np.linalg.norm(found.middle - place))


def _estimate(predictor: Predictor, frame: SideView, found: FoundHand) -> HandEstimate | None:
    """The estimate of a found hand; None if its pose leads out of the image."""
    try:
        return predictor.at_found(frame, found)
    except DataError:
        return None


def cells_of(scenes: Sequence[SceneHands]) -> dict[str, str]:
    """The columns of some scenes by their names."""
    hands = [hand for scene in scenes for hand in scene.hands]
    false = [one for scene in scenes for one in scene.false if one.chance >= MIN_CONFIDENCE]
    fitted = [hand for hand in hands if hand.estimate]
    joints = np.array([hand.joints for hand in hands]).reshape(len(hands), -1, 3)
    around = joints - joints.mean(axis=1, keepdims=True)
    error = np.array([hand.error_mm for hand in fitted])
    confidence = np.array([hand.estimate.chance for hand in fitted if hand.estimate])
    right, given, sure = np.isfinite(error), confidence >= MIN_CONFIDENCE, confidence >= SURE
    same = [mean_errors_14(around.mean(axis=0)[None], own[None]) for own in around]
    return {
        "hands": str(len(hands)),
        "found": mean("{:.0%}", [hand.estimate is not None for hand in hands]),
        "side": mean("{:.0%}", right),
        "mean": mean("{:.1f}", error[right]),
        "median": f"{np.median(error[right]):.1f}" if right.any() else "",
        "joints": mean("{:.0%}", given),
        "good": mean("{:.0%}", error[given] < GOOD_MM),
        "sure": str(sure.sum()),
        "off": mean("{:.1%}", error[sure] > GOOD_MM),
        "false": f"{len(false) / len(scenes):.2f}",
        "same": mean("{:.1f}", same),
    }


# ------------------------------------------------------------------------------------- command line


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    add_network(parser)
    parser.add_argument("--fit", choices=PLANS, default="accurate", help="default: %(default)s")
    parser.add_argument(
        "--scenes", type=count, default=160, metavar="N", help="of each kind (default: %(default)s)"
    )
    parser.add_argument(
        "--seed", type=seed, default=8100, metavar="N", help="of the scenes (default: %(default)s)"
    )
    add_engine(parser)


def run(args: argparse.Namespace) -> None:
    """Find and fit the hands. Raises NetlibError."""
    net = None
    if args.network:
        weights, model = args.network
        net = trained(model, weights, args.engine)
    predictor_of = predictors(args.fit, net)
    rows = []
    with ProgressBar(2 * args.scenes, "scenes") as progress:
        for name, prior in (("training", scene_prior.load()), ("other", other_setting())):
            generator = SceneGenerator(args.seed, "test", prior, FINER)
            scenes = []
            for scene in hands_in(generator, args.scenes, predictor_of):
                scenes.append(scene)
                progress(1)
            rows.append({"scenes": name, **cells_of(scenes)})
    print(tabulated(rows))
