"""Reading a net's prototxt, selecting its layers by phase, level and stages, and
inserting Split layers.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from netlib.errors import PrototxtError
from netlib.proto import prototxt, schema
from netlib.proto.messages import BlobShape, LayerParameter, NetParameter, NetState, NetStateRule
from netlib.proto.prototxt import Field, Message
from netlib.proto.upgrade import upgraded

SOLVER_FIELDS = {"net", "train_net", "base_lr", "lr_policy", "max_iter"}
OLD_AXES = 4  # number of input_dim for one shape
Slot = tuple[int, int]  # a top or a bottom: index of the layer, index in its list


def load_parameter(model: str | Path | NetParameter | Message) -> NetParameter:
    """Read a net. Raises PrototxtError if it is invalid or has no layers."""
    if isinstance(model, NetParameter):
        return model
    tree = model if isinstance(model, Message) else prototxt.parse_file(model)
    if tree.named(*SOLVER_FIELDS):
        raise PrototxtError(tree.position, "this is a solver; expected a net")
    tree = upgraded(tree)
    param = schema.read(tree, NetParameter, "net")
    if not param.layer and not param.input:
        raise PrototxtError(tree.position, "this file has no layers; expected a net")
    return param


def distinct(names: Sequence[str]) -> list[str]:
    """Make names unique by numbering repeated ones: ``relu``, ``relu (2)``."""
    counts: dict[str, int] = {}
    taken = set(names)
    result = []
    for name in names:
        unique = name
        # the file itself may have a layer named ``relu (2)``
        while name in counts and unique in taken:
            counts[name] += 1
            unique = f"{name} ({counts[name]})"
        counts.setdefault(name, 1)
        taken.add(unique)
        result.append(unique)
    return result


def select_layers(param: NetParameter, state: NetState) -> list[LayerParameter]:
    """The layers of a net in this state; old-style inputs are converted to an Input layer.

    As in Caffe, an input without a shape is dropped if a layer, such as an Input layer in the same
    file, has this top.
    """
    has_shapes = param.input_shape or param.input_dim
    selected = []
    if param.input and (has_shapes or not tops_of(param.layer).issuperset(param.input)):
        selected.append(input_layer(param))
    for spec in param.layer:
        if spec.include and spec.exclude:
            raise PrototxtError(
                schema.position_of(spec), f"layer {spec.name!r} has both include and exclude rules"
            )
        is_included = not spec.include or any(meets(state, rule) for rule in spec.include)
        if is_included and not any(meets(state, rule) for rule in spec.exclude):
            selected.append(spec)
    return selected


def tops_of(layers: Iterable[LayerParameter]) -> set[str]:
    """The names of all tops."""
    return {top for spec in layers for top in spec.top}


def meets(state: NetState, rule: NetStateRule) -> bool:
    """Whether a state meets every condition of a rule."""
    stages = set(state.stage)
    return (
        (rule.phase is None or rule.phase == state.phase)
        and (rule.min_level is None or state.level >= rule.min_level)
        and (rule.max_level is None or state.level <= rule.max_level)
        and stages.issuperset(rule.stage)
        and stages.isdisjoint(rule.not_stage)
    )


def input_layer(param: NetParameter) -> LayerParameter:
    """Convert old-style inputs, ``input: "x" input_dim: 1 ...`` or ``input_shape``, to
    an Input layer.
    """
    place = schema.position_of(param, "input")
    count = len(param.input)
    dims = param.input_dim
    shapes = param.input_shape
    if not shapes:
        if len(dims) % OLD_AXES:
            raise PrototxtError(
                place, f"{len(dims)} input_dim; expected four for all inputs or four per input"
            )
        starts = range(0, len(dims), OLD_AXES)
        shapes = tuple(BlobShape(dims[i : i + OLD_AXES]) for i in starts)
    if len(shapes) not in (1, count):
        raise PrototxtError(
            place,
            f"{count} inputs, but {len(shapes)} input_shape; expected one for all or one per input",
        )
    block = Message([Field("shape", schema.to_tree(shape), place) for shape in shapes], place)
    layer = LayerParameter(
        name="input", type="Input", top=param.input, blocks={"input_param": block}
    )
    return schema.placed(layer, Message([], place))


def insert_splits(layers: Sequence[LayerParameter]) -> list[LayerParameter]:
    """Insert a Split layer after every top that has more than one reader, so that no two layers
    write the same diff.

    As in Caffe, its backward sums the diffs. Names are Caffe's. A loss weight on such a top counts
    as another reader.
    """
    readers = _readers(layers)
    bottoms = [list(layer.bottom) for layer in layers]
    result: list[LayerParameter] = []
    for i, layer in enumerate(layers):
        weights = list(layer.loss_weight)
        splits: list[LayerParameter] = []
        for j in range(len(layer.top)):
            if len(readers[i, j]) < 2:
                continue
            split = _split(layer, j, len(readers[i, j]))
            for reader, copy in zip(readers[i, j], split.top):
                if reader is None:  # the first copy carries the loss
                    weights[j] = 0.0
                else:
                    bottoms[reader[0]][reader[1]] = copy
            splits.append(split)
        changes = {"bottom": tuple(bottoms[i]), "loss_weight": tuple(weights)}
        result += [schema.changed(layer, **changes), *splits]
    return result


def _readers(layers: Sequence[LayerParameter]) -> dict[Slot, list[Slot | None]]:
    """The bottoms that read each top, in order, after None if the loss reads it.

    Unknown bottoms are left out. The net reports them, with better advice.
    """
    writers: dict[str, Slot] = {}  # blob name -> the top that wrote it last
    readers: dict[Slot, list[Slot | None]] = {}
    for i, layer in enumerate(layers):
        for j, name in enumerate(layer.bottom):
            if name in writers:
                readers[writers[name]].append((i, j))
        for j, name in enumerate(layer.top):
            writers[name] = (i, j)
            readers[i, j] = [None] if any(layer.loss_weight[j : j + 1]) else []
    return readers


def _split(layer: LayerParameter, j: int, count: int) -> LayerParameter:
    """The Split of top ``j``: ``count`` copies, the first with the top's loss weight, if any."""
    name = layer.top[j]
    split_name = f"{name}_{layer.name}_{j}_split"
    copies = tuple(f"{split_name}_{k}" for k in range(count))
    weight = layer.loss_weight[j : j + 1]
    weights = (*weight, *[0.0] * (count - 1)) if any(weight) else ()
    split = LayerParameter(
        name=split_name, type="Split", bottom=(name,), top=copies, loss_weight=weights
    )
    return schema.placed(split, Message([], schema.position_of(layer)))
