"""The lines of Caffe's log about a training: losses, outputs of nets, debug_info."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from netlib.blob import Array
from netlib.net import Net

log = logging.getLogger("netlib")


def copied(source: object, ignored: Iterable[str], missing: Iterable[str]) -> None:
    """What ``Net.copy_from`` left out: layers of the source, and layers of the net."""
    for name in ignored:
        log.info("Ignoring source layer %s", name)
    for name in missing:
        log.info("Not in %s, keeps its initial values: layer %s", source, name)


def outputs(what: str, net: Net, values_of: Mapping[str, Array]) -> None:
    """``    Train net output #0: loss = 0.86 (* 1 = 0.86 loss)``, a line for each value of each output."""
    for number, score in enumerate(scores(net, values_of)):
        log.info("    %s net output #%d: %s", what, number, score)


def scores(net: Net, values_of: Mapping[str, Array]) -> Iterator[str]:
    """``loss = 0.86 (* 1 = 0.86 loss)`` for each value of each output."""
    weights = {name: weight for _, weight, name in net.losses}
    for name, values in values_of.items():
        weight = weights.get(name)
        for value in values.reshape(-1):
            tail = f" (* {weight:.6g} = {weight * value:.6g} loss)" if weight else ""
            yield f"{name} = {value:.6g}{tail}"


def debug(net: Net) -> None:
    """Mean absolute values of everything, Caffe's debug_info."""
    for at in net.connections:
        for name, blob in zip(at.layer.spec.top, at.top):
            log.info("    [Forward] Layer %s, top blob %s data: %.6g", at.layer.name, name, _mean(blob.data))
    for at in reversed(net.connections):
        if not at.needs_backward:
            continue
        for name, blob, down in zip(at.layer.spec.bottom, at.bottom, at.propagate_down):
            if down:
                log.info("    [Backward] Layer %s, bottom blob %s diff: %.6g", at.layer.name, name, _mean(blob.diff))
    for p in net.learnable:
        log.info("    [Update] Layer %s, param %d data: %.6g; diff: %.6g",
                 p.layer, p.index, _mean(p.blob.data), _mean(p.blob.diff))  # fmt: skip


def _mean(array: Any) -> float:
    return float(np.abs(array).mean()) if array.size else 0.0
