"""Predictor: the joints of a hand in a crop, or in a whole depth frame.

net = netlib.Net("prototxt/nyu_deploy.prototxt", "weights.caffemodel.h5", netlib.TEST)
predictor = Predictor(net, KINECT2)
found = predictor.in_frame(depth)   # depth (424, 512) in mm, 0 where nothing was read
found.xyz                           # (K, 3) mm in camera axes
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from handpose.data.crops import SIZE, crop
from handpose.facts.cameras import NYU, Camera
from handpose.facts.nyu import CUBE_MM
from handpose.predicting import finding
from handpose.predicting.nets import hand_layer
from netlib.blob import Array
from netlib.errors import DataError, NetlibError
from netlib.net import Net

# A crop is moved no farther than this from where it was first. Nine of ten hands are found within 55 mm of their centre
# (finding.py), so a prediction that wants it farther away has gone astray.
LARGEST_MOVE_MM = 60.0


@dataclass(frozen=True)
class Prediction:
    """The hand in one crop.

    joints   (K, 3) half-cubes from the crop centre: x right, y up, z away from the camera
    crop     (128, 128) in [-1, 1], where the hand was seen
    cube_mm  edge of the crop's cube
    """

    joints: Array
    crop: NDArray[np.float32]
    cube_mm: float

    @property
    def joints_mm(self) -> Array:
        """(K, 3) mm from the crop centre."""
        return np.asarray(self.joints * self.cube_mm / 2)


@dataclass(frozen=True)
class FramePrediction(Prediction):
    """The hand in a crop of a whole frame.

    camera      of the frame
    center_uvd  (3,) crop centre in px, px, mm
    """

    camera: Camera
    center_uvd: Array

    @property
    def center_mm(self) -> Array:
        """(3,) crop centre in mm, camera axes."""
        return self.camera.unproject(self.center_uvd)

    @property
    def xyz(self) -> Array:
        """(K, 3) joints in mm, camera axes."""
        return np.asarray(self.center_mm + self.joints_mm)


class Predictor:
    """A net that sees the joints of a hand in a crop, and what it takes to use it on crops and on whole frames.

    net      its input is the blob depth, its joints are the blob pred, which a HandModel computes
    camera   of the frames; one without a size takes frames of any
    cube_mm  edge of the cube around the hand
    mirror   see the other hand: mirror the crop, and the joints back
    refine   how often the crop of a frame is moved to the palm that was predicted in it; 0 for nets whose training
             crops are not centred as NYU's are (ICVL's)

    A net knows the hand of its training data: of NYU and of the synthetic hands a right hand, seen by a camera that
    does not mirror. Raises NetlibError for a net without these blobs or without a HandModel.
    """

    def __init__(
        self, net: Net, camera: Camera = NYU, *, cube_mm: float = CUBE_MM, mirror: bool = False, refine: int = 3
    ) -> None:
        for name in ("depth", "pred"):
            if name not in net.blobs:
                raise NetlibError(
                    f"{net.source}: no blob {name!r}; expected a net with the input depth and the output pred"
                )
        hand = hand_layer(net)
        if hand is None:
            raise NetlibError(f"{net.source}: no HandModel layer, so the skeleton is unknown")
        self.net, self.skeleton, self.camera = net, hand.skeleton, camera
        self.cube_mm, self.mirror, self.refine = cube_mm, mirror, refine

    def in_crop(self, depth: NDArray[np.floating]) -> Prediction:
        """The hand in a crop (128, 128) in [-1, 1]. Raises DataError for another shape, NetlibError."""
        if depth.shape != (SIZE, SIZE):
            raise DataError(f"crop of shape {depth.shape}, expected ({SIZE}, {SIZE})")
        seen = depth.astype(np.float32)
        return Prediction(self._joints(seen), seen, self.cube_mm)

    def in_frame(self, depth: NDArray[np.generic], center: Sequence[float] | Array | None = None) -> FramePrediction:
        """The hand in a depth frame (height, width) in mm, 0 where nothing was read. Raises DataError, NetlibError.

        center  where to look first, as for ``start``
        """
        camera = self._camera_of(depth)
        first = found = self._at(depth, camera, self.start(depth, center))
        for _ in range(self.refine):
            uvd = finding.recenter(found.joints, self.skeleton, found.center_uvd, self.cube_mm, camera, self.mirror)
            far = np.linalg.norm(camera.unproject(uvd) - first.center_mm)
            if not (far < LARGEST_MOVE_MM and uvd[2] > self.cube_mm / 2):
                break  # a prediction gone astray
            try:
                found = self._at(depth, camera, uvd)
            except DataError:  # out of sight
                break
        return found

    def start(self, depth: NDArray[np.generic], center: Sequence[float] | Array | None = None) -> Array:
        """Where to look first: the crop centre (3,), u, v in px and d in mm. Raises DataError.

        center  (u, v, d) is taken as it is; (u, v) gets the depth that is seen there; without it the nearest thing is
                taken for the hand
        """
        if center is None:
            return finding.find_hand(depth, self._camera_of(depth))
        if len(center) == 3:
            return np.array(center, dtype=np.float64)
        return finding.depth_around(depth, center[0], center[1])

    def _at(self, depth: NDArray[np.generic], camera: Camera, center_uvd: Array) -> FramePrediction:
        """The hand in the crop at a centre (3,). Raises DataError if the cube there lies outside the image."""
        seen = crop(depth, center_uvd, self.cube_mm, camera)
        return FramePrediction(self._joints(seen), seen, self.cube_mm, camera, center_uvd)

    def _joints(self, seen: NDArray[np.float32]) -> Array:
        """The joints (K, 3) in half-cubes that the net predicts in a crop."""
        shown = np.ascontiguousarray(seen[:, ::-1]) if self.mirror else seen
        joints = self.net.forward(blobs=["pred"], depth=shown[None, None])["pred"].reshape(-1, 3).astype(np.float64)
        if not np.isfinite(joints).all():
            raise NetlibError(f"{self.net.source}: predicts joints that are not finite; check its weights")
        return np.asarray(joints * (-1, 1, 1) if self.mirror else joints)

    def _camera_of(self, depth: NDArray[np.generic]) -> Camera:
        """The camera, with the frame's size if it has none."""
        if depth.ndim != 2:
            raise DataError(f"depth image of shape {depth.shape}, expected (height, width)")
        if self.camera.width:
            return self.camera
        return dataclasses.replace(self.camera, width=depth.shape[1], height=depth.shape[0])
