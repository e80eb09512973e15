"""The page of a folder: its files and those below it, room by room, with the first line of each."""

from __future__ import annotations

import posixpath
import re
from collections.abc import Callable

from docs.making.site.published import Published
from docs.making.site.sources import Source


def page(folder: str, site: Published, read: Callable[[str], Source]) -> str:
    """Its Markdown, with links as a document in the folder has them."""
    made = [f"# {folder}/\n"]
    own = f"{folder}/__init__.py"
    if own in site.sources:
        made.append(f"{_plain(read(own).first_line())} ([\\_\\_init\\_\\_.py](__init__.py))\n")
    room = None
    for path in site.files_in(folder):
        place, name = posixpath.split(posixpath.relpath(path, folder))
        source = read(path)
        if name == "__init__.py":
            continue
        if place != room:
            about = f"{folder}/{place}/__init__.py"
            if place:
                made.append(f"\n## {place}\n")
                made.append(f"{_plain(read(about).first_line())}\n" if about in site.sources else "")
            made.append("| file | what it is |\n|---|---|")
            room = place
        made.append(f"| [{_plain(name)}]({posixpath.join(place, name)}) | {_plain(source.first_line())} |")
    documents = [path for path in site.documents if posixpath.dirname(path) == folder]
    made += [f"\n- [{_plain(posixpath.basename(path))}]({posixpath.basename(path)})" for path in documents]
    return "\n".join(made) + "\n"


def _plain(text: str) -> str:
    """Text that is to have no marks, but for code between backquotes."""
    parts = text.replace("``", "`").split("`")
    plain = [part if index % 2 else _escaped(part) for index, part in enumerate(parts)]
    return "`".join(plain) if len(parts) % 2 else _escaped(text)


def _escaped(text: str) -> str:
    return re.sub(r"([\\`*_\[\]|])", r"\\\1", text).replace("<", "&lt;")
