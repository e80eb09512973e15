"""Synthetic depth frames of hands: training data for those who do not have NYU.

A frame is made in four steps, each described by one dataclass of numbers:

    PosePrior    how hands are held: rotations, curled fingers, place, bone lengths
    HandShape    flesh: capsules along the bones, a palm on its own side of them, a forearm
    render       the depth image, along the rays that the NYU crop picks (``handpose.render``)
    Sensor       what a Kinect makes of it (``handpose.sensor``)

Labels are those of NYU: 31 joints in half-cubes from the crop centre, camera axes (x right, y up, z away),
clipped to [-1, 1]. They belong to the frame's own bones. ``dof`` holds the model's 47 inputs that posed the
frame; with the packaged bones instead of the frame's own they give these joints only nearly (4 mm on the mean).

Frames depend on the seed, the split and their number alone: each block of ``BLOCK`` frames has a random
generator of its own, so neither the number of worker processes nor the number of frames changes a frame.
"""

from __future__ import annotations

import collections
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass, fields
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from handpose.camera import NYU, Camera
from handpose.crop import SIZE, window
from handpose.nyu import CUBE_MM
from handpose.render import Capsules, Floats, normalise_depth, render_crop
from handpose.sensor import Sensor, sense
from handpose.workers import no_interrupt, processes
from layers import kinematics
from netlib.errors import DataError

Array = NDArray[np.float64]
Split = Literal["train", "test"]

_AHEAD = 16  # blocks drawn ahead of the consumer, 4 MB each
_KINECT = Sensor()
BLOCK = 64  # frames that share a random generator
VERSION = 3  # to be raised when the code (here, in sensor, render, crop), not a number of a recipe, changes frames
FINGERS = ("little", "ring", "middle", "index")

# ------------------------------------------------------------------------------------------- the numbers


@dataclass(frozen=True)
class PosePrior:
    """How hands are held, and whose they are. Angles in degrees are of the whole palm, R = Rz Rx Ry."""

    # Global rotation.
    roll_mean: float = 5.0  # Rz, most hands: normal
    roll_std: float = 40.0
    roll_uniform: float = 0.15  # Rz, this fraction: any angle
    pitch_mean: float = -12.0  # Rx: normal
    pitch_std: float = 32.0
    pitch_limit: float = 85.0  # largest |Rx|
    yaw_std: float = 50.0  # Ry, most hands: normal about 0
    yaw_uniform: float = 0.40  # Ry, this fraction: any angle

    # Fingers, as fractions of the skeleton's limits: 0 straight, 1 bent.
    curl_shared: tuple[float, float] = (0.7, 1.0)  # Beta: one curl for all fingers of a hand
    independent: float = 0.40  # this fraction of hands has ...
    curl_own: tuple[float, float] = (0.6, 0.8)  # ... Beta: a curl for each finger
    finger_noise: float = 0.18  # normal, of each angle about its curl, and of the spread about the initial pose
    thumb: tuple[float, float] = (1.3, 1.3)  # Beta: each thumb angle
    penetration: float = 5.0  # mm that fingers may sink into each other or the palm; deeper ones are drawn again
    redraws: int = 8  # at most so often

    # Place. The crop centre is NYU's annotated joint 34, which the model does not have.
    center_in_palm: tuple[float, float, float] = (-16.7, -21.5, 5.1)  # mm, palm frame
    center_jitter: float = 3.0  # mm, normal, each axis
    center_jitter_wide: float = 7.5  # the same ...
    wide: float = 0.20  # ... for this fraction
    depth: tuple[float, float] = (550.0, 1000.0)  # mm, uniform
    lateral_x: tuple[float, float] = (-0.08, 0.08)  # x / z of the centre: normal, mean and deviation
    lateral_y: tuple[float, float] = (-0.03, 0.07)  # y / z of the centre: normal, mean and deviation

    # Bones, relative to the skeleton's.
    scale_std: float = 0.06  # the whole hand
    bone_std: float = 0.04  # each bone
    scale_clip: float = 2.5  # both are cut at so many deviations


def _along(finger: str, r: tuple[float, ...]) -> tuple[tuple[str, str, float, float], ...]:
    """Capsules of a finger from the knuckle to the tip, with the radius at each of its six points."""
    names = [f"{finger}_{part}" for part in ("mcp", "base", "pip_a", "pip_b", "dip", "tip")]
    return tuple((names[i], names[i + 1], r[i], r[i + 1]) for i in range(5))


def _all_fingers(part: str, value: float) -> tuple[tuple[str, float], ...]:
    return tuple((f"{finger}_{part}", value) for finger in FINGERS)


@dataclass(frozen=True)
class HandShape:
    """Capsules: from and to which joint, and the radii in mm at both."""

    capsules: tuple[tuple[str, str, float, float], ...] = (
        *_along("little", (12.0, 10.5, 9.5, 9.5, 8.5, 7.5)),
        *_along("ring", (13.0, 11.0, 10.5, 10.0, 9.0, 8.0)),
        *_along("middle", (13.0, 11.0, 11.0, 10.5, 9.5, 8.0)),
        *_along("index", (13.0, 11.0, 11.0, 10.5, 9.5, 8.0)),
        ("thumb_mcp", "thumb_pip", 17.0, 14.0),
        ("thumb_pip", "thumb_dip", 14.0, 10.5),
        ("thumb_dip", "thumb_tip", 10.5, 8.5),
        # The palm is solid: spokes from the wrist to the knuckles, the knuckles joined, the ball of the thumb.
        ("wrist_left", "little_mcp", 18.0, 13.0),
        ("wrist_left", "ring_mcp", 18.0, 13.5),
        ("wrist_middle", "ring_mcp", 18.5, 13.5),
        ("wrist_middle", "middle_mcp", 18.5, 13.5),
        ("wrist_middle", "index_mcp", 18.5, 13.5),
        ("wrist_left", "wrist_middle", 18.0, 18.5),
        ("wrist_middle", "thumb_mcp", 18.5, 17.0),
        ("little_mcp", "ring_mcp", 13.0, 13.5),
        ("ring_mcp", "middle_mcp", 13.5, 13.5),
        ("middle_mcp", "index_mcp", 13.5, 13.5),
        ("thumb_mcp", "palm", 17.0, 15.0),
        ("thumb_mcp", "index_mcp", 17.0, 13.5),
        ("thumb_pip", "index_mcp", 12.0, 12.0),
    )
    thickness_std: float = 0.08  # all radii of a hand together

    # Flesh lies on the palm's side of its bones, most at the wrist: mm that capsules end on that side of their joints.
    # Chosen on two real crops, whose surface was 8 mm off without, 5 mm with it.
    towards_palm: tuple[tuple[str, float], ...] = (
        ("wrist_left", 9.0),
        ("wrist_middle", 9.0),
        ("thumb_mcp", 8.0),
        ("thumb_pip", 2.0),
        ("palm", 6.0),
        *_all_fingers("mcp", 6.0),
        *_all_fingers("base", 2.0),
    )

    forearm_towards_palm: float = 5.0  # mm, of its axis: between the bones of the wrist and their flesh
    forearm_radius: tuple[float, float] = (25.0, 38.0)  # mm at the wrist and at the elbow's end
    forearm_length: float = 260.0  # mm
    forearm_flexion_std: float = 25.0  # degrees, normal: bending towards and away from the palm
    forearm_deviation_std: float = 18.0  # degrees, normal: bending sideways
    forearm_towards_camera: float = 0.35  # largest part of its direction that may point at the camera


# ---------------------------------------------------------------------------------------------- the hand


class Hands(NamedTuple):
    """N posed hands, in half-cubes from their crop centres."""

    inputs: Array  # (N, 47) parameters of the model
    bones: Array  # (N, 31) bone lengths
    joints: Array  # (N, 31, 3)
    scale: Array  # (N,) size relative to the skeleton


@dataclass(frozen=True)
class Frames:
    """n frames with their labels; the names are those of the data sets in the files."""

    depth: Floats  # (n, 1, 128, 128) the crop in [-1, 1]
    joint: Floats  # (n, 93) 31 joints x, y, z in half-cubes from the centre, clipped to [-1, 1]
    dof: Floats  # (n, 47) inputs of the hand model
    center: Floats  # (n, 3) crop centre in mm, camera axes
    center_uvd: Floats  # (n, 3) the same in px, px, mm
    index: NDArray[np.int64]  # (n,) number of the frame in its split
    half_cube: Floats  # (n,) mm

    def __len__(self) -> int:
        return len(self.index)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All arrays by name."""
        return {f.name: getattr(self, f.name) for f in fields(self)}


class Generator:
    """Draws frames. Build one for a seed and split, then ask for blocks of ``BLOCK`` frames by number."""

    def __init__(
        self,
        seed: int = 0,
        split: Split = "train",
        prior: PosePrior = PosePrior(),
        shape: HandShape = HandShape(),
        sensor: Sensor | None = _KINECT,
        camera: Camera = NYU,
        cube_mm: float = CUBE_MM,
    ) -> None:
        if seed < 0:
            raise DataError(f"seed {seed}, expected 0 or more")
        if split not in get_args(Split):
            raise DataError(f"split {split!r}, expected one of {', '.join(get_args(Split))}")
        self.seed, self.split, self.camera, self.cube_mm = seed, split, camera, cube_mm
        self.prior, self.shape, self.sensor = prior, shape, sensor
        self.skeleton = kinematics.load()
        name = self.skeleton.joint_names.index
        self._from = np.array([name(c[0]) for c in shape.capsules])
        self._to = np.array([name(c[1]) for c in shape.capsules])
        self._radii = np.array([c[2:] for c in shape.capsules])
        self._towards_palm = np.zeros(len(self.skeleton.joint_names))
        self._towards_palm[[name(joint) for joint, _ in shape.towards_palm]] = [mm for _, mm in shape.towards_palm]
        self._pairs = _touching_pairs(shape)
        dof = self.skeleton.dof_names.index
        self._rotation = [dof(f"palm_rot_{axis}") for axis in "zxy"]
        self._translation = [dof(f"palm_{axis}") for axis in "xyz"]
        self._flexions = np.array([[dof(f"{f}_{part}_rot_x") for part in ("base", "pip", "dip")] for f in FINGERS])
        self._spreads = np.array([dof(f"{f}_base_rot_z") for f in FINGERS])
        self._thumb = np.array([dof(f"thumb_{d}") for d in ("pip_rot_y", "pip_rot_z", "dip_rot_z", "tip_rot_z")])
        self._palm = name("palm")
        self._wrist = [name("wrist_left"), name("wrist_middle")]
        self._knuckles = [name(f"{f}_mcp") for f in FINGERS]

    def block(self, number: int) -> Frames:
        """Frames ``number * BLOCK`` and following. The same numbers whenever and wherever they are asked for."""
        source = np.random.SeedSequence([self.seed, get_args(Split).index(self.split), number])
        rng = np.random.Generator(np.random.SFC64(source))
        hands = self.hands(rng, BLOCK)
        center_uvd = self._centers(rng, BLOCK)
        center = self.camera.unproject(center_uvd)
        half = self.cube_mm / 2
        capsules = self.flesh(rng, hands.joints * half + center[:, None], hands.scale)
        depth = render_crop(capsules, center_uvd, self.cube_mm, self.camera)
        if self.sensor is not None:
            depth = sense(rng, depth, center_uvd[:, 2] + half, self.sensor, self.camera)
            self._blank_outside(depth, center_uvd)
        normalise_depth(depth, center_uvd[:, 2], self.cube_mm)
        return Frames(
            depth=depth[:, None],
            joint=np.clip(hands.joints, -1, 1).reshape(BLOCK, -1).astype(np.float32),
            dof=hands.inputs.astype(np.float32),
            center=center.astype(np.float32),
            center_uvd=center_uvd.astype(np.float32),
            index=np.arange(number * BLOCK, (number + 1) * BLOCK),
            half_cube=np.full(BLOCK, half, dtype=np.float32),
        )

    def _blank_outside(self, depth: Floats, center_uvd: Array) -> None:
        """Crop pixels that no image pixel fills are background again, whatever ragged edges moved there."""
        picked = window(center_uvd, self.cube_mm, self.camera)
        columns, rows = picked.columns < 0, picked.rows < 0
        for n in np.flatnonzero(columns.any(axis=1) | rows.any(axis=1)):
            far = center_uvd[n, 2] + self.cube_mm / 2
            depth[n][:, columns[n]] = far
            depth[n][rows[n]] = far

    def recipe(self) -> dict[str, object]:
        """All that the frames depend on, in plain values that JSON can hold."""
        return {
            "version": VERSION,
            "seed": self.seed,
            "split": self.split,
            "camera": asdict(self.camera),
            "cube_mm": self.cube_mm,
            "skeleton": self.skeleton.name,
            "prior": asdict(self.prior),
            "shape": asdict(self.shape),
            "sensor": asdict(self.sensor) if self.sensor else None,
        }

    # ------------------------------------------------------------------------------------------- pose

    def hands(self, rng: np.random.Generator, count: int) -> Hands:
        """Draw ``count`` hands in poses in which fingers do not run through each other."""
        p, sk = self.prior, self.skeleton
        scale = 1 + p.scale_std * _cut_normal(rng, (count,), p.scale_clip)
        bones = sk.bones * scale[:, None] * (1 + p.bone_std * _cut_normal(rng, (count, len(sk.bones)), p.scale_clip))
        inputs = np.zeros((count, len(sk.initial)))
        inputs[:, self._rotation] = self._rotations(rng, count) - sk.initial[self._rotation]
        todo = np.arange(count)
        depth = np.full(count, np.inf)
        for _ in range(p.redraws):
            trial = inputs[todo]
            self._draw_fingers(rng, trial)
            found = self._penetration(sk.joints(trial, bones[todo]) * (self.cube_mm / 2), scale[todo])
            better = found < depth[todo]
            inputs[todo[better]] = trial[better]
            depth[todo[better]] = found[better]
            todo = np.flatnonzero(depth > p.penetration)
            if not len(todo):
                break
        # The crop centre hangs on the palm; the origin is the crop centre.
        wide = rng.random((count, 1)) < p.wide
        jitter = rng.standard_normal((count, 3)) * np.where(wide, p.center_jitter_wide, p.center_jitter)
        palm = sk.rotation_of(sk.forward(inputs, bones), self._palm)
        center = np.einsum("nij,j->ni", palm, p.center_in_palm) * scale[:, None] + jitter
        inputs[:, self._translation] = -center / (self.cube_mm / 2) - sk.initial[self._translation]
        return Hands(inputs, bones, sk.joints(inputs, bones), scale)

    def _rotations(self, rng: np.random.Generator, count: int) -> Array:
        """Angles (count, 3) about z, x, y in radians."""
        p = self.prior
        z = np.where(
            rng.random(count) < p.roll_uniform,
            rng.uniform(-180, 180, count),
            p.roll_mean + p.roll_std * rng.standard_normal(count),
        )
        x = np.clip(p.pitch_mean + p.pitch_std * rng.standard_normal(count), -p.pitch_limit, p.pitch_limit)
        y = np.where(
            rng.random(count) < p.yaw_uniform,
            rng.uniform(-180, 180, count),
            p.yaw_std * rng.standard_normal(count),
        )
        return np.asarray(np.deg2rad(np.stack([z, x, y], axis=1)))

    def _draw_fingers(self, rng: np.random.Generator, inputs: Array) -> None:
        """Set the angles of fingers and thumb in ``inputs`` (N, 47), within their limits."""
        p, N = self.prior, len(inputs)
        lower, upper = self.skeleton.lower, self.skeleton.upper
        own = rng.beta(*p.curl_own, (N, len(FINGERS)))
        shared = rng.beta(*p.curl_shared, (N, 1))
        curl = np.where(rng.random((N, 1)) < p.independent, own, shared)[:, :, None]
        bent = np.clip(curl + p.finger_noise * rng.standard_normal((N, *self._flexions.shape)), 0, 1)
        inputs[:, self._flexions] = upper[self._flexions] - bent * (upper - lower)[self._flexions]
        d = self._spreads
        spread = p.finger_noise * rng.standard_normal((N, len(d))) * (upper - lower)[d]
        inputs[:, d] = np.clip(spread, lower[d], upper[d])
        d = self._thumb
        inputs[:, d] = lower[d] + rng.beta(*p.thumb, (N, len(d))) * (upper - lower)[d]

    def _penetration(self, joints: Array, scale: Array) -> Array:
        """How deep in mm (N,) two parts of a hand that should not meet are in each other; joints (N, 31, 3) in mm."""
        _, _, back = self._palm_axes(joints)
        ends = self._capsule_ends(joints, scale, back)
        a, b = ends[:, self._from].transpose(2, 1, 0), ends[:, self._to].transpose(2, 1, 0)
        radii = self._radii[:, :, None] * scale
        i, j = self._pairs
        s, t, distance = _between(a[:, i], b[:, i], a[:, j], b[:, j])
        thick = radii[i, 0] + s * (radii[i, 1] - radii[i, 0]) + radii[j, 0] + t * (radii[j, 1] - radii[j, 0])
        return np.asarray((thick - distance).max(axis=0))

    def _centers(self, rng: np.random.Generator, count: int) -> Array:
        """Crop centres (count, 3): px, px, mm; exact in float32, as the labels store them."""
        p = self.prior
        z = rng.uniform(*p.depth, count)
        x = (p.lateral_x[0] + p.lateral_x[1] * rng.standard_normal(count)) * z
        y = (p.lateral_y[0] + p.lateral_y[1] * rng.standard_normal(count)) * z
        uvd = self.camera.project(np.stack([x, y, z], axis=1))
        return uvd.astype(np.float32).astype(np.float64)

    # ------------------------------------------------------------------------------------------- flesh

    def flesh(self, rng: np.random.Generator, joints: Array, scale: Array) -> Capsules:
        """Capsules around hands with ``joints`` (N, 31, 3) in mm and sizes ``scale`` (N,), and their forearms."""
        h, N = self.shape, len(joints)
        thickness = scale * (1 + h.thickness_std * _cut_normal(rng, (N,), self.prior.scale_clip))
        down, across, back = self._palm_axes(joints)
        flexion = np.deg2rad(h.forearm_flexion_std) * rng.standard_normal((N, 1))
        deviation = np.deg2rad(h.forearm_deviation_std) * rng.standard_normal((N, 1))
        arm = np.cos(flexion) * (np.cos(deviation) * down + np.sin(deviation) * across) + np.sin(flexion) * back
        arm[:, 2] = np.maximum(arm[:, 2], -h.forearm_towards_camera)
        arm[:, :2] = _unit(arm[:, :2]) * np.sqrt(1 - arm[:, 2:] ** 2)
        radii = np.concatenate([self._radii, [h.forearm_radius]]) * thickness[:, None, None]
        wrist = joints[:, self._wrist].mean(axis=1) - h.forearm_towards_palm * scale[:, None] * back
        elbow = wrist + h.forearm_length * scale[:, None] * arm
        ends = self._capsule_ends(joints, scale, back)
        return Capsules(
            np.concatenate([ends[:, self._from], wrist[:, None]], axis=1),
            np.concatenate([ends[:, self._to], elbow[:, None]], axis=1),
            radii[:, :, 0],
            radii[:, :, 1],
        )

    def _capsule_ends(self, joints: Array, scale: Array, back: Array) -> Array:
        """Where the capsules of each joint end, (N, 31, 3) in mm: some way from it towards the palm."""
        return np.asarray(joints - np.einsum("n,j,nk->njk", scale, self._towards_palm, back))

    def _palm_axes(self, joints: Array) -> tuple[Array, Array, Array]:
        """Unit vectors (N, 3): down to the wrist, across it to the thumb, out of the hand's back."""
        down = _unit(joints[:, self._wrist].mean(axis=1) - joints[:, self._knuckles].mean(axis=1))
        across = joints[:, self._wrist[1]] - joints[:, self._wrist[0]]
        across = _unit(across - (across * down).sum(1, keepdims=True) * down)
        return down, across, np.cross(down, across)


def _touching_pairs(shape: HandShape) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs of capsules that should keep apart: of different fingers, and of finger ends and the palm."""
    fingers, ends, spokes = [], [], []
    for i, (a, b, _, _) in enumerate(shape.capsules):
        finger, _, part = a.partition("_")
        if finger in FINGERS and b.startswith(finger) and part != "mcp":
            fingers.append((i, FINGERS.index(finger), part == "base"))
        if a in ("thumb_pip", "thumb_dip") and b.startswith("thumb"):
            fingers.append((i, -9, False))
        if b.endswith(("_dip", "_tip")) and a != "thumb_pip":
            ends.append(i)
        if finger == "wrist" and b.endswith("_mcp") and b != "thumb_mcp":
            spokes.append(i)
    pairs = [
        (i, j)
        for n, (i, finger, base) in enumerate(fingers)
        for j, other, other_base in fingers[n + 1 :]
        if finger != other and not (base and other_base and abs(finger - other) == 1)  # neighbours meet at the base
    ]
    pairs += [(i, j) for i in ends for j in spokes]
    i, j = np.array(pairs).T
    return i, j


def _between(a: Array, b: Array, c: Array, d: Array) -> tuple[Array, Array, Array]:
    """Nearest points of the segments ab and cd, arrays (3, ...): where on each, 0 to 1, and their distance."""
    u, v, w = b - a, d - c, a - c
    uu, vv, uv = (u * u).sum(0), (v * v).sum(0), (u * v).sum(0)
    uw, vw = (u * w).sum(0), (v * w).sum(0)
    s = np.clip((uv * vw - uw * vv) / np.maximum(uu * vv - uv * uv, 1e-9), 0, 1)
    t = np.clip((uv * s + vw) / np.maximum(vv, 1e-9), 0, 1)
    s = np.clip((uv * t - uw) / np.maximum(uu, 1e-9), 0, 1)
    return s, t, np.sqrt(((w + s * u - t * v) ** 2).sum(0))


def _cut_normal(rng: np.random.Generator, shape: tuple[int, ...], cut: float) -> Array:
    """Standard normal numbers, those beyond ``cut`` moved there."""
    return np.clip(rng.standard_normal(shape), -cut, cut)


def _unit(v: Array) -> Array:
    """Vectors (N, 2 or 3) scaled to length 1."""
    return np.asarray(v / np.linalg.norm(v, axis=1, keepdims=True))


# ----------------------------------------------------------------------------------------- many of them


def empty_frames() -> Frames:
    """No frames, in the shapes and types of those that ``generate`` yields."""
    shapes = {
        "depth": (1, SIZE, SIZE),
        "joint": (93,),
        "dof": (47,),
        "center": (3,),
        "center_uvd": (3,),
        "half_cube": (),
    }
    floats = {name: np.zeros((0, *shape), np.float32) for name, shape in shapes.items()}
    return Frames(**floats, index=np.zeros(0, np.int64))


def generate(
    count: int, generator: Generator, workers: int | ProcessPoolExecutor = 1, start: int = 0
) -> Iterator[Frames]:
    """Frames ``start`` to ``start + count`` of a generator, in pieces of at most ``BLOCK``. Raises DataError.

    ``workers`` is a number of processes, or a pool made by ``handpose.workers.processes`` for several calls. The
    frames and their order do not depend on it. Processes are spawned, so a script that asks for more than one
    needs the usual ``if __name__ == "__main__":``.
    """
    if count < 0 or start < 0:
        raise DataError(f"{count} frames from number {start}, expected 0 or more of both")
    numbers = range(start // BLOCK, -(-(start + count) // BLOCK))
    if workers == 1:
        yield from (_part(generator.block(number), start, start + count) for number in numbers)
    elif isinstance(workers, int):
        with processes(workers) as pool:
            yield from generate(count, generator, pool, start)
    else:
        for frames in _in_processes(generator, numbers, workers):
            yield _part(frames, start, start + count)


def _part(frames: Frames, start: int, stop: int) -> Frames:
    """Those of the frames whose number is from ``start`` to ``stop``."""
    first = int(frames.index[0])
    if start <= first and first + len(frames) <= stop:
        return frames
    part = slice(max(start - first, 0), stop - first)
    return Frames(**{name: array[part] for name, array in frames.arrays().items()})


def _in_processes(generator: Generator, numbers: range, pool: ProcessPoolExecutor) -> Iterator[Frames]:
    """``generator.block`` of every number in order, drawn a few blocks ahead of the consumer."""
    ahead: collections.deque[Future[Frames]] = collections.deque()
    try:
        for number in numbers:
            with no_interrupt():
                ahead.append(pool.submit(generator.block, number))
            if len(ahead) > _AHEAD:
                yield ahead.popleft().result()
        while ahead:
            yield ahead.popleft().result()
    except BrokenProcessPool:
        raise DataError("a worker process was killed, perhaps for want of memory; try fewer workers") from None
    finally:
        for future in ahead:
            future.cancel()
