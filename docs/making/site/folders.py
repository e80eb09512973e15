"""The page of a folder: its files and those below it, folder by folder, with the first line of each."""

from __future__ import annotations

import posixpath
from collections.abc import Callable

from docs.making.site.published import Published
from docs.making.site.sources import escaped, first_line


def page(folder: str, site: Published, read: Callable[[str], str]) -> str:
    """Its Markdown, with links as a document in the folder has them. ``read`` gives the text of a source file."""
    made = [f"# {folder}/\n"]
    own = f"{folder}/__init__.py"
    if own in site.sources:
        made.append(f"{first_line(own, read(own))} ([\\_\\_init\\_\\_.py](__init__.py))\n")
    current = None
    for path in site.files_in(folder):
        place, name = posixpath.split(posixpath.relpath(path, folder))
        if name == "__init__.py":
            continue
        if place != current:
            about = f"{folder}/{place}/__init__.py"
            if place:
                made.append(f"\n## {place}\n")
                made.append(f"{first_line(about, read(about))}\n" if about in site.sources else "")
            made.append("| file | what it is |\n|---|---|")
            current = place
        made.append(f"| [{escaped(name)}]({posixpath.join(place, name)}) | {first_line(path, read(path))} |")
    documents = [path for path in site.documents if posixpath.dirname(path) == folder]
    made += [f"\n- [{escaped(posixpath.basename(path))}]({posixpath.basename(path)})" for path in documents]
    return "\n".join(made) + "\n"
