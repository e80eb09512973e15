"""Reading a solver's prototxt: checks its options and loads the nets that it names."""

from __future__ import annotations

import dataclasses
import logging
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from netlib.errors import NetlibError, PrototxtError, did_you_mean
from netlib.files.paths import exists, find
from netlib.proto import prototxt, schema
from netlib.proto.messages import NetParameter, NetState, SolverParameter
from netlib.proto.net_parameter import load_parameter
from netlib.proto.prototxt import Message
from netlib.updates import POLICIES, RULES

log = logging.getLogger("netlib")

OLD_TYPES = {name.upper(): name for name in RULES}  # value of the enum solver_type -> type
MAX_AVERAGE_LOSS = 10**6  # limit of average_loss, the number of losses kept in memory
NET_FIELDS = ("net", "net_param", "train_net", "train_net_param")


def read(path: str | Path, **changes: Any) -> SolverParameter:
    """Read the options from a file and apply ``changes``. Raises NetlibError."""
    return parameter_of(prototxt.parse_file(path), **changes)


def parameter_of(tree: Message, **changes: Any) -> SolverParameter:
    """The options of a parsed file, with ``changes``. Raises PrototxtError."""
    if tree.named("layer", "layers", "input"):
        raise PrototxtError(
            tree.position, 'this is a net; expected a solver, which names it: net: "FILE"'
        )
    return schema.with_values(schema.read(tree, SolverParameter, "solver"), **changes)


def state_of(phase: schema.Phase, *states: NetState) -> NetState:
    """The state to build a net for: ``phase``, unless a state sets another.

    The last state that sets a field takes precedence, and stages add up, as in Caffe.
    """
    level = 0
    for state in states:
        if schema.is_set(state, "phase"):
            phase = state.phase
        if schema.is_set(state, "level"):
            level = state.level
    return NetState(phase, level, tuple(stage for state in states for stage in state.stage))


def type_of(p: SolverParameter) -> str:
    """Type of a solver, from ``type`` or the older ``solver_type``.

    Raises PrototxtError if they differ.
    """
    if p.solver_type is None:
        return p.type
    named = OLD_TYPES[p.solver_type]
    if schema.is_given(p, "type") and p.type != named:
        raise PrototxtError(
            schema.position_of(p, "solver_type"),
            f"solver_type {p.solver_type} contradicts type {p.type!r}, which Caffe reads; expected one of them",
        )
    return named


def checked(p: SolverParameter) -> SolverParameter:
    """The options with ``type`` in place of ``solver_type``; logs which ones are ignored.

    Raises PrototxtError if a value is invalid.
    """
    p = schema.changed(p, type=type_of(p))
    for field, message in _mistakes(p):  # the first one
        raise PrototxtError(schema.position_of(p, field), message)
    if p.snapshot_diff and p.snapshot_format == "HDF5":
        log.info("snapshot_diff is ignored: HDF5 snapshots do not store gradients")
    if p.test_interval and not p.test_iter:
        log.warning("test_interval without test_iter: no tests are run, as in Caffe")
    if p.solver_mode == "GPU":
        log.info("solver_mode: GPU is accepted, but this runs on the CPU")
    return p


def _mistakes(p: SolverParameter) -> Iterator[tuple[str, str]]:
    """Invalid fields and what is wrong with them, most serious first."""
    if p.type not in RULES:
        yield (
            "type",
            f"unknown solver type {p.type!r}{did_you_mean(p.type, RULES)}; known: {', '.join(RULES)}",
        )
    for field in dataclasses.fields(p):
        value = getattr(p, field.name)
        if isinstance(value, float) and not math.isfinite(value):
            yield field.name, f"{field.name} is {value}; expected a finite number"
    yield from _rate_mistakes(p)
    if p.type in ("AdaGrad", "RMSProp") and p.momentum:
        yield "momentum", f"{p.type} has no momentum; remove the field"
    for name in ("momentum", "momentum2", "rms_decay"):
        if not 0 <= getattr(p, name) < 1:
            yield name, f"{name} {getattr(p, name):g} must be at least 0 and less than 1"
    if p.regularization_type not in ("L1", "L2"):
        yield (
            "regularization_type",
            f"unknown regularization_type {p.regularization_type!r}; known: L1, L2",
        )
    if p.iter_size < 1 or p.average_loss < 1:
        yield "iter_size", "iter_size and average_loss must be at least 1"
    if p.average_loss > MAX_AVERAGE_LOSS:
        yield "average_loss", f"average_loss {p.average_loss} is more than a million iterations"


def _rate_mistakes(p: SolverParameter) -> Iterator[tuple[str, str]]:
    """Invalid fields of the learning rate and what is wrong with them."""
    if p.lr_policy not in POLICIES:
        found = "no lr_policy"
        if p.lr_policy:
            found = f"unknown lr_policy {p.lr_policy!r}{did_you_mean(p.lr_policy, POLICIES)}"
        yield "lr_policy", f"{found}; known: {', '.join(POLICIES)}"
    if p.lr_policy == "poly" and p.power < 0:
        yield "power", f"lr_policy 'poly' needs a power that is not negative, found {p.power:g}"
    if p.lr_policy == "step" and not p.stepsize:
        yield "lr_policy", "lr_policy 'step' needs a stepsize of at least 1"
    if p.lr_policy == "poly" and not p.max_iter:
        yield "lr_policy", "lr_policy 'poly' needs max_iter"
    is_from_file = schema.tree_of(p) is not None
    if p.base_lr < 0:
        yield "base_lr", f"base_lr {p.base_lr:g} is negative"
    if is_from_file and not p.base_lr and not schema.is_given(p, "base_lr"):
        yield "base_lr", "no base_lr"
    if p.rampup_lr < 0:
        yield "rampup_lr", f"rampup_lr {p.rampup_lr:g} is negative"
    if p.lr_policy in ("step", "exp", "multistep", "inv") and p.gamma < 0:
        yield (
            "gamma",
            f"lr_policy {p.lr_policy!r} needs a gamma that is not negative, found {p.gamma:g}",
        )


# --------------------------------------------------------------------------------------------- nets


def train_net(p: SolverParameter, source: str) -> tuple[str, NetParameter]:
    """Load the training net that the solver in ``source`` names; returns its name and parameter."""
    given = [field for field in NET_FIELDS if getattr(p, field)]
    if len(given) != 1:
        raise PrototxtError(
            schema.position_of(p, given[1] if given else None),
            f"expected one of {', '.join(NET_FIELDS)}; found {', '.join(given) or 'none'}",
        )
    return _load(getattr(p, given[0]), source)


def test_nets(p: SolverParameter, source: str) -> list[tuple[str, NetParameter]]:
    """Load the test nets: test_net_param, test_net, then ``net`` for the remaining
    entries of test_iter.
    """
    nets: list[str | Message] = [*p.test_net_param, *p.test_net]
    default = p.net if p.net_param is None else p.net_param
    if default is not None:
        nets += [default] * (len(p.test_iter) - len(nets))
    if nets and not p.test_interval:
        raise PrototxtError(
            schema.position_of(p, "test_iter" if p.test_iter else None),
            f"{len(nets)} test nets, but no test_interval; expected at least 1",
        )
    for field in ("test_iter", "test_state"):
        count = len(getattr(p, field))
        is_required = field == "test_iter" and p.test_interval
        if count != len(nets) and (count or is_required):
            raise PrototxtError(
                schema.position_of(p, field),
                f"{count} {field} for {len(nets)} test nets; expected one each",
            )
    return [_load(net, source) for net in nets]


def _load(net: str | Message, source: str) -> tuple[str, NetParameter]:
    """Load the net that a field of the solver in ``source`` names or contains."""
    if isinstance(net, Message):
        return "net_param", load_parameter(net)
    path = find(net, source)
    if not exists(path):
        raise NetlibError(
            f"{source}: the net {net!r} does not exist in the working directory or next to the solver"
        )
    return str(path), load_parameter(path)
