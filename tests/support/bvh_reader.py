"""A reader of BVH, written from the format alone: joints are at OFFSET and position from their parent, then rotate by
the channels in the order in which they are named; x, y and z rotate by the right-hand rule.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np


@dataclass
class Bone:
    """A joint of the file, or its End Site."""

    name: str
    offset: np.ndarray
    channels: list[str] = field(default_factory=list)
    below: list[Bone] = field(default_factory=list)


class Bvh:
    """A whole file.

    root        its tree
    frame_time  s
    motion      (N, channels)
    """

    def __init__(self, text: str) -> None:
        head, _, motion = text.partition("MOTION")
        self._words = head.split()
        assert self._words[:2] == ["HIERARCHY", "ROOT"]
        del self._words[0]
        self.root = self._bone()
        assert not self._words, self._words[:5]
        found = re.fullmatch(r"\s*Frames:\s*(\d+)\s*Frame Time:\s*(\S+)\n(.*)", motion, re.DOTALL)
        assert found
        rows = [line.split() for line in found[3].splitlines()]
        self.frame_time, self.motion = float(found[2]), np.array(rows, dtype=float)
        assert len(rows) == int(found[1])
        assert self.motion.shape[1] == sum(len(bone.channels) for bone in self.bones())

    def _take(self, *expected: str) -> str:
        word = self._words.pop(0)
        assert not expected or word in expected, (word, expected)
        return word

    def _bone(self) -> Bone:
        kind, name = self._take("ROOT", "JOINT", "End"), self._take()
        self._take("{")
        self._take("OFFSET")
        bone = Bone(name, np.array([float(self._take()) for _ in range(3)]))
        if kind != "End":
            self._take("CHANNELS")
            bone.channels = [self._take() for _ in range(int(self._take()))]
            while self._words[0] != "}":
                bone.below.append(self._bone())
        self._take("}")
        return bone

    def bones(self) -> list[Bone]:
        """Yield all bones in the file's order."""

        def walk(bone: Bone) -> list[Bone]:
            return [bone, *(found for child in bone.below for found in walk(child))]

        return walk(self.root)

    def positions(self) -> dict[str, np.ndarray]:
        """Return the position of each joint, (N, 3), and under "NAME end" that of its End Site."""
        found, numbers = {}, iter(self.motion.T)

        def walk(bone: Bone, parent: str, place: np.ndarray, frame: np.ndarray) -> None:
            local = np.tile(bone.offset, (len(self.motion), 1))
            turned = np.tile(np.eye(3), (len(self.motion), 1, 1))
            for channel in bone.channels:
                axis, values = "XYZ".index(channel[0]), next(numbers)
                if channel[1:] == "position":
                    local[:, axis] += values
                else:
                    assert channel[1:] == "rotation"
                    turned = turned @ turn(axis, np.radians(values))
            place, name = place + np.einsum("nij,nj->ni", frame, local), bone.name
            if not bone.channels:
                name = f"{parent} end"
            assert name not in found
            found[name] = place
            for child in bone.below:
                walk(child, name, place, frame @ turned)

        walk(self.root, "", np.zeros((len(self.motion), 3)), np.tile(np.eye(3), (len(self.motion), 1, 1)))
        return found


def turn(axis: int, angle: np.ndarray) -> np.ndarray:
    """Return a rotation by Rodrigues' formula, (N, 3, 3)."""
    cross = np.array([np.cross(np.eye(3)[axis], e) for e in np.eye(3)]).T
    return np.eye(3) + np.sin(angle)[:, None, None] * cross + (1 - np.cos(angle))[:, None, None] * (cross @ cross)
