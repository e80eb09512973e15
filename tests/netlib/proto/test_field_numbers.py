"""The numbers of fields and enum values in binary files are those of Caffe's caffe.proto."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from typing import Any

from netlib.proto import messages, schema, upgrade
from netlib.proto.options import option_blocks
from netlib.proto.prototxt import Message

Fields = dict[str, tuple[int, dict[str, int]]]  # field name -> its number and its enum values
# dataclasses with other names than in Caffe
CALLED = {"Filler": "FillerParameter", "AnyNetParameter": "NetParameter"}


def caffe_fields() -> dict[str, Fields]:
    """Read the table ``field_numbers.txt`` by message."""
    found: dict[str, Fields] = {}
    fields: Fields = {}
    for line in (
        (Path(__file__).parent / "field_numbers.txt").read_text(encoding="utf-8").splitlines()
    ):
        if match := re.fullmatch(r"  (\d+) (\w+)(?:: (.*))?", line):
            values = [value.split() for value in (match[3] or "").split(", ") if value]
            fields[match[2]] = int(match[1]), {name: int(number) for name, number in values}
        elif not line.startswith("#"):
            fields = found.setdefault(line, {})
    return found


def own_messages() -> set[type]:
    """Return every message class that a file can contain, including nested ones."""
    left = [
        cls
        for cls in vars(messages).values()
        if getattr(cls, "__module__", "") == messages.__name__
    ]
    left += [upgrade.V1LayerParameter, upgrade.AnyNetParameter]
    left += option_blocks().values()
    found: set[type] = set()
    while left:
        if (cls := left.pop()) not in found:
            found.add(cls)
            kinds = [info.kind for info in schema.fields_of(cls).values()]
            left += [kind for kind in kinds if schema.is_message(kind) and kind is not Message]
    return found


def own_fields() -> dict[str, Fields]:
    """Return the same table as caffe_fields, from the dataclasses."""
    found: dict[str, Fields] = {}
    for cls in own_messages():
        fields = found.setdefault(CALLED.get(cls.__name__, cls.__name__), {})
        for name, info in schema.fields_of(cls).items():
            fields[name] = (info.number, dict(schema.enum_of(info.kind)))
        options: Any = dataclasses.fields(cls)  # type: ignore[arg-type]
        for field in options:
            fields.update(
                {block: (number, {}) for block, number in field.metadata.get("numbers", {}).items()}
            )
    return found


def test_every_number_is_that_of_caffe() -> None:
    table, own = caffe_fields(), own_fields()
    assert sum(len(fields) for fields in table.values()) > 390
    assert own.keys() == table.keys()
    for message, fields in table.items():
        assert own[message] == fields, message


def test_every_options_block_has_a_number_and_is_the_message_that_its_name_says() -> None:
    """The class of each options block is named after it: ``lrn_param`` is an LRNParameter."""
    assert option_blocks().keys() == messages.BLOCKS.keys()
    called = {"transform_param": "transformation", "norm_param": "normalize"}
    for block, cls in option_blocks().items():
        name = called.get(block, block.removesuffix("_param").replace("_", ""))
        assert cls.__name__.lower() == f"{name}parameter", block
