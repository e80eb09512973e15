#!/usr/bin/env python3
"""Predict the hand in depth crops: the joints, and a picture with the skeleton on the depth and in space.

    python tools/predict.py snapshots/nyu_iter_1000.caffemodel.h5 crop.png --out pictures

A crop is a square 8-bit picture of normalised depth: value v stands for the depth centre + (v / 127.5 - 1) * cube / 2,
so the hand's centre is mid-grey and the background white. It is resized to 128 x 128 by nearest neighbour.
Joints are printed in mm from the crop's centre (x right, y up, z away), for a cube of --cube mm.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import netlib  # before NumPy: it chooses BLAS kernels

# isort: split

import cv2
import numpy as np
from numpy.typing import NDArray

from handpose import draw
from handpose.crop import SIZE
from handpose.evaluation import hand_layer
from handpose.nyu import CUBE_MM
from netlib.errors import DataError, NetlibError, os_reason
from netlib.net import Net
from tools.console import DONE, guarded

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
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    args = parser.parse_args(argv)
    if not 0 < args.cube < float("inf"):
        parser.error(f"--cube must be more than 0, found {args.cube:g}")
    return guarded(lambda: run(args))


def run(args: argparse.Namespace) -> int:
    """Predict as the parsed arguments say."""
    net = Net(args.model, args.snapshot, netlib.TEST)
    for name in ("depth", "pred"):
        if name not in net.blobs:
            raise NetlibError(
                f"{args.model}: no blob {name!r}; expected a net with the input depth and the output pred"
            )
    hand = hand_layer(net)
    if hand is None:
        raise NetlibError(f"{args.model}: no HandModel layer, so the skeleton to draw is unknown")
    out = Path(args.out)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise NetlibError(f"{out}: cannot write pictures there: {os_reason(error)}") from error
    results = []
    crops = {image: read_crop(image) for image in args.images}
    pictures = _targets(args.images, out)
    for image, crop in crops.items():
        joints = net.forward(depth=crop[None, None])["pred"].reshape(-1, 3).astype(np.float64)
        if not np.isfinite(joints).all():
            raise NetlibError(f"{args.snapshot}: predicts joints that are not finite; are its weights?")
        picture = pictures[image]
        _write(picture, draw.sheet([draw.overlay(crop, joints, hand.skeleton), draw.view_3d(joints, hand.skeleton)], 2))
        mm = joints * args.cube / 2
        results.append({"image": image, "picture": str(picture), "cube_mm": args.cube,
                        "joints_mm": dict(zip(hand.skeleton.joint_names, mm.round(2).tolist()))})  # fmt: skip
        if not args.json:
            print(f"{image}: joints in mm from the crop's centre, cube {args.cube:g} mm; picture {picture}")
            for name, (x, y, z) in zip(hand.skeleton.joint_names, mm):
                print(f"  {name:<14}{x:9.1f}{y:9.1f}{z:9.1f}")
    if args.json:
        print(json.dumps(results, indent=2))
    return DONE


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


def read_crop(path: str) -> NDArray[np.float32]:
    """A crop (128, 128) in [-1, 1]. Raises DataError."""
    try:
        raw = np.fromfile(path, dtype=np.uint8)
    except OSError as error:
        raise DataError(f"{path}: cannot read the picture: {os_reason(error)}") from error
    try:
        image = cv2.imdecode(raw, cv2.IMREAD_UNCHANGED) if raw.size else None
    except cv2.error as error:
        raise DataError(f"{path}: not a picture that can be read: {str(error).splitlines()[0]}") from error
    if image is None:
        raise DataError(f"{path}: not a picture that can be read; expected an 8-bit grey PNG")
    if image.ndim == 3:
        image = image[..., 0] if np.ptp(image[..., :3], axis=2).max() == 0 else image
    if image.dtype != np.uint8 or image.ndim != 2:
        raise DataError(f"{path}: found {image.dtype} {image.shape}; expected an 8-bit grey picture of normalised "
                        "depth (a raw depth frame must be cropped first)")  # fmt: skip
    if image.shape[0] != image.shape[1]:
        raise DataError(f"{path}: {image.shape[1]} x {image.shape[0]} pixels; expected a square crop")
    if image.shape != (SIZE, SIZE):
        image = cv2.resize(image, (SIZE, SIZE), interpolation=cv2.INTER_NEAREST)
    return (image / np.float32(127.5) - 1).astype(np.float32)


def _write(path: Path, image: NDArray[np.uint8]) -> None:
    try:
        path.write_bytes(cv2.imencode(".png", image)[1].tobytes())
    except OSError as error:
        raise NetlibError(f"{path}: cannot write the picture: {os_reason(error)}") from error


if __name__ == "__main__":
    sys.exit(main())
