"""Checks JSON values against docs/hands.schema.json."""

from __future__ import annotations

import functools
import json
from typing import Any

import jsonschema

from tests.support.running import ROOT


@functools.cache
def validator(part: str) -> Any:
    schema = json.loads((ROOT / "docs" / "hands.schema.json").read_text(encoding="utf-8"))
    if part:
        schema = {**schema["$defs"][part], "$defs": schema["$defs"]}
    checker = jsonschema.validators.validator_for(schema, jsonschema.Draft202012Validator)
    checker.check_schema(schema)
    return checker(schema)


def faults(value: Any, part: str = "") -> list[str]:
    """What is wrong with a document, or with a ``header`` or ``frame``, a line each."""
    errors = validator(part).iter_errors(value)
    return [f"{error.json_path}: {error.message}" for error in errors]
