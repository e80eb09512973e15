"""Give each reader of a blob its own copy, so that no two layers write the same diff.

As in Caffe, a ``Split`` layer is inserted where several layers read a top; its backward sums the diffs. Names are
Caffe's. A loss weight on such a top counts as another reader.
"""

from __future__ import annotations

from collections.abc import Sequence

from netlib.proto import schema
from netlib.proto.messages import LayerParameter
from netlib.proto.prototxt import Message


def insert_splits(layers: Sequence[LayerParameter]) -> list[LayerParameter]:
    """Insert a Split layer after every top that has more than one reader."""
    last: dict[str, tuple[int, int]] = {}  # blob name -> (layer, top index) that wrote it last
    source: dict[tuple[int, int], tuple[int, int]] = {}  # (layer, bottom index) -> its writer
    readers: dict[tuple[int, int], int] = {}
    for i, layer in enumerate(layers):
        for j, name in enumerate(layer.bottom):
            if name in last:  # the net reports unknown bottoms, with better advice
                source[i, j] = last[name]
                readers[last[name]] = readers.get(last[name], 0) + 1
        for j, name in enumerate(layer.top):
            last[name] = (i, j)
            if j < len(layer.loss_weight) and layer.loss_weight[j]:
                readers[i, j] = readers.get((i, j), 0) + 1
    result: list[LayerParameter] = []
    taken: dict[tuple[int, int], int] = {}
    for i, layer in enumerate(layers):
        bottoms = list(layer.bottom)
        for j, name in enumerate(layer.bottom):
            writer = source.get((i, j))
            if writer is not None and readers[writer] > 1:
                k = taken.get(writer, 0)
                taken[writer] = k + 1
                bottoms[j] = _split_top(layers[writer[0]].name, name, writer[1], k)
        weights = list(layer.loss_weight)
        splits: list[LayerParameter] = []
        for j, name in enumerate(layer.top):
            count = readers.get((i, j), 0)
            if count < 2:
                continue
            weight = weights[j] if j < len(weights) else 0.0
            if weight:  # the first copy carries the loss
                weights[j] = 0.0
                taken[i, j] = taken.get((i, j), 0) + 1
            split = LayerParameter(
                name=f"{name}_{layer.name}_{j}_split",
                type="Split",
                bottom=(name,),
                top=tuple(_split_top(layer.name, name, j, k) for k in range(count)),
                loss_weight=(weight,) + (0.0,) * (count - 1) if weight else (),
            )
            splits.append(schema.placed(split, Message([], schema.position_of(layer))))
        result += [schema.changed(layer, bottom=tuple(bottoms), loss_weight=tuple(weights)), *splits]
    return result


def _split_top(layer: str, blob: str, top: int, k: int) -> str:
    return f"{blob}_{layer}_{top}_split_{k}"
