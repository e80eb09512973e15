"""Checks JSON values against docs/hands.schema.json, by the keywords of JSON Schema that
this file uses.
"""

from __future__ import annotations

import functools
import json
from typing import Any

from tests.support.running import ROOT

KINDS = {
    "object": dict,
    "array": list,
    "string": str,
    "boolean": bool,
    "null": type(None),
    "integer": int,
}
KNOWN = {
    "$schema",
    "title",
    "description",
    "$defs",
    "$ref",
    "allOf",
    "anyOf",
    "type",
    "const",
    "enum",
    "required",
    "properties",
    "additionalProperties",
    "items",
    "minItems",
    "maxItems",
    "minimum",
    "maximum",
    "exclusiveMinimum",
}


@functools.cache
def schema() -> dict[str, Any]:
    """The file."""
    return json.loads((ROOT / "docs" / "hands.schema.json").read_text(encoding="utf-8"))


def faults(value: Any, part: str = "") -> list[str]:
    """What is wrong with a document, or with a ``header`` or ``frame``, a line each."""
    return _faults(value, schema()["$defs"][part] if part else schema(), "")


def _faults(value: Any, rule: dict[str, Any], at: str) -> list[str]:
    assert rule.keys() <= KNOWN, rule.keys() - KNOWN
    found: list[str] = []
    named = [schema()["$defs"][rule["$ref"].rpartition("/")[2]]] if "$ref" in rule else []
    for each in [*rule.get("allOf", []), *named]:
        found += _faults(value, each, at)
    if "anyOf" in rule and all(_faults(value, each, at) for each in rule["anyOf"]):
        found.append(f"{at}: none of {len(rule['anyOf'])} kinds")
    kinds = rule.get("type", [])
    if kinds and not any(
        _is(value, kind) for kind in ([kinds] if isinstance(kinds, str) else kinds)
    ):
        return [*found, f"{at}: {value!r} is not {kinds}"]
    if ("const" in rule and value != rule["const"]) or (
        "enum" in rule and value not in rule["enum"]
    ):
        found.append(f"{at}: {value!r}")
    if isinstance(value, dict):
        known, other = rule.get("properties", {}), rule.get("additionalProperties", True)
        found += [f"{at}: no {key}" for key in rule.get("required", []) if key not in value]
        for key, item in value.items():
            if key in known or isinstance(other, dict):
                found += _faults(item, known.get(key, other), f"{at}/{key}")
            elif not other:
                found.append(f"{at}: unknown {key}")
    if isinstance(value, list):
        if not rule.get("minItems", 0) <= len(value) <= rule.get("maxItems", len(value)):
            found.append(f"{at}: {len(value)} items")
        for i, item in enumerate(value if "items" in rule else []):
            found += _faults(item, rule["items"], f"{at}/{i}")
    if _is(value, "number"):
        low, high = rule.get("minimum", value), rule.get("maximum", value)
        if not low <= value <= high or not value > rule.get("exclusiveMinimum", value - 1):
            found.append(f"{at}: {value}")
    return found


def _is(value: Any, kind: str) -> bool:
    if kind == "number":
        return isinstance(value, int | float) and not isinstance(value, bool)
    return isinstance(value, KINDS[kind]) and (kind == "boolean" or not isinstance(value, bool))
