#!/usr/bin/env python3
"""Predict the hand in depth images: the joints, and a picture with the skeleton on the depth and in space.

    python tools/predict.py snapshots/nyu_iter_1000.caffemodel.h5 crop.png --out pictures
    python tools/predict.py snapshots/nyu_iter_1000.caffemodel.h5 frame.png --camera kinect2 --out pictures

The first reads a crop: a square 8-bit picture of normalised depth, in which value v stands for the depth centre +
(v / 127.5 - 1) * cube / 2, so the hand's centre is mid-grey and the background white; it is resized to 128 x 128.

With --camera, the images are whole depth frames: 16-bit grey PNG, 0 where the camera read nothing; with --camera nyu
also NYU's colour packing. The nearest thing is taken for the hand, unless --center says where the hand is. The crop is
then moved to the palm that the network sees in it, --refine times; give 0 for networks whose training crops have
another centre than NYU's, such as ICVL's. A network knows the hand of its training data: for NYU and the synthetic
hands this is a right hand, in an image that is not mirrored. Use --mirror for the other hand.

Joints are printed in mm from the crop's centre (x right, y up, z away); with --camera also the centre in camera axes.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import netlib  # before NumPy: it chooses BLAS kernels

# isort: split

import numpy as np
from numpy.typing import NDArray

from handpose.data.images import read_crop, read_frame
from handpose.drawing import hands, sheets
from handpose.facts.cameras import CAMERAS, NYU
from handpose.facts.nyu import CUBE_MM
from handpose.predicting.predictor import FramePrediction, Prediction, Predictor
from netlib.errors import DataError, NetlibError, reason_of
from netlib.net import Net
from tools import pictures
from tools.arguments import add_engine, camera, center, natural, parser_of
from tools.console import DONE, guarded

ROOT = Path(__file__).resolve().parent.parent


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__)
    parser.add_argument("snapshot", metavar="SNAPSHOT", help="weights, *.caffemodel.h5")
    parser.add_argument("images", metavar="IMAGE", nargs="+", help="crops, or with --camera whole depth frames")
    parser.add_argument("--model", metavar="NET", default=str(ROOT / "prototxt" / "nyu_deploy.prototxt"),
                        help="net with the input depth and the output pred (default: nyu_deploy.prototxt)")  # fmt: skip
    parser.add_argument("--out", metavar="DIR", default=".", help="where the pictures go (default: here)")
    parser.add_argument("--cube", type=float, default=CUBE_MM, metavar="MM",
                        help="edge of the cube (default: %(default)g)")  # fmt: skip
    parser.add_argument("--camera", type=camera, metavar="NAME|FX,FY,U0,V0",
                        help="the images are whole depth frames of this camera: "
                             f"{', '.join(CAMERAS)}, or FX,FY,U0,V0")  # fmt: skip
    parser.add_argument("--unit", type=float, metavar="MM",
                        help="what a pixel's value of 1 stands for (default: 1, of sr305 0.125)")  # fmt: skip
    parser.add_argument("--center", type=center, metavar="U,V[,D]", action="append",
                        help="px, px, mm: middle of the hand, once for all frames or once per frame")  # fmt: skip
    parser.add_argument("--refine", type=natural, default=3, metavar="N",
                        help="move the crop to the predicted palm N times (default: %(default)s)")  # fmt: skip
    parser.add_argument("--mirror", action="store_true",
                        help="for the other hand: mirror the image, and mirror the joints back")  # fmt: skip
    add_engine(parser)
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    args = parser.parse_args(argv)
    if args.camera is None and (args.center or args.unit is not None):
        parser.error("--center and --unit are for whole frames; name their --camera")
    if args.center and len(args.center) not in (1, len(args.images)):
        parser.error(
            f"--center is given {len(args.center)} times for {len(args.images)} images; expected once, or for each"
        )
    if args.unit is not None and not 0 < args.unit < float("inf"):
        parser.error(f"--unit must be more than 0, found {args.unit:g}")
    if not 0 < args.cube < float("inf"):
        parser.error(f"--cube must be more than 0, found {args.cube:g}")
    return guarded(lambda: run(args))


def run(args: argparse.Namespace) -> int:
    """Predict as the parsed arguments say."""
    net = Net(args.model, args.snapshot, netlib.TEST, engine=args.engine)
    predictor = Predictor(net, args.camera or NYU, cube_mm=args.cube, mirror=args.mirror, refine=args.refine)
    out = Path(args.out)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise NetlibError(f"{out}: cannot write pictures there: {reason_of(error)}") from error
    if args.camera is None:
        depths = [read_crop(image) for image in args.images]
    else:
        depths = [read_frame(image, args.camera, args.unit) for image in args.images]
    given = args.center or [None]
    centers = given if len(given) > 1 else given * len(args.images)
    places = pictures.places(args.images, out, "_hand.png")
    results = []
    for image, depth, middle in zip(args.images, depths, centers):
        found = predictor.in_crop(depth) if args.camera is None else _in_frame(predictor, depth, middle, image)
        _draw(places[image], found, predictor)
        facts = {}
        if isinstance(found, FramePrediction):
            facts = {"center_uvd": found.center_uvd.round(2).tolist(), "center_mm": found.center_mm.round(2).tolist()}
        joints = dict(zip(predictor.skeleton.joint_names, found.joints_mm))
        if args.json:
            rounded = {name: xyz.round(2).tolist() for name, xyz in joints.items()}
            results.append({"image": image, "picture": str(places[image]), "cube_mm": args.cube, **facts,
                            "joints_mm": rounded})  # fmt: skip
        else:
            where = "" if not facts else " at {:.0f}, {:.0f}, {:.0f} mm".format(*facts["center_mm"])
            print(f"{image}: joints in mm from the crop's centre{where}, cube {args.cube:g} mm; "
                  f"picture {places[image]}")  # fmt: skip
            for name, (x, y, z) in joints.items():
                print(f"  {name:<14}{x:9.1f}{y:9.1f}{z:9.1f}")
    if args.json:
        print(json.dumps(results, indent=2))
    return DONE


def _in_frame(
    predictor: Predictor, depth: NDArray[np.float32], middle: tuple[float, ...] | None, image: str
) -> FramePrediction:
    """The hand in a frame; an error names the image, and says what to do."""
    try:
        start = predictor.start(depth, middle)
    except DataError as error:
        raise DataError(f"{image}: {error}; say with --center U,V,D where the hand is") from None
    try:
        return predictor.in_frame(depth, start)
    except DataError as error:
        raise DataError(f"{image}: {error}") from None


def _draw(picture: Path, found: Prediction, predictor: Predictor) -> None:
    """The skeleton on the crop, and in space."""
    place: dict[str, Any] = {}
    if isinstance(found, FramePrediction):
        place = {"center_uvd": found.center_uvd, "cube_mm": found.cube_mm, "camera": found.camera}
    drawn = hands.overlay(found.crop, found.joints, predictor.skeleton, **place)
    pictures.write_image(picture, sheets.sheet([drawn, hands.view_3d(found.joints, predictor.skeleton)], 2))


if __name__ == "__main__":
    sys.exit(main())
