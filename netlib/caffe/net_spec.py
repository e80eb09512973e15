"""caffe.net_spec: nets written in Python instead of prototxt.

    from caffe import layers as L, params as P

    n = caffe.NetSpec()
    n.data = L.Input(shape=dict(dim=[1, 3, 32, 32]))
    n.conv = L.Convolution(n.data, kernel_size=5, num_output=20)
    n.pool = L.Pooling(n.conv, kernel_size=2, stride=2, pool=P.Pooling.MAX)
    text = str(n.to_proto())

``L.Type(bottoms, options)`` defines a layer and returns its tops; nothing is computed. ``ntop`` is
the number of tops (1); with ``in_place`` the tops are the bottoms. Other options are fields of the
type's block (``convolution_param``) or, if the block lacks them, of the layer itself. A list is a
repeated field, a dict is a message.
"""

from __future__ import annotations

import functools
from collections import Counter, OrderedDict
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from netlib.caffe import proto
from netlib.errors import NetlibError, did_you_mean, meant_or_known
from netlib.proto.options import block_name, layer_types


class SpecError(NetlibError):
    """An invalid net specification."""


class NotATopError(SpecError, TypeError):
    """An input of a layer, or a value in a NetSpec, that is not the output of a layer."""


class UnknownNameError(SpecError, AttributeError, KeyError):
    """An unknown option, constant or top."""

    __str__ = Exception.__str__  # KeyError would show the repr of the message


class OptionValueError(SpecError, TypeError, ValueError):
    """A value that is invalid for its option."""


# ----------------------------------------------------------------------------- a layer and its tops


class Top:
    """An output of a layer: the ``n``-th of ``fn``."""

    def __init__(self, fn: Function, n: int) -> None:
        self.fn = fn
        self.n = n

    def to_proto(self) -> Any:
        """Build the NetParameter of all layers that this output depends on."""
        return to_proto(self)


class Function:
    """A layer: its type, its input tops and its options.

    Raises NotATopError if an input is not a Top.

    ``params`` are the given options without ``ntop`` and ``in_place``; ``tops`` are its outputs.
    """

    def __init__(self, type_name: str, inputs: Iterable[Top], params: dict[str, Any]) -> None:
        self.type_name = type_name
        self.inputs = tuple(inputs)
        for index, found in enumerate(self.inputs):
            if not isinstance(found, Top):
                raise NotATopError(
                    f"{type_name} input {index} is not a Top (type is {type(found)})"
                )
        self.params = params
        self.ntop: int = params.pop("ntop", 1)
        self.in_place: bool = params.pop("in_place", False)
        self.tops = tuple(Top(self, n) for n in range(self.ntop))


Made = dict[Function, Any]  # layer -> its LayerParameter
Names = dict[Any, str]  # top, or layer without tops -> its name


def to_proto(*tops: Top | Function) -> Any:
    """Build the NetParameter of all layers that these tops depend on, named by type:
    Convolution1, Convolution2.

    Raises SpecError for options that a layer type does not have.
    """
    return _net(tops, {})


def _net(tops: Iterable[Top | Function], names: Names) -> Any:
    """Build a net, each layer after those that it reads.

    ``names`` is extended by generated names.
    """
    made: Made = {}
    counts: Counter[str] = Counter()
    for top in tops:
        # not recursive: deep nets exceed the recursion limit
        waiting = [top.fn if isinstance(top, Top) else top]
        while waiting:
            unmade = [bottom.fn for bottom in waiting[-1].inputs if bottom.fn not in made]
            if unmade:
                waiting.append(unmade[0])
                continue
            fn = waiting.pop()
            if fn not in made:
                made[fn] = _layer(fn, made, names, counts)
    net = proto.caffe_pb2.NetParameter()
    net.layer.extend(made.values())
    return net


def _layer(fn: Function, made: Made, names: Names, counts: Counter[str]) -> Any:
    """The LayerParameter of a layer whose input layers are in ``made``."""
    named = fn.tops[:1] if fn.in_place else fn.tops
    for unnamed in [one for one in named or [fn] if one not in names]:
        counts[fn.type_name] += 1
        names[unnamed] = f"{fn.type_name}{counts[fn.type_name]}"
    layer = proto.caffe_pb2.LayerParameter()
    layer.type = fn.type_name
    layer.name = names[fn] if fn in names else names[fn.tops[0]]
    layer.bottom.extend([made[bottom.fn].top[bottom.n] for bottom in fn.inputs])
    layer.top.extend(list(layer.bottom) if fn.in_place else [names[top] for top in fn.tops])
    for option, value in fn.params.items():
        try:
            assign_proto(_holder(layer, option), option, value)
        except SpecError as error:
            raise type(error)(f"layer {layer.name!r} ({fn.type_name}): {error}") from None
    return layer


def _holder(layer: Any, option: str) -> Any:
    """The message that contains an option of a layer: the block of the layer's
    type, or the layer.
    """
    fields = layer.DESCRIPTOR.fields_by_name
    if option.endswith("param"):
        return layer
    block = f"{param_name_dict().get(layer.type)}_param"
    own = fields[block].message_type.fields_by_name if block in fields else {}
    if option in own:
        return getattr(layer, block)
    if option in fields:
        return layer
    others = [name for name in _blocks_of(layer.type) if name in fields]
    for name in others:
        if option in fields[name].message_type.fields_by_name:
            raise UnknownNameError(
                f"option {option!r} is in another block; write {name}=dict({option}=...)"
            )
    known = [*own, *(f"{name}=dict(...)" for name in others if name != block)]
    advice = did_you_mean(option, own) or (
        f"; its options: {', '.join(known)}" if known else "; it has none"
    )
    raise UnknownNameError(f"unknown option {option!r}{advice}")


def _blocks_of(type_name: str) -> list[str]:
    """The blocks that a layer type reads."""
    cls = layer_types().get(type_name)
    if cls is None:
        return []
    return [block_name(cls, type_name), *cls.other_blocks]


def assign_proto(proto: Any, name: str, val: Any) -> None:
    """Set a field of a message from a Python value: a list for a repeated field, a dict
    for a message.

    A single value for a repeated field is treated as a list of one. Raises SpecError.
    """
    fields = proto.DESCRIPTOR.fields_by_name
    if name not in fields:
        advice = meant_or_known(name, fields, "it has")
        raise UnknownNameError(f"{proto.DESCRIPTOR.name} has no field {name!r}{advice}")
    message = fields[name].message_type
    target = getattr(proto, name)
    if hasattr(target, "extend"):
        for one in val if isinstance(val, (list, tuple)) else [val]:
            if message is not None and isinstance(one, Mapping):
                _assign_all(target.add(), one)
            else:
                _checked(proto, name, target.append, one)
    elif message is not None and isinstance(val, Mapping):
        _assign_all(target, val)
    elif message is not None:
        _checked(proto, name, target.CopyFrom, val)
    else:
        _checked(proto, name, lambda value: setattr(proto, name, value), val)


def _assign_all(proto: Any, values: Mapping[str, Any]) -> None:
    for name, value in values.items():
        assign_proto(proto, name, value)


def _checked(proto: Any, name: str, put: Callable[[Any], object], value: Any) -> None:
    try:
        put(value)
    except (TypeError, ValueError, AttributeError) as error:
        text = str(error) or type(error).__name__
        raise OptionValueError(
            f"{name!r} of {proto.DESCRIPTOR.name} cannot be {value!r}: {text}"
        ) from None


@functools.cache
def param_name_dict() -> dict[str, str]:
    """Layer types with the names of their blocks, without the suffix: ``{"InnerProduct":
    "inner_product", ...}``.
    """
    return {
        field.message_type.name.removesuffix("Parameter"): name.removesuffix("_param")
        for name, field in proto.caffe_pb2.LayerParameter.DESCRIPTOR.fields_by_name.items()
        if name.endswith("_param")
    }


# ----------------------------------------------------------------------------------- public classes


class NetSpec:
    """A net whose tops are named by the attributes, or items, that they are assigned to."""

    tops: OrderedDict[str, Any]

    def __init__(self) -> None:
        object.__setattr__(self, "tops", OrderedDict())

    def __setattr__(self, name: str, value: Any) -> None:
        self.tops[name] = value

    def __getattr__(self, name: str) -> Any:
        tops = self.__dict__.get("tops", {})
        if name not in tops:
            raise UnknownNameError(f"this net has no top {name!r}{did_you_mean(name, tops)}")
        return tops[name]

    def __setitem__(self, key: str, value: Any) -> None:
        self.tops[key] = value

    def __getitem__(self, item: str) -> Any:
        return NetSpec.__getattr__(self, item)

    def __delitem__(self, name: str) -> None:
        del self.tops[name]

    def keys(self) -> list[str]:
        """The names of the tops; as in SSD's NetSpec, like ``vals`` and ``update``."""
        return list(self.tops)

    def vals(self) -> list[Any]:
        """The tops."""
        return list(self.tops.values())

    def update(self, name: str, params: Mapping[str, Any]) -> None:
        """Set options of the layer that makes a top."""
        self[name].fn.params.update(params)

    def to_proto(self) -> Any:
        """Build the NetParameter of all layers that the tops depend on. Raises SpecError."""
        for name, top in self.tops.items():
            if not isinstance(top, (Top, Function)):
                raise NotATopError(
                    f"{name!r} of the net is not a Top (type is {type(top)}); "
                    "unpack a layer with several tops: n.data, n.label = L.HDF5Data(..., ntop=2)"
                )
        return _net(self.tops.values(), {top: name for name, top in self.tops.items()})


class Layers:
    """``layers.Type(*bottoms, **options)`` defines a layer.

    Returns its top or tops, or the layer if ntop is 0.
    """

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name.startswith("__"):
            raise AttributeError(name)

        def layer_fn(*args: Any, **kwargs: Any) -> Any:
            fn = Function(name, args, kwargs)
            return fn if fn.ntop == 0 else fn.tops[0] if fn.ntop == 1 else fn.tops

        return layer_fn


class Parameters:
    """``params.Pooling.MAX``: the enum constants in the options of a layer type."""

    def __getattr__(self, name: str) -> _Constants:
        if name.startswith("__"):
            raise AttributeError(name)
        return _Constants(name)


class _Constants:
    """The enum values of one message."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, param_name: str) -> int:
        if param_name.startswith("__"):
            raise AttributeError(param_name)
        message = f"{self._name}Parameter"
        known = proto.caffe_pb2.DESCRIPTOR.message_types_by_name
        if message not in known:
            names = [name.removesuffix("Parameter") for name in known if name.endswith("Parameter")]
            raise UnknownNameError(f"params has no {self._name!r}{did_you_mean(self._name, names)}")
        enums = known[message].enum_types_by_name.values()
        values = {
            name: value.number for enum in enums for name, value in enum.values_by_name.items()
        }
        if param_name not in values:
            advice = meant_or_known(param_name, values or ["no constants"], "it has")
            raise UnknownNameError(f"params.{self._name} has no {param_name!r}{advice}")
        return values[param_name]


layers = Layers()
params = Parameters()
