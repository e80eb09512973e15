"""Follow every link and anchor of a finished site, and every picture: ``python -m docs.making.site.check site``.

Addresses outside of it are not asked for. A page that loads anything from elsewhere is a fault: the site needs no net.
"""

from __future__ import annotations

import posixpath
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

CARRIED = {"data", "blob"}  # what such an address names is in the page itself


@dataclass
class Links:
    """Of one page: ``anchors`` that it has, ``to`` where it leads, ``loads`` what it shows or runs."""

    anchors: set[str] = field(default_factory=set)
    to: list[str] = field(default_factory=list)
    loads: list[str] = field(default_factory=list)


class Reader(HTMLParser):
    """Finds them in the HTML of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.links = Links()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note what the element is called, where it leads and what it loads."""
        for name, value in attrs:
            if value is None:
                continue
            if name == "id" or (name == "name" and tag == "a"):
                self.links.anchors.add(value)
            elif name == "href" and tag in ("a", "area"):
                self.links.to.append(value)
            elif name == "src" or (name == "href" and tag == "link"):
                self.links.loads.append(value)


def read(text: str) -> Links:
    """The links of a page."""
    reader = Reader()
    reader.feed(text)
    reader.close()
    return reader.links


def faults(site: Path) -> Iterator[str]:
    """One line for every link of the site that leads nowhere."""
    files = {path.relative_to(site).as_posix() for path in site.rglob("*") if path.is_file()}
    pages = {name: read((site / name).read_text(encoding="utf-8")) for name in sorted(files) if name.endswith(".html")}
    for name, links in pages.items():
        if name == "404.html":
            continue  # a server shows it under any address, so its links begin with that of the site
        for target in dict.fromkeys(links.to + links.loads):
            parts = urlsplit(target)
            found, anchor = _place(name, unquote(parts.path)), unquote(parts.fragment)
            if parts.scheme or parts.netloc:
                if target in links.loads and parts.scheme not in CARRIED:
                    yield f"{name} loads {target}: it must not need the net"
            elif found not in files:
                yield f"{name} links to {target}: there is no {found}"
            elif "=" in anchor:
                continue  # not a place on the page, but what it is to show
            elif anchor and found in pages and anchor not in pages[found].anchors:
                yield f"{name} links to {target}: {found} has no #{anchor}"


def _place(page: str, path: str) -> str:
    """Where a link of a page leads, from the root of the site; of a folder, to its page."""
    if not path:
        return page
    return posixpath.normpath(posixpath.join(posixpath.dirname(page), path, "index.html" if path.endswith("/") else ""))


def main(argv: list[str] | None = None) -> int:
    """Say what leads nowhere; 1 if anything does."""
    arguments = sys.argv[1:] if argv is None else argv
    if len(arguments) != 1 or not (Path(arguments[0]) / "index.html").is_file():
        print("error: give the folder of a finished site (make site makes site/)", file=sys.stderr)
        return 2
    found = list(faults(Path(arguments[0])))
    for fault in found:
        print(f"error: {fault}", file=sys.stderr)
    print(f"{len(found)} links lead nowhere" if found else "every link leads somewhere")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
