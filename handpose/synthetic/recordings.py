"""Recordings of hands that move, made up, with all that is to be known of every frame.

recording = SyntheticRecording("minute", KINECT2, rate=30, seed=1)
for frame in recording: ...            # as of any recording, and the same every time
recording.truth(frame.number)          # where the hands are

A hand is told of where most of its joints are in the image and half of its surface is not hidden; it is lost where it
has left, or is hidden. In between it is ``PARTLY`` there, and nobody can say what a tracker should say. Hands, arms and
the sensor's faults depend on the seed; the faults of a frame on its number, too. Rate and length of a recording do not
change the movement.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from handpose.facts.cameras import NYU, UNIT_MM, Camera
from handpose.facts.nyu import CUBE_MM
from handpose.flesh.render import Capsules, Floats, in_front
from handpose.recordings.recording import DepthFrame, Recording
from handpose.synthetic.acts import Actor, Volume
from handpose.synthetic.movements import HandPose, Movement
from handpose.synthetic.person import Person
from handpose.synthetic.pose_prior import HandSampler, PosePrior
from handpose.synthetic.scenes import render_image
from handpose.synthetic.scripts import SCRIPTS, Script
from handpose.synthetic.sensor import CODED_LIGHT, KINECT, TIME_OF_FLIGHT, Sensor, sense
from handpose.synthetic.surroundings import NOWHERE_MM, Surroundings, draw_surroundings
from handpose.tracks.reasons import HIDDEN, LEFT, PARTLY
from handpose.tracks.track import LostHand, TrackedFrame, TrackedHand, TrackHeader
from netlib.errors import DataError, did_you_mean

PRIOR: PosePrior = replace(PosePrior(), roll_uniform=0.0, yaw_uniform=0.1)  # most of the time a palm or a back is seen
SENSORS = {"nyu": KINECT, "sr305": CODED_LIGHT}  # of the cameras; of others time of flight
BODY_FAR = 700.0  # mm: before a body hands stay so near
MOSTLY, HARDLY = 0.9, 0.1  # part of the joints in the image: in sight if more, gone if less
SEEN, COVERED = 0.5, 0.95  # part of the surface that is not hidden: in sight if more; hidden if less than the rest
PEOPLE, HANDS, SURROUNDINGS, FAULTS, FRAMES = range(5)  # what random numbers are for


class Shot(NamedTuple):
    """What there is at one time.

    depth  (height, width) mm, ``NOWHERE_MM`` where nothing is read, without the sensor's faults
    poses  of each role
    states of each role: why it is not in sight, or empty
    """

    depth: Floats
    poses: list[HandPose]
    states: list[str]


class SyntheticRecording(Recording):
    """A script, played before a camera.

    script   or the name of one of ``SCRIPTS``
    camera   one without a size has its principal point in the middle
    rate     frames per second
    seconds  its length; the script's if none is given
    sensor   its faults; None has none; those of the camera if none are given

    Raises DataError.
    """

    count: int
    rate: float

    def __init__(
        self, script: Script | str, camera: Camera = NYU, *, rate: float = 30.0, seconds: float | None = None,
        seed: int = 0, sensor: Sensor | str | None = "the camera's",
    ) -> None:  # fmt: skip
        if isinstance(script, str) and script not in SCRIPTS:
            raise DataError(f"script {script!r}{did_you_mean(script, SCRIPTS)}; expected one of {', '.join(SCRIPTS)}")
        self.script = SCRIPTS[script] if isinstance(script, str) else script
        self.name = f"synthetic {script if isinstance(script, str) else 'script'}, seed {seed}"
        self.seconds = self.script.seconds if seconds is None else seconds
        if not (0 < rate < np.inf and 0 < self.seconds < np.inf) or seed < 0:
            raise DataError(
                f"{self.seconds:g} s at rate {rate:g}, seed {seed}; expected more than 0, the seed 0 or more"
            )
        if not camera.width:
            camera = replace(camera, width=round(2 * camera.u0), height=round(2 * camera.v0))
        self.camera, self.rate, self.seed = camera, rate, seed
        self.count = max(1, round(self.seconds * rate))
        self.unit_mm = UNIT_MM.get(camera.name, 1.0)
        kind = SENSORS.get(camera.name, TIME_OF_FLIGHT) if isinstance(sensor, str) else sensor
        self.sensor = kind and kind.settled(self._numbers(FAULTS))
        self.sampler = HandSampler(PRIOR)
        self.people, self.movements, self.surroundings = self._set_up()
        self._shot: tuple[int, Shot] | None = None
        self._states: dict[int, list[str]] = {}

    def __iter__(self) -> Iterator[DepthFrame]:
        return (self.frame(number) for number in range(self.count))

    def frame(self, number: int) -> DepthFrame:
        """Frame ``number``, the same whenever it is asked for, in whole units as a file would hold it."""
        depth = self.shot(number).depth
        if self.sensor:
            far = np.array([NOWHERE_MM])
            depth = sense(self._numbers(FRAMES, number), depth[None], far, self.sensor, self.camera)[0]
        unit = np.float32(self.unit_mm)
        return DepthFrame(number, number / self.rate, np.where(depth < NOWHERE_MM, np.rint(depth / unit) * unit, 0))

    def shot(self, number: int) -> Shot:
        """What there is at the time of frame ``number``."""
        if self._shot is None or self._shot[0] != number:
            self._shot = number, self._taken(number / self.rate)
            self._states[number] = self._shot[1].states
        return self._shot[1]

    # ------------------------------------------------------------------------------------------ the truth

    @property
    def header(self) -> TrackHeader:
        """What holds for all frames of the truth."""
        return TrackHeader(self.name, self.camera, self.sampler.skeleton, CUBE_MM / 2, smoothed=False)

    def truths(self) -> Iterator[TrackedFrame]:
        """The truth of each frame."""
        return (self.truth(number) for number in range(self.count))

    def truth(self, number: int) -> TrackedFrame:
        """What is to be told of frame ``number``: confidence 1, error 0; an id is the number of a role."""
        shot, hands, lost = self.shot(number), [], []
        for id, (role, pose, state) in enumerate(zip(self.script.roles, shot.poses, shot.states, strict=True)):
            since = None if not state else self._last_in_sight(id, number)
            if not state:
                uvd = self.camera.project(pose.origin_mm)
                hands.append(TrackedHand(id, role.side, 1.0, 0.0, *pose[:4], uvd, CUBE_MM, pose.capsules))
            elif since is not None or state == PARTLY:
                lost.append(LostHand(id, role.side, number / self.rate if since is None else since, state))
        return TrackedFrame(number, number / self.rate, tuple(hands), tuple(lost))

    def _last_in_sight(self, id: int, number: int) -> float | None:
        """When a hand was last in sight, s, before frame ``number``; None for never."""
        for n in range(number - 1, -1, -1):
            if n not in self._states:
                self._states[n] = self._taken(n / self.rate).states
            if not self._states[n][id]:
                return n / self.rate
        return None

    # ------------------------------------------------------------------------------------------ parts

    def _numbers(self, *what: int) -> np.random.Generator:
        """The random numbers for one thing."""
        return np.random.Generator(np.random.SFC64(np.random.SeedSequence([self.seed, *what])))

    def _set_up(self) -> tuple[dict[int, Person], list[Movement], Surroundings]:
        roles, camera = self.script.roles, self.camera
        who = sorted({role.person for role in roles})
        people = {person: Person.draw(self._numbers(PEOPLE, person), self.sampler) for person in who}
        movements, farthest = [], 0.0
        for n, role in enumerate(roles):
            volume = Volume(camera, far=BODY_FAR if self.script.body else Volume(camera).far)
            outward = 0.0
            if self.script.apart and len(roles) > 1:
                first = n == 0
                volume = volume._replace(left=0.0 if first else 0.5, right=0.5 if first else 1.0)
                outward = -1.0 if first else 1.0
            volume = volume.roomy()
            farthest = max(farthest, volume.far)
            actor = Actor(self._numbers(HANDS, n), self.sampler, people[role.person], role.side, volume, outward)
            movements.append(actor.act(role.acts, self.seconds))
        around = draw_surroundings(self._numbers(SURROUNDINGS), camera, farthest, self.script.body)
        return people, movements, around

    def _taken(self, time: float) -> Shot:
        poses = [movement.pose_at(time) for movement in self.movements]
        limbs = self.sampler.flesh.limbs
        hands, arms = [], []
        for role, pose in zip(self.script.roles, poses, strict=True):
            hands.append(Capsules(*(part[:, ~limbs] for part in pose.capsules)))
            arm = Capsules(*(part[:, limbs] for part in pose.capsules))
            upper = self.surroundings.upper_arm(arm.b[0, -1], role.side, role.person)
            arms += [arm, self.people[role.person].worn(pose.capsules), upper]
        layers = render_image(in_front(Capsules(*map(np.concatenate, zip(*hands)))), self.camera, np.inf)
        joined = in_front(Capsules(*(np.concatenate(parts, axis=1) for parts in zip(*arms))))
        depth = np.minimum(self.surroundings.image, render_image(joined, self.camera, NOWHERE_MM)[0])
        np.minimum(depth, layers.min(axis=0), out=depth)
        states = [self._state(pose, layer, depth) for pose, layer in zip(poses, layers, strict=True)]
        return Shot(depth, poses, states)

    def _state(self, pose: HandPose, layer: Floats, depth: Floats) -> str:
        """Why a hand, which alone looks like ``layer``, is not in sight, or empty."""
        u, v, _ = self.camera.project(pose.xyz).T
        inside = ((u > 0) & (u < self.camera.width - 1) & (v > 0) & (v < self.camera.height - 1)).mean()
        if inside <= HARDLY:
            return LEFT
        shown = np.isfinite(layer)
        seen = (depth >= layer)[shown].mean() if shown.any() else 0.0
        if seen < 1 - COVERED:
            return HIDDEN
        return "" if inside >= MOSTLY and seen >= SEEN else PARTLY
