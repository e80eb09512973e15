"""Tracks in Rerun's viewer (https://rerun.io), live or as an .rrd file. Needs rerun-sdk (extra ``viewer``).

with RerunView(header) as view:       # opens the viewer; RerunView(header, Path("track.rrd")) writes a file
    view.log(depth, frame)            # TrackedFrame

Rerun's axes are right-handed, those of this project are left-handed (x right, y UP, z away). So y is turned round: the
world is Rerun's RDF (x right, y DOWN, z forward), with the camera at its origin, in metres. This only renames the axes:
points are not mirrored, and a right hand stays a right hand.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from handpose.body.render import Capsules
from handpose.frames.crops import check_size
from handpose.output.drawing.hands import bones, colours
from handpose.output.drawing.labels import colour_of
from handpose.output.drawing.surface import SKIN
from handpose.tracking.track import TrackedFrame, TrackedHand, TrackHeader
from netlib.blob import Array
from netlib.errors import NetlibError
from netlib.files import atomic

FROM_MM = np.array([1.0, -1.0, 1.0]) / 1000  # mm, y up, to metres, y down
SHOWN_MM = (200.0, 3000.0)  # the depths from one end of the colours to the other
BONE_M, JOINT_M = 0.0025, 0.004  # radii
_CAMERA, _HANDS, _CONFIDENCE, _LOST = "world/camera", "world/hands", "confidence", "lost"  # entities
_SURFACE = (*SKIN[::-1], 50)  # red, green, blue, opacity


class RerunView:
    """Shows the frames of one track, in the order of time, in a viewer or a file.

    The complete file appears at the end of the block, also after an exception or Ctrl-C.

    path  ends in ".rrd"; None opens the viewer

    Raises NetlibError without rerun-sdk, for another extension, and if the viewer does not start.
    """

    def __init__(self, header: TrackHeader, path: Path | None = None) -> None:
        if path is not None and path.suffix.lower() != ".rrd":
            raise NetlibError(f"{path}: a recording for Rerun is written as .rrd; expected such a name")
        self.header, self.path = header, path
        self._rr = _package()
        self._bones = bones(header.skeleton)
        self._colours = [colour[::-1] for colour in colours(header.skeleton)]
        self._shown: set[int] = set()
        self._stack = contextlib.ExitStack()

    def __enter__(self) -> RerunView:
        rr, camera = self._rr, self.header.camera
        self._stream = rr.RecordingStream("handpose")
        with contextlib.ExitStack() as stack:
            if self.path is None:
                self._spawn()
            else:
                self._stream.save(str(stack.enter_context(atomic.replacing(self.path))))
            self._stack = stack.pop_all()
        self._stream.send_blueprint(self._layout())
        pinhole = rr.Pinhole(
            focal_length=(camera.fx, camera.fy),
            principal_point=(camera.u0 + 0.5, camera.v0 + 0.5),  # Rerun counts from the corner of the first pixel
            resolution=(camera.width, camera.height),
            camera_xyz=rr.ViewCoordinates.RDF,
        )
        self._stream.log("world", rr.ViewCoordinates.RDF, static=True)
        self._stream.log(_CAMERA, pinhole, static=True)
        return self

    def log(self, depth: NDArray[np.floating], frame: TrackedFrame) -> None:
        """Show one frame. ``depth`` in mm, 0 where nothing was read. Raises DataError for one of another size."""
        check_size(depth, self.header.camera)
        self._stream.set_time("time", duration=frame.time)
        self._stream.set_time("frame", sequence=frame.number)
        stored = np.rint(np.clip(depth, 0, np.iinfo(np.uint16).max)).astype(np.uint16)
        image = self._rr.DepthImage(stored, meter=1000.0, depth_range=SHOWN_MM, colormap="magma")
        self._stream.log(f"{_CAMERA}/depth", image)
        for hand in frame.hands:
            self._hand(hand)
        seen = {hand.id for hand in frame.hands}
        for id in self._shown - seen:
            self._stream.log(f"{_HANDS}/{id}", self._rr.Clear(recursive=True))
            self._stream.log(f"{_CONFIDENCE}/{id}", self._rr.Clear(recursive=True))
        for lost in frame.lost:
            if lost.id in self._shown - seen:
                words, colour = (
                    f"{lost.side_name} hand {lost.id} lost: {lost.reason}",
                    colour_of(lost.id)[::-1],
                )
                self._stream.log(_LOST, self._rr.TextLog(words, level="WARN", color=colour))
        self._shown = seen

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        with self._stack:
            self._stream.flush()
            self._stream.disconnect()

    def _spawn(self) -> None:
        try:
            self._stream.spawn()
        except RuntimeError as error:
            raise NetlibError(f"Rerun's viewer does not start: {error}; write a file instead (.rrd)") from error

    def _layout(self) -> Any:
        """Space on the left; on the right the camera's view with the hands on it, their confidences, and losses."""
        views = self._rr.blueprint
        confidence = views.TimeSeriesView(origin=_CONFIDENCE, axis_y=views.ScalarAxis(range=(0.0, 1.0)))
        camera = views.Spatial2DView(origin=_CAMERA, contents="world/**")
        panel = views.Vertical(camera, confidence, views.TextLogView(origin=_LOST), row_shares=[5, 2, 1])
        space = views.Spatial3DView(origin="world")
        return views.Blueprint(views.Horizontal(space, panel, column_shares=[3, 2]), collapse_panels=True)

    def _hand(self, hand: TrackedHand) -> None:
        """Log joints, bones, surface and confidence."""
        rr, place, points = self._rr, f"{_HANDS}/{hand.id}", hand.xyz * FROM_MM
        self._stream.log(f"{place}/joints", rr.Points3D(points, colors=self._colours, radii=JOINT_M))
        strips = [points[list(bone)] for bone in self._bones]
        own = [self._colours[joint] for _, joint in self._bones]
        self._stream.log(f"{place}/bones", rr.LineStrips3D(strips, colors=own, radii=BONE_M))
        if hand.capsules is not None:
            lengths, radii, starts, turns = capsules_in_rerun(hand.capsules)
            surface = rr.Capsules3D(
                lengths=lengths, radii=radii, translations=starts, quaternions=turns, colors=_SURFACE, fill_mode="solid"
            )
            self._stream.log(f"{place}/flesh", surface)
        if np.isfinite(hand.confidence):
            curve = rr.SeriesLines(colors=colour_of(hand.id)[::-1], names=f"{hand.side_name} {hand.id}")
            self._stream.log(f"{_CONFIDENCE}/{hand.id}", curve, static=True)
            self._stream.log(f"{_CONFIDENCE}/{hand.id}", rr.Scalars(hand.confidence))


def capsules_in_rerun(capsules: Capsules) -> tuple[Array, Array, Array, Array]:
    """Lengths (M,), radii (M,), starts (M, 3) in m, and turns (M, 4) x, y, z, w from the z axis, of one body.

    Rerun's capsules have one radius: the mean of both ends'.
    """
    start, stop = capsules.a[0] * FROM_MM, capsules.b[0] * FROM_MM
    along = stop - start
    lengths = np.linalg.norm(along, axis=1)
    x, y, z = (along / np.maximum(lengths, 1e-9)[:, None]).T
    z = np.where(lengths > 0, z, 1.0)
    turns = np.stack([-y, x, np.zeros_like(x), 1 + z], axis=1)  # halfway between the z axis and this one
    turns[z < -1 + 1e-9] = (1, 0, 0, 0)
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    return lengths, (capsules.radius_a[0] + capsules.radius_b[0]) / 2000, start, turns


def _package() -> ModuleType:
    """Rerun's SDK, imported when it is needed."""
    try:
        import rerun
    except ImportError as error:
        raise NetlibError("rerun-sdk is missing: pip install rerun-sdk") from error
    return rerun
