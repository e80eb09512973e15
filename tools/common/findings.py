"""What is said and drawn of a hand that was found: for JSON, in words, as a picture."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from handpose.drawing import flesh, hands, sheets
from handpose.drawing.identities import percent
from handpose.predicting.prediction import FramePrediction, Prediction
from handpose.predicting.predictor import Predictor
from tools.common import pictures


def facts(found: Prediction, predictor: Predictor) -> dict[str, Any]:
    """What JSON says beside the joints."""
    said: dict[str, Any] = {"hand": found.hand} if predictor.is_hand else {"body": predictor.skeleton.name}
    if isinstance(found, FramePrediction):
        said |= {"center_uvd": found.center_uvd.round(2).tolist(), "center_mm": found.center_mm.round(2).tolist()}
    if found.fit:
        measured = not math.isnan(found.fit.error_mm)
        said |= {
            "inputs": (found.fit.inputs.round(6) + 0.0).tolist(),
            "size": round(found.fit.size, 4),
            "expected_error_mm": round(found.fit.error_mm, 1) if measured else None,
            "confidence": round(found.fit.confidence, 3) if measured else None,
            "misfit": round(found.fit.misfit, 2),
        }
    return said


def in_words(found: Prediction, predictor: Predictor) -> str:
    """The first line of the table."""
    words = f"{found.hand} hand" if predictor.is_hand else predictor.skeleton.name
    if found.fit and not math.isnan(found.fit.error_mm):
        words += f", {percent(found.fit.confidence)} sure, {found.fit.error_mm:.0f} mm of error expected"
    words += "; joints in mm from the crop's centre"
    if isinstance(found, FramePrediction):
        words += " at {:.0f}, {:.0f}, {:.0f} mm".format(*found.center_mm)
    return words


def draw(picture: Path, found: Prediction, predictor: Predictor) -> None:
    """The skeleton on the crop and in space; between them the flesh, if there was a fit."""
    place: dict[str, Any] = {}
    if isinstance(found, FramePrediction):
        place = {"center_uvd": found.center_uvd, "cube_mm": found.cube_mm, "camera": found.camera}
    drawn = [hands.overlay(found.crop, found.joints, predictor.skeleton, **place)]
    if found.fit:
        camera, middle = predictor.alone()
        place = place or {"center_uvd": middle, "cube_mm": found.cube_mm, "camera": camera}
        drawn.append(flesh.over_crop(found.crop, found.fit.capsules, **place))
    drawn.append(hands.view_3d(found.joints, predictor.skeleton))
    pictures.write_image(picture, sheets.sheet(drawn, len(drawn)))
