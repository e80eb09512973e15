#!/usr/bin/env python3
"""Predict the hand in depth images: its joints and confidence, and a figure.

    python tools/predict.py frame.png --camera kinect2 --out pictures
    python tools/predict.py crop.png --out pictures
    python tools/predict.py frame.png --camera kinect2 --html frame.html --csv frame.csv

The network of models/synthetic_hand predicts a pose, and a fit refines it to match the depth
(--fit fast takes a third of the time, --fit no uses the network alone). --weights selects
your own network.

With --camera, the images are full depth frames: 16-bit grey PNG, 0 where there is no measurement;
with --camera nyu, also NYU's colour encoding. A camera.json (docs/camera.md) may also give their
unit and distortion. --center gives the position of the hand; by default it is detected. The crop is
then moved to the palm that the network predicts, --refine times; use 0 for networks whose training
crops are not centred like NYU's, such as ICVL's.

Without --camera, the images are crops: square 8-bit images of normalised depth, resized to 128 x
128. A value v means the depth of the centre + (v / 127.5 - 1) * cube / 2: the hand's centre is
mid-grey, the background white.

Networks are trained on right hands, in images that are not mirrored. --hand either, the default
with a fit, tries both and selects the one that matches the depth better; use --hand left or right
if it is known. Another body (docs/bodies.md) needs --weights and --model of its net, --cube, and
for full frames --center.

Joints are in mm, x right, y up, z away, from the camera, and without --camera from the crop's
centre. The percentage is the probability that their mean error is below 30 mm; below
--min-confidence no joints are given. --json has the format of a track, with one frame per image.
An image without a hand, or that cannot be read, is left out, and the exit status is 1.
--html also writes a page for the browser that shows the hands with the depth points; they can be
rotated and bent.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any, Literal

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

from numpy.typing import NDArray

from handpose import NYU, Camera, CameraInfo, load_predictor
from handpose.body.nyu import CUBE_MM
from handpose.body.sides import SOUGHT_SIDES
from handpose.estimate.hand import HandEstimate
from handpose.estimate.packaged import predictor_of
from handpose.estimate.predictor import MAX_REFINE, Predictor
from handpose.fit.settings import PLANS
from handpose.frames.formats import BAGS, RAW, STACKS
from handpose.frames.images import (
    ALIGNED,
    OTHER_KIND,
    UnitError,
    is_aligned,
    is_other_kind,
    read_crop,
    read_frame,
)
from handpose.frames.inspection import checked
from handpose.frames.recording import sized
from netlib.errors import DataError, WeightsError
from netlib.files.paths import ROOT
from tools.common import arguments, outputs, prediction_outputs, sources
from tools.common.commands import command
from tools.common.console import DONE, FAILED, guarded, notify, say

MODEL = ROOT / "prototxt" / "nyu_deploy.prototxt"
FIT: Literal["accurate"] = "accurate"  # default for hands
EITHER, UNFITTED = "either", "right"  # default sides with a fit and without one


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = arguments.parser_of(__doc__, nets=True)
    parser.add_argument(
        "images", metavar="IMAGE", nargs="+", help="crops, or with --camera full depth frames"
    )
    _add_predictor_options(parser)
    sources.add_camera_options(parser, "the images are full depth frames of this camera")
    parser.add_argument(
        "--center",
        type=sources.center,
        metavar="U,V[,D]",
        action="append",
        help="px, px, mm: centre of the hand, once for all frames or once per frame",
    )
    arguments.add_engine(parser)
    _add_output_options(parser)
    args = parser.parse_args(argv)
    _check(parser, args)
    return guarded(run, args)


def _add_predictor_options(parser: argparse.ArgumentParser) -> None:
    """Add the options for how a hand is predicted."""
    parser.add_argument(
        "--weights",
        metavar="FILE",
        help="*.caffemodel.h5 (default: those of models/synthetic_hand)",
    )
    parser.add_argument(
        "--model",
        metavar="NET",
        help="net with input depth and output pred (default: that of the packaged weights; with "
        f"--weights, {MODEL.name})",
    )
    parser.add_argument(
        "--fit",
        choices=("no", *PLANS),
        help=f"refine the predicted hand to match the depth (default: "
        f"{FIT}; fast for other bodies, no for those without a surface)",
    )
    parser.add_argument(
        "--hand", choices=SOUGHT_SIDES, help=f"default: {EITHER}, with --fit no {UNFITTED}"
    )
    parser.add_argument(
        "--cube",
        type=sources.cube,
        metavar="MM",
        help=f"edge of the cube (default for hands: {CUBE_MM:g})",
    )
    parser.add_argument(
        "--refine",
        type=arguments.whole(0, MAX_REFINE),
        default=3,
        metavar="N",
        help="move the crop to the predicted palm N times (default: %(default)s)",
    )
    sources.add_min_confidence(parser)


def _add_output_options(parser: argparse.ArgumentParser) -> None:
    """Add the options for pictures, tables and the page."""
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        default=Path(),
        help="output folder (default: the working folder)",
    )
    parser.add_argument(
        "--html", metavar="FILE", help="write a page on which the hands can be rotated"
    )
    sources.add_joints_option(
        parser, "in the table and in --csv instead of NYU's, in --json in addition"
    )
    parser.add_argument(
        "--csv", metavar="FILE.csv", type=arguments.name_in(".csv"), help="write one row per image"
    )
    parser.add_argument(
        "--json",
        metavar="FILE.json|-",
        type=arguments.name_in(".json", "-"),
        help="write JSON; with - print it instead of a table",
    )


def _check(parser: argparse.ArgumentParser, args: argparse.Namespace) -> None:
    """Raise a usage error for options that contradict each other."""
    if args.model and not args.weights:
        parser.error("--model needs --weights")
    if args.fit == "no" and args.hand == "either":
        parser.error("--hand either needs a fit; use --hand right or left")
    if args.camera is None:
        arguments.reject_given(
            parser,
            args,
            ["center", *sources.ABOUT_FRAMES, "refine"],
            "applies only to full frames, with --camera",
        )
    if args.center and len(args.center) not in (1, len(args.images)):
        parser.error(
            f"--center is given {len(args.center)} times for {len(args.images)} images; "
            "expected once, or once per image"
        )


def run(args: argparse.Namespace) -> int:
    """Predict the images."""
    is_frame = args.camera is not None
    info, camera = sources.frames_camera(args) if is_frame else (CameraInfo(), NYU)
    chosen = info.camera if isinstance(args.camera, Path) else args.camera
    predictor = _predictor(args, camera)
    outputs.make_folder(args.out)
    camera_file = args.camera if isinstance(args.camera, Path) else None
    for file in {args.html, args.csv, args.json} - {None, "-"}:
        outputs.check_place(file, [*args.images, camera_file, args.weights, args.model])
    centers = args.center or [None]
    if len(centers) == 1:
        centers = centers * len(args.images)
    ending = "_hand.png" if predictor.is_hand else "_body.png"
    pictures = outputs.places(args.images, args.out, ending)
    hands: list[tuple[str, HandEstimate]] = []
    drawn: list[Path] = []
    for image, center, picture in zip(args.images, centers, pictures):
        try:
            advice = f"for a recording: {command('track')} {image}"
            if Path(image).is_dir():
                raise DataError(
                    f"{image}: a folder; expected images, such as *.png in it; {advice}"
                )
            if Path(image).suffix.lower() in (*STACKS, *BAGS, RAW):
                raise DataError(f"{image}: no image; expected a PNG or TIFF; {advice}")
            depth = read_frame(image, info) if is_frame else read_crop(image)
            hand = (
                _in_frame(predictor, depth, center, image, info)
                if is_frame
                else predictor.in_crop(depth)
            )
        except DataError as error:  # the outputs are of the other images
            notify(error)
            continue
        if is_frame and is_aligned(Path(image), chosen, info.origin):
            notify(f"warning: {image}: {ALIGNED}")
        if is_frame and is_other_kind(Path(image).parent.name, Path(image).name):
            notify(f"warning: {image}: {OTHER_KIND}")
        hands.append((image, hand))
        drawn.append(picture)
        prediction_outputs.draw(picture, hand, predictor)
        if args.json != "-":
            words, lines = prediction_outputs.table(hand, predictor, args.joints)
            say(f"{image}: {words}; picture {picture}", *lines, sep="\n")
    if not hands:
        return FAILED
    if args.csv:
        prediction_outputs.write_csv(Path(args.csv), hands, predictor, args.joints)
    if args.json:
        prediction_outputs.write_json(args.json, hands, drawn, predictor, args.joints)
    if args.html:
        prediction_outputs.write_page(Path(args.html), hands, predictor)
    return DONE if len(hands) == len(args.images) else FAILED


def _predictor(args: argparse.Namespace, camera: Camera) -> Predictor:
    """Create the predictor that the arguments select."""
    options = {
        "cube_mm": args.cube,
        "refine": args.refine,
        "engine": args.engine,
        "min_confidence": args.min_confidence,
    }
    if not args.weights:
        options["hand"] = args.hand or (UNFITTED if args.fit == "no" else EITHER)
        return load_predictor(camera, fit=args.fit or FIT, **options)
    model = args.model or str(MODEL)
    try:
        return predictor_of(model, args.weights, camera, fit=args.fit, hand=args.hand, **options)
    except WeightsError as error:
        advice = f"the net is {model}: give that of these weights with --model"
        raise WeightsError(f"{error}; {advice}") from error


def _in_frame(
    predictor: Predictor, depth: NDArray[Any], center: Any, image: str, info: CameraInfo
) -> HandEstimate:
    """Predict the hand in a frame, and print warnings about its depths.

    Raises DataError with the image's name and advice.
    """
    try:
        hand = predictor.in_frame(depth, center)
    except DataError as error:
        has_position = center is not None and len(center) == 3
        if isinstance(error, UnitError) or has_position:
            raise DataError(f"{image}: {error}") from None
        shown = checked([depth], sized(predictor.camera, depth.shape, image), info.unit_mm)
        of_depths = [shown.doubt] if shown.doubt else shown.of_depths
        doubts = [*shown.of_camera, *(of_depths if center is None else ())]
        body = "hand" if predictor.is_hand else "body"
        advice = f"give the position of the {body} with --center U,V,D"
        raise DataError("; ".join([f"{image}: {error}", *doubts, advice])) from None
    if predictor.is_hand:
        confidence = 0.0 if hand.fit is None else hand.confidence
        sources.print_warnings(image, depth, hand.camera, info.unit_mm, confidence)
    return hand


if __name__ == "__main__":
    sys.exit(main())
