"""Synthetic recordings of moving hands, with the truth of every frame.

recording = SyntheticRecording("minute", KINECT2, rate=30, seed=1)
for frame in recording: ...            # like any recording, and the same every time
recording.truth(frame.number)          # the true hands

A hand is visible if nine of ten of its joints are in the image, and lost if at most one of ten is.
Otherwise it is ``PARTLY`` visible, and not scored. Of two hands each keeps to its half of the
image, so none hides the other.

Hands, surroundings and the levels of the sensor's errors depend on the seed; the errors of a frame
also on its number. Rate and length of a recording do not change the movement. A frame of 640 x 480
pixels takes 10 to 35 ms on one core, most of it for the sensor's errors.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from handpose.body.capsules import Capsules, in_front, joined
from handpose.body.nyu import CUBE_MM
from handpose.body.render import render
from handpose.body.sides import Side
from handpose.frames.cameras import NYU, UNIT_MM, Camera, Floats, View
from handpose.frames.recording import DepthFrame, Recording
from handpose.sequences.acts import Act, Actor, Volume
from handpose.sequences.movements import Movement, Person
from handpose.synthetic import prior_file
from handpose.synthetic.pose_prior import BodySampler
from handpose.synthetic.prior_parameters import PoseParameter, PosePrior
from handpose.synthetic.sensor import sense, sensor_of
from handpose.tracking.track import LEFT, PARTLY, TrackedFrame, TrackedHand, TrackHeader
from netlib.blob import Array
from netlib.errors import DataError


@dataclass(frozen=True)
class Script:
    """The script of a recording of one person.

    seconds  default length
    acts     of each hand, repeated until the recording ends; ids count the hands in this order
    body     True if the body is visible behind the hands, False for arms only
    poses    replace those of the prior file with the same names
    """

    seconds: float
    acts: dict[Side, tuple[Act, ...]]
    body: bool = False
    poses: tuple[PoseParameter, ...] = ()


_LIVELY = (
    Act("moving", 6),
    Act("rest", 1.5),
    Act("gestures", 6),
    Act("wave", 2.5),
    Act("rest", 1.5),
)
SCRIPTS = {
    "rest": Script(10, {"right": (Act("rest", 10),)}),
    "gestures": Script(20, {"right": (Act("gestures", 16), Act("wave", 3), Act("rest", 1.5))}),
    "moving": Script(20, {"right": (Act("rest", 1.5), Act("moving", 18.5))}),
    "leaves": Script(20, {"right": (Act("moving", 4), Act("away", 3.5), Act("gestures", 3))}),
    "two_hands": Script(20, {"right": _LIVELY, "left": (*_LIVELY[2:], *_LIVELY[:2])}),
    "left": Script(20, {"left": _LIVELY}),
    "body": Script(20, {"right": _LIVELY}, body=True),
    "minute": Script(
        60,
        {
            "right": (
                Act("rest", 2),
                Act("gestures", 10),
                Act("moving", 11),
                Act("away", 4),
                *_LIVELY,
                *_LIVELY,
            ),
            "left": (Act("away", 30), *_LIVELY, Act("away", 20)),
        },
        body=True,
    ),
}
OTHER_SIDE: dict[Side, Side] = {"right": "left", "left": "right"}

# Head, neck, shoulders, trunk: from, to, both radii; mm from the middle between the shoulders.
BODY = np.array(
    [
        (0, 180, 20, 0, 260, 10, 85, 95),
        (0, 40, 20, 0, 180, 20, 60, 60),
        (-150, -20, 0, 150, -20, 0, 70, 70),
        (0, -90, 0, 0, -420, 0, 150, 160),
    ],
    np.float64,
)
NOWHERE_MM = 1e4  # beyond the range of any camera
BEHIND_MM = 300.0  # from the farthest place of a hand to the middle between the shoulders
SHOULDER_MM = 170.0  # from that middle
BODY_FAR = 700.0  # mm: maximum distance of hands in front of a body
# share of the joints in the image: visible from the first on, lost up to the second
MOSTLY, HARDLY = 0.9, 0.1
# Streams of random numbers, one for each purpose.
PERSON_STREAM, HANDS_STREAM, SURROUNDINGS_STREAM, FAULTS_STREAM, FRAMES_STREAM = range(5)


def draw_surroundings(
    rng: np.random.Generator, camera: Camera, farthest: float, body: bool
) -> tuple[Floats, Array]:
    """A wall, beyond the range of half of the cameras, and a body in front of it or none.

    Returns the image (height, width) in mm, with ``NOWHERE_MM`` for no reading, and the middle (3,)
    between the shoulders.

    farthest  depth in mm that the middles of hands do not exceed
    """
    middle = np.array([rng.uniform(-60, 60), rng.uniform(-120, 40), farthest + BEHIND_MM])
    wall = rng.uniform(middle[2] + 300, middle[2] + 1500)
    image = np.full(
        (camera.height, camera.width), wall if rng.random() < 0.5 else NOWHERE_MM, dtype=np.float32
    )
    if body:
        parts = BODY[None]
        a, b = parts[..., :3], parts[..., 3:6]
        whole = Capsules(a, b, parts[..., 6], parts[..., 7])
        shown = in_front(whole.moved(middle))
        np.minimum(image, render_image(shown, camera, np.inf)[0], out=image)
    return image, middle


def render_image(capsules: Capsules, camera: Camera = NYU, background: float = np.inf) -> Floats:
    """Whole images (N, height, width) in mm; ``background`` where there is no capsule."""
    count = len(capsules.a)
    x = np.tile((np.arange(camera.width) - camera.u0) / camera.fx, (count, 1))
    y = np.tile((np.arange(camera.height) - camera.v0) / camera.fy, (count, 1))
    return render(capsules, x, y, np.full(count, background))


MAX_IMAGE_PX = 1 << 14  # pixels either way, as in a camera.json


def _sized(camera: Camera | View) -> Camera:
    """The camera with a size (``SyntheticRecording``). Raises DataError for images too large."""
    if isinstance(camera, View):
        camera = camera.at(640, 480)
    elif not camera.width:
        camera = replace(camera, width=round(2 * camera.u0), height=round(2 * camera.v0))
    if not (0 < camera.width <= MAX_IMAGE_PX and 0 < camera.height <= MAX_IMAGE_PX):
        raise DataError(
            f"camera {camera.name}: images of {camera.width} x {camera.height} pixels; expected 1 to "
            f"{MAX_IMAGE_PX} each way (u0 and v0 are taken for half of it)"
        )
    return camera


def _prior_of(script: Script) -> PosePrior:
    """The poses of a script's hands, whose palms or backs mostly face the camera."""
    prior = prior_file.load(prior_file.PEOPLE_PRIOR).turned("palm_rot_z", any=0.0)
    prior = prior.turned("palm_rot_x", any=None, most=85.0).turned("palm_rot_y", any=0.1)
    own = [pose.name for pose in script.poses]
    others = (pose for pose in prior.pose if pose.name not in own)
    return prior.but(pose=(*others, *script.poses))


class SyntheticRecording(Recording):
    """A script recorded by a camera.

    script    or the name of one of ``SCRIPTS``
    camera    without a size, the principal point is the middle of the image; a model
              has 640 x 480 px
    rate      frames per second
    seconds   length; by default the script's
    clean     without the errors of the camera's sensor, whose levels are drawn once
    mirrored  exchange left and right hands

    Raises DataError.
    """

    count: int
    rate: float

    def __init__(
        self,
        script: Script | str,
        camera: Camera | View = NYU,
        *,
        rate: float = 30.0,
        seconds: float | None = None,
        seed: int = 0,
        clean: bool = False,
        mirrored: bool = False,
    ) -> None:
        self.script = SCRIPTS[script] if isinstance(script, str) else script
        if mirrored:
            self.script = replace(
                self.script,
                acts={OTHER_SIDE[side]: acts for side, acts in self.script.acts.items()},
            )
        self.name = f"synthetic {script if isinstance(script, str) else 'script'}, seed {seed}"
        length = self.script.seconds if seconds is None else seconds
        self.camera, self.rate, self.seed = _sized(camera), rate, seed
        self.count = max(1, round(length * rate))
        self.unit_mm = UNIT_MM.get(camera.name, 1.0)
        sensor = sensor_of(self.camera)
        self.sensor = None if clean else sensor.settled(self._numbers(FAULTS_STREAM))
        self.sampler = BodySampler(_prior_of(self.script))
        self.person = Person.draw(self._numbers(PERSON_STREAM, 0), self.sampler)
        volumes = [self._volume(side) for side in self.script.acts]
        self.movements: list[Movement] = []
        for n, ((side, acts), (volume, outward)) in enumerate(
            zip(self.script.acts.items(), volumes)
        ):
            actor = Actor(
                self._numbers(HANDS_STREAM, n), self.sampler, self.person, side, volume, outward
            )
            self.movements.append(actor.act(acts, length))
        farthest = max(volume.far for volume, _ in volumes)
        self._behind, self._middle = draw_surroundings(
            self._numbers(SURROUNDINGS_STREAM), self.camera, farthest, self.script.body
        )
        self._unseen = functools.cache(self._unseen_at)

    # ------------------------------------------------------------------------------------ the scene

    def _volume(self, side: Side) -> tuple[Volume, float]:
        """The volume in which a hand moves, and the side of its elbow; the person
        faces the camera.
        """
        volume = Volume(self.camera, far=BODY_FAR) if self.script.body else Volume(self.camera)
        if len(self.script.acts) == 1:
            return volume.roomy(), 0.0
        if side == "right":
            return volume._replace(right=0.5).roomy(), -1.0
        return volume._replace(left=0.5).roomy(), 1.0

    def _depth(self, time: float) -> Floats:
        """The depth (height, width) in mm at a time in s without errors; ``NOWHERE_MM``
        without a reading.
        """
        layers, arms, limbs = [self._behind], [], self.sampler.surface.limbs
        for movement in self.movements:
            surface = movement.pose_at(time).capsules
            assert surface is not None
            layers.append(
                render_image(in_front(surface.chosen(~limbs)), self.camera, NOWHERE_MM)[0]
            )
            forearm = surface.chosen(limbs)
            arms += [
                forearm,
                self.person.worn(surface),
                self._upper_arm(forearm.b[:, -1:], movement.side),
            ]
        layers.append(render_image(in_front(joined(arms)), self.camera, NOWHERE_MM)[0])
        return np.minimum.reduce(layers)

    def _upper_arm(self, elbow: Array, side: Side) -> Capsules:
        """The capsule (1, 1) from an elbow (1, 1, 3) to the shoulder of the person, who
        faces the camera.
        """
        shoulder = self._middle + (-SHOULDER_MM if side == "right" else SHOULDER_MM, -20.0, 0.0)
        return Capsules(elbow, shoulder[None, None], np.array([[40.0]]), np.array([[55.0]]))

    # ----------------------------------------------------------------------------------- the frames

    def __iter__(self) -> Iterator[DepthFrame]:
        return (self.frame(number) for number in range(self.count))

    def frame(self, number: int) -> DepthFrame:
        """Frame ``number``, the same at every call, in whole units as in a file."""
        depth = self._depth(number / self.rate)
        if self.sensor:
            far = np.array([NOWHERE_MM])
            faults = self._numbers(FRAMES_STREAM, number)
            depth = sense(faults, depth[None], far, self.sensor, self.camera)[0]
        unit = np.float32(self.unit_mm)
        read = np.where(depth < NOWHERE_MM, np.rint(depth / unit) * unit, np.float32(0))
        return DepthFrame(number, number / self.rate, read)

    # ------------------------------------------------------------------------------------ the truth

    @property
    def header(self) -> TrackHeader:
        """The header of the truth."""
        return TrackHeader(
            self.name, self.camera, self.sampler.skeleton, CUBE_MM / 2, smoothed=False
        )

    def truths(self) -> Iterator[TrackedFrame]:
        """The truth of each frame."""
        return (self.truth(number) for number in range(self.count))

    def truth(self, number: int) -> TrackedFrame:
        """The true hands of frame ``number``: confidence 1, error 0; ids count the hands
        of the script.

        A hand that was never visible is not listed, unless it is partly visible.
        """
        time = number / self.rate
        every = []
        for id, movement in enumerate(self.movements):
            unseen = self._unseen(id, number)
            if not unseen:
                every.append(TrackedHand(id, movement.side, 1.0, 0.0, movement.pose_at(time)))
                continue
            before = range(number - 1, -1, -1)
            last = next((n / self.rate for n in before if not self._unseen(id, n)), None)
            if last is not None or unseen == PARTLY:
                since = time if last is None else last
                every.append(TrackedHand(id, movement.side, reason=unseen, since=since))
        return TrackedFrame(number, time, tuple(every))

    def _unseen_at(self, id: int, number: int) -> str:
        """The reason why a hand is not visible in frame ``number``, or empty."""
        u, v, _ = self.camera.project(self.movements[id].pose_at(number / self.rate).xyz).T
        width, height = self.camera.width, self.camera.height
        in_width = (u > 0) & (u < width - 1)
        in_height = (v > 0) & (v < height - 1)
        inside = (in_width & in_height).mean()
        return LEFT if inside <= HARDLY else "" if inside >= MOSTLY else PARTLY

    def _numbers(self, *what: int) -> np.random.Generator:
        """The random generator of one purpose."""
        return np.random.Generator(np.random.SFC64(np.random.SeedSequence([self.seed, *what])))
