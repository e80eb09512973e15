"""Whole depth images with a hand to find: with its forearm, the body behind it, a table, and other objects."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from handpose.body.nyu import CUBE_MM
from handpose.body.render import Capsules, Floats, in_front, joined, render
from handpose.frames.cameras import NYU, Camera
from handpose.synthetic.pose_prior import BodySampler
from handpose.synthetic.prior_file import NormalParameter, PosePrior, RangeParameter
from handpose.synthetic.recipes import any_roll
from handpose.synthetic.sensor import KINECT, Sensor, sense
from handpose.synthetic.surface_prior import PERSON_SURFACE, draw_capsules
from netlib.blob import Array

KINDS = ("forearm", "body", "clutter")
DEPTH = RangeParameter(450.0, 900.0)
SEEN = 0.5  # minimum visible share of a hand's surface
MIN_INSIDE = 0.9  # minimum share of its joints in the image
ARM_MM = 290.0  # from the elbow to the shoulder
BODY = (  # from, to, both radii; mm from the middle between the shoulders, x towards the other arm's side
    ((0, 180, 20), (0, 260, 10), 85, 95),  # head
    ((0, 40, 20), (0, 180, 20), 60, 60),  # neck
    ((-150, -20, 0), (150, -20, 0), 70, 70),  # shoulders
    ((0, -90, 0), (0, -420, 0), 150, 160),  # trunk
)


def prior_of(depth: RangeParameter) -> PosePrior:
    """Hands in any pose, at a depth, anywhere in an image."""
    return any_roll().but(depth=depth, lateral_x=NormalParameter(0.0, 0.12), lateral_y=NormalParameter(0.0, 0.08))


def draw_scenes(
    rng: np.random.Generator, count: int, camera: Camera = NYU, sensor: Sensor | None = KINECT,
    prior: PosePrior | None = None, first: int = 0,
) -> tuple[Floats, Array]:
    """Images (N, height, width) in mm, 0 where nothing was read, and the joints (N, K, 3) of their hands, camera axes.

    They are of the kinds of ``KINDS`` in turn from number ``first`` on, and show right hands with poses from ``prior``,
    by default ``prior_of``.

    forearm  comes from the camera's side: it is nearer than the hand
    body     the person's body behind the hand: upper arm, shoulders, trunk and head, in front of a wall
    clutter  a table below, bottles and balls next to the hand, some of them nearer than it
    """
    sampler = BodySampler(prior or prior_of(DEPTH))
    images, joints = [], []
    for n in range(first, first + count):
        image, xyz, wall = _visible_scene(rng, sampler, camera, KINDS[n % len(KINDS)])
        if sensor is not None:
            image = sense(rng, image, np.array([wall]), sensor, camera)
        if rng.random() < 0.5:
            image[image >= wall] = 0  # the wall is out of range
        images.append(image[0])
        joints.append(xyz)
    return np.stack(images), np.stack(joints)


def _visible_scene(
    rng: np.random.Generator, sampler: BodySampler, camera: Camera, kind: str
) -> tuple[Floats, Array, float]:
    """An image (1, height, width), the joints of its mostly visible hand, and the depth of the wall."""
    own = ~sampler.surface.limbs
    while True:
        capsules, center, xyz = _hand(rng, sampler, camera, kind == "forearm")
        parts = [capsules, _body(rng, capsules, kind)]
        if kind == "clutter":
            parts.append(_things(rng, center))
        wall = float(rng.uniform(1400, 3000))
        image = render_image(joined(parts), camera, wall)
        if kind == "clutter":
            np.minimum(image, _table(camera, center[1] - rng.uniform(130, 350)), out=image)
        hand = render_image(
            capsules.chosen(np.append(own, np.zeros(capsules.a.shape[1] - len(own), bool))), camera, np.inf
        )
        u, v, _ = camera.project(xyz).T
        inside = ((u > 0) & (u < camera.width) & (v > 0) & (v < camera.height)).mean()
        if inside > MIN_INSIDE and (image >= hand)[np.isfinite(hand)].mean() > SEEN:
            return image, xyz, wall


def _hand(
    rng: np.random.Generator, sampler: BodySampler, camera: Camera, to_camera: bool
) -> tuple[Capsules, Array, Array]:
    """Capsules of a hand with its arm (1, M), its centre (3,) and its joints (K, 3) in mm."""
    prior = replace(PERSON_SURFACE, towards_camera=0.85 if to_camera else 0.3, cut=0.0)
    while True:
        hands = sampler.draw(rng, 1)
        center = camera.unproject(sampler.centers(rng, 1, camera))
        capsules = draw_capsules(
            rng, prior, sampler.surface, hands.inputs, hands.bones, hands.scale, CUBE_MM / 2, center
        )
        arm = (capsules.b - capsules.a)[0, np.flatnonzero(sampler.surface.limbs)[0]]
        towards = -arm[2] / np.linalg.norm(arm)
        if towards <= prior.towards_camera and (towards > 0.35) == to_camera:
            return capsules, center[0], hands.joints[0] * CUBE_MM / 2 + center[0]


def _body(rng: np.random.Generator, hand: Capsules, kind: str) -> Capsules:
    """The upper arm of a hand, whose last capsule ends at the elbow; for the kind "body" everything behind it."""
    elbow = hand.b[0, -1]
    side = 1.0 if rng.random() < 0.5 else -1.0
    away = -1.0 if kind == "forearm" else 1.0  # whose arm comes from the camera's side
    upper = np.array([side * rng.uniform(0, 0.6), rng.uniform(-0.2, 0.7), away * rng.uniform(0.4, 1.0)])
    shoulder = elbow + ARM_MM * upper / np.linalg.norm(upper)
    middle = shoulder + (side * 170, 0, 20)
    ends = np.array([(a, b) for a, b, _, _ in BODY], dtype=np.float64) + middle
    radii = np.array([(ra, rb) for _, _, ra, rb in BODY], dtype=np.float64)
    a, b = np.concatenate([[elbow], ends[:, 0]]), np.concatenate([[shoulder], ends[:, 1]])
    ra, rb = np.concatenate([[42.0], radii[:, 0]]), np.concatenate([[55.0], radii[:, 1]])
    shown = slice(None) if kind == "body" else slice(0, 1)
    return in_front(Capsules(a[None, shown], b[None, shown], ra[None, shown], rb[None, shown]))


def _things(rng: np.random.Generator, center: Array) -> Capsules:
    """Bottles, balls and sticks next to a hand, seen from the camera, nearer or farther than it."""
    ends: list[tuple[Array, Array]] = []
    radii: list[float] = []
    while len(ends) < 3:
        depth = center[2] + rng.uniform(-200, 300)
        angle = rng.uniform(0, 2 * np.pi)
        sideways = np.array([np.cos(angle), np.sin(angle), 0]) * rng.uniform(230, 420)
        place = (center + sideways) * depth / center[2]
        along = rng.normal(size=3)
        length, radius = rng.choice([[180.0, 35.0], [1.0, 80.0], [250.0, 15.0]])
        half = along / np.linalg.norm(along) * length / 2
        if place[2] - radius - length / 2 > 150:
            ends.append((place - half, place + half))
            radii.append(radius)
    a, b = np.array(ends).swapaxes(0, 1)
    r = np.array(radii)
    return Capsules(a[None], b[None], r[None], r[None])


def render_image(capsules: Capsules, camera: Camera, background: float) -> Floats:
    """Whole images (N, height, width) in mm."""
    count = len(capsules.a)
    x = np.tile((np.arange(camera.width) - camera.u0) / camera.fx, (count, 1))
    y = np.tile((np.arange(camera.height) - camera.v0) / camera.fy, (count, 1))
    return render(capsules, x, y, np.full(count, background))


def _table(camera: Camera, height: float) -> NDArray[np.float32]:
    """Depth (height, 1) of a plane at y = ``height`` mm below the camera; infinite above the horizon."""
    slope = (np.arange(camera.height) - camera.v0) / camera.fy  # downwards
    with np.errstate(divide="ignore"):
        depth = np.where((slope > 0) & (height < 0), -height / np.maximum(slope, 1e-9), np.inf)
    return depth[:, None].astype(np.float32)
