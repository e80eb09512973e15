"""What a prior file names of a skeleton: its DoFs, joints and chains."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from handpose.synthetic.prior_parameters import (
    BetweenParameter,
    ChainParameter,
    PosePartParameter,
    PosePrior,
    SpreadParameter,
)
from layers.hand.skeleton import Skeleton
from netlib.errors import PrototxtError, did_you_mean
from netlib.proto import schema

Bent = tuple[Literal["LOWER", "UPPER"], NDArray[np.int_]]  # the limit of straight DoFs, and these


class Named:
    """What a prior names of a skeleton, as indices. Raises PrototxtError for what is unknown, is
    drawn twice, or has no limits where they are needed.

    rotation     DoFs of the turns
    translation  DoFs along x, y, z of the joint with the crop centre; none without a centre
    chains       DoFs of each chain of each bend
    spread, between  DoFs of each of these messages
    groups       joints of each proportion
    poses        by name: what is bent, and by which fractions
    """

    def __init__(self, prior: PosePrior, skeleton: Skeleton) -> None:
        self._skeleton, self._file = skeleton, prior.skeleton
        self._drawn: set[int] = set()
        self.groups = [
            [self._joint(group, one) for one in group.joint] for group in prior.proportion
        ]
        self.translation = self._translation(prior)
        self.rotation = [self._dof(turn, turn.dof) for turn in prior.turn]
        self.chains = [[self._limb(chain) for chain in bend.chain] for bend in prior.bend]
        self.spread = [self._limb(spread) for spread in prior.spread]
        self.between = [self._limb(between) for between in prior.between]
        chains: dict[str, Bent] = {
            chain.name: (bend.straight, dofs)
            for bend, own in zip(prior.bend, self.chains)
            for chain, dofs in zip(bend.chain, own)
        }
        dofs: dict[str, Bent] = {
            name: ("LOWER", np.array([d])) for d, name in enumerate(skeleton.dof_names)
        }
        self.poses: dict[str, list[tuple[Bent, float]]] = {}
        for pose in prior.pose:
            expect(pose, "name", pose.name not in self.poses, f"pose {pose.name!r} once")
            self.poses[pose.name] = [*_parts(pose.bend, chains), *_parts(pose.at, dofs)]
        expect(prior, "blend", not prior.blend or bool(prior.pose), "a pose { ... } to be between")

    def _joint(self, message: object, name: str) -> int:
        expect_known(message, "joint", name, self._skeleton.joint_names)
        return self._skeleton.joint_names.index(name)

    def _dof(self, message: object, name: str) -> int:
        expect_known(message, "dof", name, self._skeleton.dof_names)
        d = self._skeleton.dof_names.index(name)
        expect(message, "dof", d not in self._drawn, f"DoF {name!r} once")
        expect(message, "dof", not self._skeleton.fixed[d], f"no fixed DoF such as {name!r}")
        self._drawn.add(d)
        return d

    def _limb(
        self, message: ChainParameter | SpreadParameter | BetweenParameter
    ) -> NDArray[np.int_]:
        """The DoFs of a message, which need limits."""
        skeleton = self._skeleton
        dofs = [self._dof(message, name) for name in message.dof]
        for d in dofs:
            is_bounded = bool(np.isfinite([skeleton.lower[d], skeleton.upper[d]]).all())
            expected = f"limits of DoF {skeleton.dof_names[d]!r} in {self._file}"
            expect(message, "dof", is_bounded, expected)
        return np.array(dofs, dtype=int)

    def _translation(self, prior: PosePrior) -> list[int]:
        """Raises unless the centre of crops is on a joint that moves the whole body."""
        if prior.center is None:
            for name in ("center_jitter", "center_jitter_wide"):
                expect(prior, name, not getattr(prior, name), "a center { ... } to be away from")
            return []
        joint = self._joint(prior.center, prior.center.joint)
        along = {
            motion.axis: motion.dof
            for motion in self._skeleton.motions[joint]
            if motion.kind == "translate" and motion.sign > 0 and motion.row >= 0
        }
        moves_body = self._skeleton.parents[joint] < 0 and len(along) == 3
        expected = "one without a parent that translates along X, Y and Z"
        expect(prior.center, "joint", moves_body, expected)
        return [along[axis] for axis in range(3)]


def _parts(
    parts: Sequence[PosePartParameter], known: Mapping[str, Bent]
) -> Iterator[tuple[Bent, float]]:
    """What the parts of a pose are of, each once."""
    names: set[str] = set()
    for part in parts:
        expect_known(part, "of", part.of, known)
        expect(part, "of", part.of not in names, f"{part.of!r} once in a pose")
        names.add(part.of)
        yield known[part.of], part.part


def expect(message: object, field: str, holds: bool, expected: str) -> None:
    """Raise PrototxtError at a message's field, with what was expected, unless it ``holds``."""
    if not holds:
        raise PrototxtError(schema.position_of(message, field), f"{field}: expected {expected}")


def expect_known(message: object, field: str, name: str, known: Collection[str]) -> None:
    """Raise PrototxtError at a message's field unless the name is a known one."""
    if name not in known:
        advice = did_you_mean(name, known) or f"; expected one of {', '.join(known)}"
        raise PrototxtError(schema.position_of(message, field), f"unknown {field} {name!r}{advice}")
