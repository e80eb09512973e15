#!/usr/bin/env python3
"""Predict the hand in depth images: the joints, and a picture with the skeleton on the depth and in space.

    python tools/predict.py snapshots/nyu_iter_1000.caffemodel.h5 crop.png --out pictures
    python tools/predict.py snapshots/nyu_iter_1000.caffemodel.h5 frame.png --camera kinect2 --out pictures

The first reads a crop: a square 8-bit picture of normalised depth, in which value v stands for the depth centre +
(v / 127.5 - 1) * cube / 2, so the hand's centre is mid-grey and the background white; it is resized to 128 x 128.

With --camera, whole depth frames are read: 16-bit grey PNG, 0 where nothing was read, or NYU's colour packing. The hand
is taken to be the nearest thing, unless --center says where it is, and the crop is moved to where the network sees the
palm (--refine times; 0 for networks whose training crops are not centred as NYU's are, such as ICVL's). Networks know
the hand of their training data, for NYU and the synthetic hands a right hand seen as by a mirror-free camera: --mirror
for the other one.

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
from handpose.facts.cameras import CAMERAS, NYU, Camera
from handpose.facts.nyu import CUBE_MM
from handpose.predicting.predictor import FramePrediction, Prediction, Predictor
from netlib.errors import DataError, NetlibError, reason_of
from netlib.net import Net
from tools import pictures
from tools.console import DONE, guarded, natural

ROOT = Path(__file__).resolve().parent.parent


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("snapshot", metavar="SNAPSHOT", help="weights, *.caffemodel.h5")
    parser.add_argument("images", metavar="IMAGE", nargs="+", help="normalised depth crops")
    parser.add_argument("--model", metavar="NET", default=str(ROOT / "prototxt" / "nyu_deploy.prototxt"),
                        help="net with the input depth and the output pred (default: nyu_deploy.prototxt)")  # fmt: skip
    parser.add_argument("--out", metavar="DIR", default=".", help="where the pictures go (default: here)")
    parser.add_argument(
        "--cube", type=float, default=CUBE_MM, metavar="MM", help="edge of the cube (default: %(default)g)"
    )
    parser.add_argument("--camera", type=_camera, metavar="NAME|FX,FY,U0,V0",
                        help=f"images are whole depth frames of {', '.join(CAMERAS)}, or FX,FY,U0,V0")  # fmt: skip
    parser.add_argument("--unit", type=float, metavar="MM", help="of a pixel's value (default: 1, sr305 0.125)")
    parser.add_argument("--center", type=_center, metavar="U,V[,D]", action="append",
                        help="px, px, mm: middle of the hand, once for all frames or once for each")  # fmt: skip
    parser.add_argument("--refine", type=natural, default=3, metavar="N",
                        help="move the crop to the predicted palm so often (default: %(default)s)")  # fmt: skip
    parser.add_argument("--mirror", action="store_true", help="the other hand: mirror the image, and the joints back")
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


def _camera(text: str) -> Camera:
    """A camera by name, or by its four numbers; its image size is that of the first frame."""
    if text in CAMERAS:
        return CAMERAS[text]
    try:
        fx, fy, u0, v0 = (float(word) for word in text.split(","))
        if min(fx, fy) > 0 and np.isfinite([fx, fy, u0, v0]).all():
            return Camera("own", fx, fy, u0, v0, 0, 0)
    except ValueError:
        pass
    raise argparse.ArgumentTypeError(f"expected {', '.join(CAMERAS)} or FX,FY,U0,V0 in px, found {text!r}")


def _center(text: str) -> tuple[float, ...]:
    try:
        numbers = tuple(float(word) for word in text.split(","))
        if len(numbers) in (2, 3) and np.isfinite(numbers).all():
            return numbers
    except ValueError:
        pass
    raise argparse.ArgumentTypeError(f"expected U,V or U,V,D (px, px, mm), found {text!r}")


def run(args: argparse.Namespace) -> int:
    """Predict as the parsed arguments say."""
    net = Net(args.model, args.snapshot, netlib.TEST)
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
    targets = _targets(args.images, out)
    names = predictor.skeleton.joint_names
    results = []
    for image, depth, center in zip(args.images, depths, centers):
        found = predictor.in_crop(depth) if args.camera is None else _in_frame(predictor, depth, center, image)
        _draw(targets[image], found, predictor)
        facts = {}
        if isinstance(found, FramePrediction):
            facts = {"center_uvd": found.center_uvd.round(2).tolist(), "center_mm": found.center_mm.round(2).tolist()}
        results.append({"image": image, "picture": str(targets[image]), "cube_mm": args.cube, **facts,
                        "joints_mm": dict(zip(names, found.joints_mm.round(2).tolist()))})  # fmt: skip
        if not args.json:
            where = "" if not facts else " at {:.0f}, {:.0f}, {:.0f} mm".format(*facts["center_mm"])
            print(f"{image}: joints in mm from the crop's centre{where}, cube {args.cube:g} mm; "
                  f"picture {targets[image]}")  # fmt: skip
            for name, (x, y, z) in zip(names, found.joints_mm):
                print(f"  {name:<14}{x:9.1f}{y:9.1f}{z:9.1f}")
    if args.json:
        print(json.dumps(results, indent=2))
    return DONE


def _in_frame(
    predictor: Predictor, depth: NDArray[np.float32], center: tuple[float, ...] | None, image: str
) -> FramePrediction:
    """The hand in a frame; an error names the image, and says what to do."""
    try:
        start = predictor.start(depth, center)
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


def _targets(images: list[str], out: Path) -> dict[str, Path]:
    """Where each picture goes. Raises NetlibError rather than write over an input, or two to one place."""
    inputs = {Path(image).resolve() for image in images}
    targets: dict[str, Path] = {}
    for image in images:
        target = out / f"{Path(image).stem}_hand.png"
        if target in targets.values() and image not in targets:
            raise NetlibError(f"{image}: its picture {target} would overwrite another's; run once for each folder")
        if target.resolve() in inputs:
            raise NetlibError(f"{image}: its picture {target} would overwrite an input; choose another --out")
        targets[image] = target
    return targets


if __name__ == "__main__":
    sys.exit(main())
