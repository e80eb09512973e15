"""Predictions as text, JSON, CSV, pictures, and an HTML page on which the hands can be rotated."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from handpose.body.joint_formats.formats import FORMATS, FormatName
from handpose.estimate.hand import HandEstimate
from handpose.estimate.nets import hand_poses
from handpose.estimate.predictor import Predictor
from handpose.frames.cameras import Camera
from handpose.frames.inspection import Inspection
from handpose.output.drawing import hands, sheets, strokes, surface
from handpose.output.drawing.tracks import Painter
from handpose.output.drawing.view import percent
from handpose.output.hand_page.assembly import page
from handpose.output.hand_page.values import body, hand
from handpose.output.tracks import joint_values
from handpose.output.tracks.csv_file import HandColumns, rows_of
from handpose.output.tracks.json_values import FrameValues, header_values
from handpose.synthetic import prior_file
from handpose.synthetic.pose_prior import BodySampler
from handpose.tracking.output import predicted_hand
from handpose.tracking.track import TrackedFrame, TrackHeader
from layers.hand.skeleton import Skeleton
from netlib.errors import DataError
from netlib.files import atomic
from tools.common import outputs
from tools.common.console import DONE, say


def table(
    found: HandEstimate, predictor: Predictor, joints: FormatName | None
) -> tuple[str, list[str]]:
    """A summary of a prediction, and lines of its joints, or of those in another format.

    Raises DataError.
    """
    words = f"{in_words(found, predictor)}, cube {predictor.cube_mm:g} mm"
    if not found.has_joints:
        return words, []
    pose = predicted_hand(found, predictor.skeleton).the_pose
    if joints:
        values = joint_values.hand_values(joints, pose, _camera_of(found))
        return words, _format_lines(found, joints, values)
    own = zip(predictor.skeleton.joint_names, pose.xyz)
    return words, [f"  {name:<14}{x:9.1f}{y:9.1f}{z:9.1f}" for name, (x, y, z) in own]


def write_csv(
    path: Path,
    hands: Sequence[tuple[str, HandEstimate]],
    predictor: Predictor,
    joints: FormatName | None,
) -> None:
    """Write a table with a row for each image and its prediction. Raises DataError, OSError."""
    columns = HandColumns(predictor.skeleton, joints, angles=predictor.fitter is not None)
    rows = [["image", "hand", *columns.about, *columns.pose]]
    for image, found in hands:
        made = predicted_hand(found, predictor.skeleton)
        pose = [""] * len(columns.pose)
        if made.pose is not None:
            pose = columns.pose_values(made.pose, _camera_of(found))
        rows.append([image, made.hand or "", *columns.about_values(made), *pose])
    content = rows_of(rows)
    atomic.replace(path, lambda fresh: fresh.write_bytes(content))


def write_json(
    file: str,
    hands: Sequence[tuple[str, HandEstimate]],
    pictures: Sequence[Path],
    predictor: Predictor,
    joints: FormatName | None,
) -> None:
    """Write the images, pictures and predictions as a track with one frame per image, or print it
    for the name ``-``.

    Raises DataError, OSError.
    """
    source = hands[0][0] if len(hands) == 1 else f"{len(hands)} images"
    frames = [
        {
            "image": image,
            "picture": str(picture),
            **frame_values(number, found, predictor.skeleton, joints),
        }
        for number, ((image, found), picture) in enumerate(zip(hands, pictures))
    ]
    text = document(source, [found for _, found in hands], frames, predictor.skeleton, joints)
    if file == "-":
        print(text)
    else:
        atomic.replace_text(Path(file), text + "\n")


def frame_values(
    number: int, found: HandEstimate, skeleton: Skeleton, joints: FormatName | None = None
) -> dict[str, Any]:
    """The JSON frame of one prediction, without a time; ``joints`` is an additional format.

    Raises DataError.
    """
    frame = TrackedFrame(number, math.nan, (predicted_hand(found, skeleton),))
    values = FrameValues(_header("", found, skeleton), joints, in_frames=found.in_frame)
    return values.values(frame)


def document(
    source: str,
    found: Sequence[HandEstimate],
    frames: Sequence[dict[str, Any]],
    skeleton: Skeleton,
    joints: FormatName | None = None,
) -> str:
    """The JSON text of predictions, at least one, and of their frames (``frame_values``)."""
    header = _header(source, found[0], skeleton)
    cameras = {hand.camera for hand in found}
    if len(cameras) > 1:  # images of several sizes
        header = replace(header, camera=replace(header.camera, width=0, height=0))
    head = json.dumps(header_values(header, joints, in_frames=found[0].in_frame), allow_nan=False)
    lines = ",\n".join(json.dumps(frame, allow_nan=False) for frame in frames)
    return f'{head[:-1]}, "frames": [\n{lines}\n], "complete": true}}'


def _header(source: str, found: HandEstimate, skeleton: Skeleton) -> TrackHeader:
    return TrackHeader(source, found.camera, skeleton, found.cube_mm / 2, smoothed=False)


def _camera_of(found: HandEstimate) -> Camera | None:
    """The camera of a hand in a frame."""
    return found.camera if found.in_frame else None


def in_words(found: HandEstimate, predictor: Predictor) -> str:
    """Summary of a prediction on one line."""
    words = f"{found.hand} hand" if predictor.is_hand else predictor.skeleton.name
    if not math.isnan(found.error_mm):
        words += f", {percent(found.confidence)} sure, {found.error_mm:.0f} mm of error expected"
    if found.in_frame:
        words += "; at {:.0f}, {:.0f}, {:.0f} mm".format(*found.center_mm)
    if not found.has_joints:
        return f"{words}; no joints below {predictor.min_confidence:.0%} (--min-confidence)"
    return words + (
        ", joints in mm from the camera"
        if found.in_frame
        else "; joints in mm from the crop's centre"
    )


def _format_lines(found: HandEstimate, name: FormatName, values: dict[str, Any]) -> list[str]:
    """Tables of a format's joints and of the angles; each line shows the
    ``values`` of one joint.
    """
    center = "from the camera" if found.in_frame else "from the crop's centre"
    about = "about its mean" if name == "mediapipe" else center
    kinds = {key: of for key, of in values[name].items() if of is not None and key != "center_m"}
    lines = [f"  {name}: {', '.join(kinds)}; {FORMATS[name].in_words}, {about}"]
    for i, joint in enumerate(FORMATS[name].joints):
        rows = [np.atleast_1d(of[i]) for of in kinds.values()]
        decimals = 1 if FORMATS[name].unit == "mm" else 4
        lines.append(
            f"  {joint:<20}" + "".join(f"{number:10.{decimals}f}" for row in rows for number in row)
        )
    return [
        *lines,
        *(
            f"  {angle:<28}{degrees:8.1f} deg"
            for angle, degrees in values[joint_values.ANGLES_KEY].items()
        ),
    ]


def views(found: HandEstimate, predictor: Predictor, zoom: int = 4) -> list[strokes.Image]:
    """The skeleton on the crop and in space, and between them the surface, if there was a fit.

    Fingers that are guesses are hollow. Of a hand without joints only the crop is drawn.
    """
    if not found.has_joints:
        return [hands.picture(found.crop, zoom)]
    place: dict[str, Any] = {
        "center_uvd": found.center_uvd,
        "cube_mm": found.cube_mm,
        "camera": found.camera,
    }
    guesses = hands.guessed(found.finger_error_mm)
    seen_at = place if found.in_frame else {}
    drawn = [
        hands.overlay(
            found.crop, found.joints, predictor.skeleton, **seen_at, zoom=zoom, guesses=guesses
        )
    ]
    if found.fit is not None:
        drawn.append(surface.over_crop(found.crop, found.capsules(), **place, zoom=zoom))
    drawn.append(
        hands.view_3d(found.joints, predictor.skeleton, size=len(drawn[0]), guesses=guesses)
    )
    return drawn


def draw(picture: Path, found: HandEstimate, predictor: Predictor) -> None:
    """Write the views of a prediction as one picture. Raises NetlibError."""
    drawn = views(found, predictor)
    outputs.write_image(picture, sheets.sheet(drawn, len(drawn), captions(found, predictor)))


def captions(found: HandEstimate, predictor: Predictor) -> list[str]:
    """A caption for each view: what was found and how sure it is, and what the colours of
    the surface mean.
    """
    sure = "" if found.fit is None else f", {percent(found.confidence)} sure"
    if not found.has_joints:
        return [f"{percent(found.confidence)} sure: no joints"]
    error = "" if math.isnan(found.error_mm) else f", expected error {found.error_mm:.0f} mm"
    first = f"{found.hand if predictor.is_hand else predictor.skeleton.name}{sure}{error}"
    surface_view = [] if found.fit is None else ["fitted surface; red: no depth behind it"]
    return [first, *surface_view, "in space, from the side"]


def write_page(path: Path, found: Sequence[tuple[str, HandEstimate]], predictor: Predictor) -> None:
    """Write one page for all images, with a list to select from of those whose joints are known.

    Raises OSError, NetlibError, and DataError if there is none.
    """
    # imported here, because SciPy's rotations take a while
    from handpose.sequences.movements import poses

    hands = [
        _on_page(image, prediction, predictor)
        for image, prediction in found
        if prediction.has_joints
    ]
    if not hands:
        raise DataError(
            f"{path}: not written: nothing has joints, which need a confidence of at least "
            f"{predictor.min_confidence:.0%} (--min-confidence)"
        )
    name = predictor.skeleton.name
    sampler = BodySampler(
        prior_file.load(prior_file.PEOPLE_PRIOR if name == "people" else prior_file.NYU_PRIOR)
    )
    own = predictor.skeleton.dof_names == sampler.skeleton.dof_names
    shown = body(name, predictor.skeleton, poses(sampler) if own else None, predictor.cube_mm / 2)
    title = "Predicted hands" if len(hands) > 1 else "Predicted hand"
    atomic.replace_text(
        path, page(title if predictor.is_hand else f"{name}, predicted", [shown], hands)
    )


def _on_page(image: str, found: HandEstimate, predictor: Predictor) -> dict[str, Any]:
    if found.fit is not None:
        inputs, size, thickness = found.whole_inputs, found.size, found.thickness
    else:
        poses = hand_poses(predictor.net, found.view_crop[None])
        inputs, size, thickness = poses.inputs[0], 1.0, 1.0
    return hand(
        Path(image).name,
        in_words(found, predictor).partition(";")[0],
        inputs,
        camera=found.camera,
        center_uvd=found.center_uvd,
        cube_mm=found.cube_mm,
        crop=found.crop,
        size=size,
        thickness=thickness,
        side=found.hand,
    )


def draw_first(seen: Inspection, predictor: Predictor, picture: str) -> int:
    """Draw the first hand with joints in the first frames, otherwise the first hand; returns
    the exit status.

    If there is none, the first frame is drawn, which may show why, and DataError is raised.
    """
    shown = None
    for frame in seen.frames:
        try:
            found = predictor.in_frame(frame.depth)
        except DataError:
            continue
        shown = (frame, found) if shown is None or found.has_joints else shown
        if found.has_joints:
            break
    if shown is not None:
        frame, found = shown
        draw(Path(picture), found, predictor)
        say(f"frame {frame.number}: {in_words(found, predictor)}; figure {picture}")
        return DONE
    first = seen.frames[0]
    header = TrackHeader(seen.recording.name, seen.recording.camera, predictor.skeleton)
    outputs.write_image(
        picture, Painter(header).seen(first.depth, TrackedFrame(first.number, first.time, ()))
    )
    doubt = seen.doubt and f"; {seen.doubt}"
    raise DataError(
        f"{seen.recording.name}: no hand in the first {len(seen.frames)} frames; {picture} shows the first one{doubt}"
    )
