"""The scene of a script at any time: hands, arms, surroundings, and the visibility of the hands."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from handpose.body.render import Floats, in_front, joined
from handpose.frames.cameras import Camera
from handpose.sequences.acts import Actor
from handpose.sequences.movements import HandPose, Movement
from handpose.sequences.person import Person
from handpose.sequences.scripts import Script
from handpose.sequences.surroundings import NOWHERE_MM, Volume, draw_desk, draw_surroundings
from handpose.synthetic import prior_file
from handpose.synthetic.pose_prior import BodySampler
from handpose.synthetic.scenes import render_image
from handpose.tracking.track import HIDDEN, LEFT, PARTLY

BODY_FAR = 700.0  # mm: maximum distance of hands in front of a body
MOSTLY, HARDLY = 0.9, 0.1  # share of the joints in the image: visible from the first on, lost up to the second
SEEN, COVERED = 0.5, 0.05  # share of the surface that is not hidden: visible from the first on, hidden below the second
PEOPLE, HANDS, SURROUNDINGS = range(3)  # purposes of random numbers

Numbers = Callable[..., np.random.Generator]


class Shot(NamedTuple):
    """The scene at one time.

    depth    (height, width) mm, ``NOWHERE_MM`` without a reading, without the sensor's errors
    poses    of each role
    unseen   of each role: the reason why it is not visible, or empty
    """

    depth: Floats
    poses: list[HandPose]
    unseen: list[str]


class Stage:
    """A script in front of a camera, for ``seconds``.

    numbers  the random generator of a purpose, given by whole numbers from ``PEOPLE`` to ``SURROUNDINGS``
    """

    def __init__(self, script: Script, camera: Camera, seconds: float, numbers: Numbers) -> None:
        self.script, self.camera = script, camera
        # Palm or back mostly face the camera
        prior = prior_file.load(prior_file.PEOPLE_PRIOR).turned("palm_rot_z", any=0.0)
        prior = prior.turned("palm_rot_x", any=None, most=85.0).turned("palm_rot_y", any=0.1)
        others = [pose for pose in prior.pose if pose.name not in [own.name for own in script.poses]]
        prior = prior.but(pose=(*others, *script.poses)) if script.poses else prior
        self.sampler = BodySampler(prior)
        who = {role.person for role in script.roles}
        self.people = {person: Person.draw(numbers(PEOPLE, person), self.sampler) for person in who}
        volumes = [self._volume(n) for n in range(len(script.roles))]
        self.movements: list[Movement] = []
        for n, (role, (volume, outward)) in enumerate(zip(script.roles, volumes)):
            person = self.people[role.person]
            actor = Actor(numbers(HANDS, n), self.sampler, person, role.side, volume, outward)
            self.movements.append(actor.act(role.acts, seconds))
        farthest = max(volume.far for volume, _ in volumes)
        self.surroundings = (
            draw_desk(numbers(SURROUNDINGS), camera, farthest)
            if script.desk
            else draw_surroundings(numbers(SURROUNDINGS), camera, farthest, script.body)
        )

    def _volume(self, n: int) -> tuple[Volume, float]:
        """The volume in which a role's hand moves, and the side of its elbow; people face the camera."""
        roles, own = self.script.roles, self.script.roles[n].side
        volume = Volume(self.camera, far=BODY_FAR) if self.script.body or self.script.desk else Volume(self.camera)
        if not self.script.apart or len(roles) == 1:
            return volume.roomy(), 0.0
        first = own == "right" if len({role.side for role in roles}) > 1 else n == 0
        volume = volume._replace(left=0.0 if first else 0.5, right=0.5 if first else 1.0)
        return volume.roomy(), -1.0 if first else 1.0

    def shot(self, time: float) -> Shot:
        """The scene at a time in s."""
        poses = [movement.pose_at(time) for movement in self.movements]
        limbs = self.sampler.surface.limbs
        hands, arms = [], []
        for role, pose in zip(self.script.roles, poses):
            hands.append(pose.capsules.chosen(~limbs))
            forearm = pose.capsules.chosen(limbs)
            upper_arm = self.surroundings.upper_arm(forearm.b[0, -1], role.side, role.person)
            arms += [forearm, self.people[role.person].worn(pose.capsules), upper_arm]
        layers = np.concatenate([render_image(in_front(hand), self.camera, np.inf) for hand in hands])
        everything = in_front(joined(arms))
        depth = np.minimum(self.surroundings.image, render_image(everything, self.camera, NOWHERE_MM)[0])
        np.minimum(depth, layers.min(axis=0), out=depth)
        return Shot(depth, poses, [self._unseen(pose, layer, depth) for pose, layer in zip(poses, layers)])

    def _unseen(self, pose: HandPose, layer: Floats, depth: Floats) -> str:
        """The reason why a hand with the rendering ``layer`` is not visible, or empty."""
        u, v, _ = self.camera.project(pose.xyz).T
        inside = ((u > 0) & (u < self.camera.width - 1) & (v > 0) & (v < self.camera.height - 1)).mean()
        shown = np.isfinite(layer)
        if inside <= HARDLY or not shown.any():
            return LEFT
        seen = (depth >= layer)[shown].mean()
        if seen < COVERED:
            return HIDDEN
        return "" if inside >= MOSTLY and seen >= SEEN else PARTLY
