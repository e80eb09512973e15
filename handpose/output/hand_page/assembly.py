"""The hand page as one file: HTML, style, modules and data in one text that needs no network.

The sources in this folder are ECMAScript modules. In the one file each becomes a function that is
called once, in the order in which they import each other:

    import { add } from "./vectors.js";    const { add } = modules.vectors;
    export function forward(skeleton) {    function forward(skeleton) {   ...   return { forward };

A Content-Security-Policy allows only this script and this style, by their hashes, and no requests.
The data (values.py) are JSON with all characters escaped that are special in HTML.
"""

from __future__ import annotations

import base64
import hashlib
import html
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from string import Template
from typing import Any

from handpose.frames.cameras import CAMERAS

FOLDER = Path(__file__).parent
_IMPORT = re.compile(r'^import \{([^}]*)\} from "\./(\w+)\.js";$', re.MULTILINE)
_EXPORT = re.compile(r"^export ((?:async )?(?:class|function|const) (\w+))", re.MULTILINE)


def page(
    title: str, bodies: Sequence[Mapping[str, Any]], hands: Sequence[Mapping[str, Any]] = ()
) -> str:
    """The page of bodies and predicted hands (``values.body``, ``values.hand``), ready to be
    written.

    Raises ValueError for numbers that JSON lacks.
    """
    data = {
        "bodies": bodies,
        "cameras": [vars(camera) for camera in CAMERAS.values()],
        "hands": hands,
    }
    return assembled(title, data, source("page.html"), source("page.css"), script_of("main"))


def assembled(
    title: str, data: Mapping[str, Any], body: str, style: str, script: str, connects: bool = False
) -> str:
    """A page with this HTML in its body, which may contain $title; one that ``connects`` may
    contact its server.
    """
    policy = _policy(script, style, connects)
    frame = Template(source("frame.html").replace("$main\n", body))
    return frame.substitute(
        title=html.escape(title), policy=policy, style=style, script=script, data=escaped(data)
    )


def escaped(data: Mapping[str, Any]) -> str:
    """The data as JSON that can be embedded in HTML: it cannot begin a tag, a
    comment or an entity.
    """
    text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def script_of(first: str, *folders: Path) -> str:
    """A module and all its imports as one script.

    Modules are searched in ``folders``, then here.
    """
    parts: dict[str, str] = {}
    _add(first, parts, folders)
    return "\nconst modules = {};\n" + "\n".join(parts.values())


def _add(name: str, parts: dict[str, str], folders: tuple[Path, ...]) -> None:
    """Add a module to ``parts``, after those that it imports."""
    text = source(f"{name}.js", *folders)
    for _, other in _IMPORT.findall(text):
        if other not in parts:
            _add(other, parts, folders)
    names = ", ".join(sorted(exported for _, exported in _EXPORT.findall(text)))
    body = _EXPORT.sub(r"\1", _IMPORT.sub(r"const {\1} = modules.\2;", text))
    unsupported = re.search(r"^\s*(import|export)\b|</script|<!--", body, re.MULTILINE)
    assert not unsupported, f"{name}.js: unsupported import, export or tag"
    parts[name] = f"modules.{name} = (() => {{\n{body}return {{ {names} }};\n}})();\n"


def _policy(script: str, style: str, connects: bool) -> str:
    """The Content-Security-Policy: this script and this style only; with ``connects``, requests
    to its server.
    """
    hashes = [
        base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        for text in (script, style)
    ]
    rules = [
        "default-src 'none'",
        f"script-src 'sha256-{hashes[0]}'",
        f"style-src 'sha256-{hashes[1]}'",
    ]
    rules += ["connect-src 'self'"] if connects else []
    return "; ".join([*rules, "base-uri 'none'", "form-action 'none'"])


def source(name: str, *folders: Path) -> str:
    """The text of a file, from the first folder that has it; this folder is searched last."""
    folder = next((folder for folder in folders if (folder / name).is_file()), FOLDER)
    return (folder / name).read_text(encoding="utf-8")
