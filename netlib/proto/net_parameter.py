"""Reading a net's prototxt, selecting its layers by phase, level and stages, and
inserting Split layers.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from netlib.errors import PrototxtError
from netlib.proto import prototxt, schema
from netlib.proto.messages import BlobShape, LayerParameter, NetParameter, NetState, NetStateRule
from netlib.proto.prototxt import Field, Message
from netlib.proto.upgrade import upgraded

SOLVER_FIELDS = {"net", "train_net", "base_lr", "lr_policy", "max_iter"}


def load_parameter(model: str | Path | NetParameter | Message) -> NetParameter:
    """Read a net. Raises PrototxtError if it is invalid or has no layers."""
    if isinstance(model, NetParameter):
        return model
    tree = model if isinstance(model, Message) else prototxt.parse_file(model)
    if SOLVER_FIELDS & {item.name for item in tree.fields}:
        raise PrototxtError(tree.position, "this is a solver; expected a net")
    tree = upgraded(tree)
    param = schema.read(tree, NetParameter, "net")
    if not param.layer and not param.input:
        raise PrototxtError(tree.position, "this file has no layers; expected a net")
    return param


def distinct(names: Sequence[str]) -> list[str]:
    """Make names unique by numbering repeated ones: ``relu``, ``relu (2)``."""
    seen: dict[str, int] = {}
    taken, result = set(names), []
    for name in names:
        made = name
        while name in seen and made in taken:  # the file itself may have a layer named ``relu (2)``
            seen[name] += 1
            made = f"{name} ({seen[name]})"
        seen.setdefault(name, 1)
        taken.add(made)
        result.append(made)
    return result


def select_layers(param: NetParameter, state: NetState) -> list[LayerParameter]:
    """The layers of a net in this state; old-style inputs are converted to an Input layer.

    As in Caffe, an input without a shape is dropped if a layer, such as an Input layer in the same
    file, has this top.
    """
    made = {top for spec in param.layer for top in spec.top}
    is_dropped = not param.input_shape and not param.input_dim and made.issuperset(param.input)
    chosen = [input_layer(param)] if param.input and not is_dropped else []
    for spec in param.layer:
        if spec.include and spec.exclude:
            raise PrototxtError(
                schema.position_of(spec), f"layer {spec.name!r} has both include and exclude rules"
            )
        if spec.include:
            wanted = any(meets(state, rule) for rule in spec.include)
        else:
            wanted = not any(meets(state, rule) for rule in spec.exclude)
        if wanted:
            chosen.append(spec)
    return chosen


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
    where = schema.position_of(param, "input")
    shapes = param.input_shape
    if not shapes:
        shapes = tuple(
            BlobShape(param.input_dim[i : i + 4]) for i in range(0, len(param.input_dim), 4)
        )
        if len(param.input_dim) % 4:
            found = (
                f"{len(param.input_dim)} input_dim; expected four for all inputs or four per input"
            )
            raise PrototxtError(where, found)
    if len(shapes) not in (1, len(param.input)):
        raise PrototxtError(
            where,
            f"{len(param.input)} inputs, but {len(shapes)} input_shape; expected one for all or one per input",
        )
    block = Message([Field("shape", schema.to_tree(shape), where) for shape in shapes], where)
    layer = LayerParameter(
        name="input", type="Input", top=param.input, blocks={"input_param": block}
    )
    return schema.placed(layer, Message([], where))


def insert_splits(layers: Sequence[LayerParameter]) -> list[LayerParameter]:
    """Insert a Split layer after every top that has more than one reader, so that no two layers
    write the same diff.

    As in Caffe, its backward sums the diffs. Names are Caffe's. A loss weight on such a top counts
    as another reader.
    """
    bottoms = [list(layer.bottom) for layer in layers]
    last: dict[str, tuple[int, int]] = {}  # blob name -> (layer, top index) that wrote it last
    # (layer, top index) -> its readers: (layer, bottom index), or None for the loss
    readers: dict[tuple[int, int], list[tuple[int, int] | None]] = {}
    for i, layer in enumerate(layers):
        for j, name in enumerate(layer.bottom):
            if name in last:  # the net reports unknown bottoms, with better advice
                readers[last[name]].append((i, j))
        for j, name in enumerate(layer.top):
            last[name] = (i, j)
            readers[i, j] = [None] if any(layer.loss_weight[j : j + 1]) else []
    result: list[LayerParameter] = []
    for i, layer in enumerate(layers):
        weights, splits = list(layer.loss_weight), list[LayerParameter]()
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


def _split(layer: LayerParameter, j: int, count: int) -> LayerParameter:
    """The Split of a top: ``count`` copies, the first with the top's loss weight, if it has one."""
    name = layer.top[j]
    own = f"{name}_{layer.name}_{j}_split"
    copies = tuple(f"{own}_{k}" for k in range(count))
    weight = layer.loss_weight[j : j + 1]
    weights = (*weight, *[0.0] * (count - 1)) if any(weight) else ()
    split = LayerParameter(name=own, type="Split", bottom=(name,), top=copies, loss_weight=weights)
    return schema.placed(split, Message([], schema.position_of(layer)))
