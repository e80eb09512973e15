"""Errors about the names of blobs that a layer reads and writes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence, Set

from netlib.errors import LayerError, did_you_mean
from netlib.layer import Layer
from netlib.proto import schema
from netlib.proto.messages import LayerParameter, NetState


def unknown_bottom(
    layer: Layer, index: int, known: Iterable[str], excluded: Set[str], state: NetState
) -> LayerError:
    """The error for a bottom that no layer before has written.

    known     the names of blobs
    excluded  tops of the layers that ``state`` excludes
    """
    name = layer.spec.bottom[index]
    advice = did_you_mean(name, known)
    if name in excluded:
        stages = ", ".join(state.stage) or "none"
        where = f"phase {state.phase}, level {state.level}, stages: {stages}"
        advice = f"; the layers that write it are excluded in {where}"
    elif known and not advice:
        advice = f"; known here: {', '.join(known)}"
    place = schema.position_of(layer.spec, "bottom", index)
    return LayerError(f"{place}: error: layer {layer.name!r}: unknown bottom blob {name!r}{advice}")


def taken_top(
    layer: Layer, index: int, owner: str, writers: Sequence[LayerParameter]
) -> LayerError:
    """The error for a top that layer ``owner`` writes.

    writers  the layer that writes the bottom in the same place, if there is one
    """
    name = layer.spec.top[index]
    advice = f"or that of the bottom in the same place ({index}) to run in place"
    if any(writer.type == "Split" and writer.bottom == (name,) for writer in writers):
        advice = "as a layer that runs in place must be the only reader of its bottom"
    return layer.fail(
        f"top blob {name!r} is already written by layer {owner!r}; give it another name, {advice}"
    )
