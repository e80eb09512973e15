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
import dataclasses
import json
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import netlib  # before NumPy: it chooses BLAS kernels

# isort: split

import cv2
import numpy as np
from numpy.typing import NDArray

from handpose import detect, draw
from handpose.camera import CAMERAS, Camera
from handpose.crop import SIZE
from handpose.crop import crop as crop_frame
from handpose.evaluation import hand_layer
from handpose.nyu import CUBE_MM, read_nyu_depth
from layers.hand_model import HandModel
from netlib.errors import DataError, NetlibError, reason_of
from netlib.net import Net
from tools import pictures
from tools.console import DONE, guarded, natural

LARGEST_MOVE_MM = 60.0  # of the crop, from where it was first

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
        raise NetlibError(f"{out}: cannot write pictures there: {reason_of(error)}") from error
    predictor = Predictor(net, hand, args.cube, args.mirror)
    results = []
    if args.camera is None:
        work = [(image, read_crop(image), None) for image in args.images]
    else:
        given = args.center or [None]
        centers = given if len(given) > 1 else given * len(args.images)
        work = [
            (image, read_frame(image, args.camera, args.unit), center) for image, center in zip(args.images, centers)
        ]
    targets = _targets(args.images, out)
    for image, depth, center in work:
        picture, facts = targets[image], {}
        if args.camera is None:
            crop, joints = depth, predictor.joints(depth)
            drawn = draw.overlay(crop, joints, hand.skeleton)
        else:
            camera = dataclasses.replace(args.camera, width=depth.shape[1], height=depth.shape[0])
            uvd = _started(depth, camera, center, image)
            try:
                crop, uvd, joints = predictor.in_frame(depth, camera, uvd, args.refine)
            except DataError as error:
                raise DataError(f"{image}: {error}") from None
            facts = {"center_uvd": uvd.round(2).tolist(), "center_mm": camera.unproject(uvd).round(2).tolist()}
            drawn = draw.overlay(crop, joints, hand.skeleton, center_uvd=uvd, cube_mm=args.cube, camera=camera)
        pictures.write_image(picture, draw.sheet([drawn, draw.view_3d(joints, hand.skeleton)], 2))
        mm = joints * args.cube / 2
        results.append({"image": image, "picture": str(picture), "cube_mm": args.cube, **facts,
                        "joints_mm": dict(zip(hand.skeleton.joint_names, mm.round(2).tolist()))})  # fmt: skip
        if not args.json:
            where = "" if not facts else " at {:.0f}, {:.0f}, {:.0f} mm".format(*facts["center_mm"])
            print(f"{image}: joints in mm from the crop's centre{where}, cube {args.cube:g} mm; picture {picture}")
            for name, (x, y, z) in zip(hand.skeleton.joint_names, mm):
                print(f"  {name:<14}{x:9.1f}{y:9.1f}{z:9.1f}")
    if args.json:
        print(json.dumps(results, indent=2))
    return DONE


class Predictor:
    """A net with what it takes to use it on crops and on frames."""

    def __init__(self, net: Net, hand: HandModel, cube_mm: float, mirror: bool) -> None:
        self.net, self.hand, self.cube_mm, self.mirror = net, hand, cube_mm, mirror

    def joints(self, crop: NDArray[np.float32]) -> NDArray[np.float64]:
        """The joints (K, 3) in half-cubes of a crop (128, 128)."""
        seen = np.ascontiguousarray(crop[:, ::-1]) if self.mirror else crop
        joints = self.net.forward(depth=seen[None, None])["pred"].reshape(-1, 3).astype(np.float64)
        if not np.isfinite(joints).all():
            raise NetlibError(f"{self.net.source}: predicts joints that are not finite; are its weights?")
        return joints * (-1, 1, 1) if self.mirror else joints

    def in_frame(
        self, depth: NDArray[np.float32], camera: Camera, center_uvd: NDArray[np.float64], refine: int
    ) -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.float64]]:
        """Crop, its centre (3,) and the joints in it, after the crop was moved ``refine`` times."""
        start = camera.unproject(center_uvd)
        crop = crop_frame(depth, center_uvd, self.cube_mm, camera)
        joints = self.joints(crop)
        for _ in range(refine):
            inputs = self.net.blobs[self.hand.spec.bottom[0]].data[0]
            moved = detect.recenter(inputs, self.hand.skeleton, center_uvd, self.cube_mm, camera, self.mirror)
            far = np.linalg.norm(camera.unproject(moved) - start)
            if not (far < LARGEST_MOVE_MM and moved[2] > self.cube_mm / 2):
                break  # a prediction gone astray
            try:
                crop = crop_frame(depth, moved, self.cube_mm, camera)
            except DataError:  # out of sight
                break
            center_uvd, joints = moved, self.joints(crop)
        return crop, center_uvd, joints


def _started(
    depth: NDArray[np.float32], camera: Camera, center: tuple[float, ...] | None, image: str
) -> NDArray[np.float64]:
    """Where to look first: u, v px and d mm."""
    try:
        if center is None:
            return detect.find_hand(depth, camera)
        if len(center) == 3:
            return np.array(center)
        return detect.depth_around(depth, center[0], center[1])
    except DataError as error:
        raise DataError(f"{image}: {error}; say with --center U,V,D where the hand is") from None


def read_frame(path: str, camera: Camera, unit: float | None) -> NDArray[np.float32]:
    """A whole depth frame (height, width) in mm. Raises DataError."""
    image = _decode(path)
    if image.ndim == 3 and image.dtype == np.uint8 and camera.name == "nyu":
        depth = read_nyu_depth(path) * np.float32(unit or 1.0)
    elif image.ndim == 2 and image.dtype == np.uint16:
        depth = image.astype(np.float32) * np.float32(unit or (0.125 if camera.name == "sr305" else 1.0))
    else:
        raise DataError(f"{path}: found {image.dtype} {image.shape}; expected a 16-bit grey PNG of depth")
    if camera.width and depth.shape != (camera.height, camera.width):
        raise DataError(f"{path}: {depth.shape[1]} x {depth.shape[0]} pixels; "
                        f"camera {camera.name} has {camera.width} x {camera.height}")  # fmt: skip
    return depth


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
    image = _decode(path)
    if image.ndim == 3:
        image = image[..., 0] if np.ptp(image[..., :3], axis=2).max() == 0 else image
    if image.dtype != np.uint8 or image.ndim != 2:
        raise DataError(f"{path}: found {image.dtype} {image.shape}; expected an 8-bit grey picture of normalised "
                        "depth (for a whole depth frame name its --camera)")  # fmt: skip
    if image.shape[0] != image.shape[1]:
        raise DataError(f"{path}: {image.shape[1]} x {image.shape[0]} pixels; expected a square crop")
    if image.shape != (SIZE, SIZE):
        image = cv2.resize(image, (SIZE, SIZE), interpolation=cv2.INTER_NEAREST)
    return (image / np.float32(127.5) - 1).astype(np.float32)


def _decode(path: str) -> NDArray[Any]:
    try:
        raw = np.fromfile(path, dtype=np.uint8)
    except OSError as error:
        raise DataError(f"{path}: cannot read the picture: {reason_of(error)}") from error
    try:
        image = cv2.imdecode(raw, cv2.IMREAD_UNCHANGED) if raw.size else None
    except cv2.error as error:
        raise DataError(f"{path}: not a picture that can be read: {str(error).splitlines()[0]}") from error
    if image is None:
        raise DataError(f"{path}: not a picture that can be read; expected a grey PNG")
    return image


if __name__ == "__main__":
    sys.exit(main())
