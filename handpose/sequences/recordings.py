"""Synthetic recordings of moving hands, with the truth of every frame.

recording = SyntheticRecording("minute", KINECT2, rate=30, seed=1)
for frame in recording: ...            # like any recording, and the same every time
recording.truth(frame.number)          # the true hands

A hand is visible if nine of ten of its joints are in the image and at most half of its surface is hidden. It is lost if
at most one of ten joints is in the image, or if its surface is hidden. Otherwise it is ``PARTLY`` visible, and not
scored.

Hands, surroundings and the levels of the sensor's errors depend on the seed; the errors of a frame also on its number.
Rate and length of a recording do not change the movement. A frame of 640 x 480 pixels takes 10 to 35 ms on one core,
most of it for the sensor's errors; its truth alone 5 to 10 ms.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Literal

import numpy as np

from handpose.body.nyu import CUBE_MM
from handpose.frames.cameras import NYU, UNIT_MM, Camera
from handpose.frames.recording import DepthFrame, Recording
from handpose.sequences.scripts import SCRIPTS, Script
from handpose.sequences.stage import SURROUNDINGS, Shot, Stage
from handpose.sequences.surroundings import NOWHERE_MM
from handpose.synthetic.sensor import Sensor, sense, sensor_of
from handpose.tracking.track import PARTLY, LostHand, TrackedFrame, TrackedHand, TrackHeader
from netlib.errors import DataError, did_you_mean

MAX_SECONDS = 36000.0
MAX_IMAGE_PX = 1 << 14  # pixels either way, as in a camera.json
FAULTS, FRAMES = SURROUNDINGS + 1, SURROUNDINGS + 2  # random streams, in addition to those of the scene


class SyntheticRecording(Recording):
    """A script recorded by a camera.

    script    or the name of one of ``SCRIPTS``
    camera    without a size, the principal point is the middle of the image
    rate      frames per second
    seconds   length; by default the script's
    sensor    error model, whose levels are drawn once; None has no errors
    mirrored  exchange left and right hands

    Raises DataError.
    """

    count: int
    rate: float

    def __init__(
        self, script: Script | str, camera: Camera = NYU, *, rate: float = 30.0, seconds: float | None = None,
        seed: int = 0, sensor: Sensor | Literal["camera's"] | None = "camera's", mirrored: bool = False,
    ) -> None:
        if isinstance(script, str) and script not in SCRIPTS:
            raise DataError(f"script {script!r}{did_you_mean(script, SCRIPTS)}; expected one of {', '.join(SCRIPTS)}")
        self.script = SCRIPTS[script] if isinstance(script, str) else script
        if mirrored:
            self.script = self.script.mirrored()
        self.name = f"synthetic {script if isinstance(script, str) else 'script'}, seed {seed}"
        length = self.script.seconds if seconds is None else seconds
        if not (0 < rate < np.inf and 0 < length <= MAX_SECONDS) or seed < 0:
            raise DataError(f"{length:g} s at rate {rate:g}, seed {seed}; expected more than 0 and at most "
                            f"{MAX_SECONDS:g} s, the seed 0 or more")
        if not camera.width:
            camera = replace(camera, width=round(2 * camera.u0), height=round(2 * camera.v0))
        if not (0 < camera.width <= MAX_IMAGE_PX and 0 < camera.height <= MAX_IMAGE_PX):
            raise DataError(f"camera {camera.name}: images of {camera.width} x {camera.height} pixels; expected 1 to "
                            f"{MAX_IMAGE_PX} each way (u0 and v0 are taken for half of it)")
        self.camera, self.rate, self.seed = camera, rate, seed
        self.count = max(1, round(length * rate))
        self.unit_mm = UNIT_MM.get(camera.name, 1.0)
        kind = sensor_of(camera) if isinstance(sensor, str) else sensor
        self.sensor = kind and kind.settled(self._numbers(FAULTS))
        self.stage = Stage(self.script, camera, length, self._numbers)
        self._last: tuple[int, Shot] | None = None
        self._unseen: dict[int, list[str]] = {}

    def __iter__(self) -> Iterator[DepthFrame]:
        return (self.frame(number) for number in range(self.count))

    def frame(self, number: int) -> DepthFrame:
        """Frame ``number``, the same at every call, in whole units as in a file."""
        depth = self.shot(number).depth
        if self.sensor:
            far, faults = np.array([NOWHERE_MM]), self._numbers(FRAMES, number)
            depth = sense(faults, depth[None], far, self.sensor, self.camera)[0]
        unit = np.float32(self.unit_mm)
        read = np.where(depth < NOWHERE_MM, np.rint(depth / unit) * unit, np.float32(0))
        return DepthFrame(number, number / self.rate, read)

    def shot(self, number: int) -> Shot:
        """The scene at the time of frame ``number``."""
        if self._last is None or self._last[0] != number:
            self._last = number, self.stage.shot(number / self.rate)
            self._unseen[number] = self._last[1].unseen
        return self._last[1]

    # ------------------------------------------------------------------------------------------ the truth

    @property
    def header(self) -> TrackHeader:
        """The header of the truth."""
        return TrackHeader(self.name, self.camera, self.stage.sampler.skeleton, CUBE_MM / 2, smoothed=False)

    def truths(self) -> Iterator[TrackedFrame]:
        """The truth of each frame."""
        return (self.truth(number) for number in range(self.count))

    def truth(self, number: int) -> TrackedFrame:
        """The true hands of frame ``number``: confidence 1, error 0; the id of a hand is the number of its role.

        A hand that was never visible is not listed, unless it is partly visible.
        """
        time, hands, lost = number / self.rate, [], []
        shot = self.shot(number)
        for id, (role, pose, unseen) in enumerate(zip(self.script.roles, shot.poses, shot.unseen)):
            if not unseen:
                middle = self.camera.project(pose.origin_mm)
                hands.append(TrackedHand(id, role.side, 1.0, 0.0, *pose[:4], middle, CUBE_MM, pose.capsules))
                continue
            since = self._last_in_sight(id, number)
            if since is not None or unseen == PARTLY:
                lost.append(LostHand(id, role.side, time if since is None else since, unseen))
        return TrackedFrame(number, time, tuple(hands), tuple(lost))

    def _last_in_sight(self, id: int, number: int) -> float | None:
        """The time in s when a hand was last visible before frame ``number``; None for never."""
        for n in range(number - 1, -1, -1):
            if n not in self._unseen:
                self._unseen[n] = self.stage.shot(n / self.rate).unseen
            if not self._unseen[n][id]:
                return n / self.rate
        return None

    def _numbers(self, *what: int) -> np.random.Generator:
        """The random generator of one purpose."""
        return np.random.Generator(np.random.SFC64(np.random.SeedSequence([self.seed, *what])))
