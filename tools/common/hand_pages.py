"""Predicted hands as an HTML page in which they can be rotated."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from handpose.drawing.page.assembly import page
from handpose.drawing.page.content import content, hand
from handpose.facts.sides import as_right
from handpose.prediction.nets import hand_inputs
from handpose.prediction.prediction import Prediction
from handpose.prediction.predictor import Predictor
from handpose.sequences.gestures import poses
from handpose.synthetic.pose_prior import BodySampler
from netlib.files import atomic
from tools.common import findings


def write(path: Path, found: Sequence[tuple[str, Prediction]], predictor: Predictor) -> None:
    """Write one page for all images, with a list to select from. Raises OSError, NetlibError."""
    hands = [_hand(image, prediction, predictor) for image, prediction in found]
    sampler = BodySampler()
    own = predictor.skeleton.dof_names == sampler.skeleton.dof_names
    data = content(predictor.skeleton, hands, poses(sampler) if own else None, predictor.cube_mm / 2)
    title = "Predicted hands" if len(hands) > 1 else "Predicted hand"
    atomic.replace_text(path, page(title if predictor.is_hand else f"{predictor.skeleton.name}, predicted", data))


def _hand(image: str, found: Prediction, predictor: Predictor) -> dict[str, Any]:
    if found.fit:
        inputs, size, thickness = found.fit.whole, found.fit.size, found.fit.thickness
    else:
        inputs, size, thickness = hand_inputs(predictor.net, as_right(found.crop, found.hand)[None])[0], 1.0, 1.0
    words = findings.in_words(found, predictor).partition(";")[0]
    return hand(Path(image).name, words, inputs, camera=found.camera, center_uvd=found.center_uvd,
                cube_mm=found.cube_mm, crop=found.crop, size=size, thickness=thickness, side=found.hand)  # fmt: skip
