"""Which files the site has: the documents, whatever they link to, and the code.

A file has the same place in the site as in the project: ``docs/layers.md`` is ``docs/layers.html``,
``layers/hand/skeleton.py`` is ``layers/hand/skeleton.py.html``, a folder is its ``index.html``. MkDocs makes pages of
Markdown only, so it receives the last two as ``skeleton.py.md`` and ``index.md``.
"""

from __future__ import annotations

import posixpath
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import unquote

from docs.making import markdown
from docs.making.code_blocks import shown_files
from netlib.files.paths import ROOT

DOCUMENTS = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "docs/*.md", "docs/book/*.md",
             "docs/exercises/**/*.md", "docs/results/*.md")
AS_THEY_ARE = ("docs/images/**/*",)  # besides what documents show; the hook adds the pages for the browser
# Folders of which all source files are shown.
CODE = (
    "netlib",
    "layers",
    "fast",
    "handpose",
    "exercises",
    "experiments",
    "export",
    "tools",
    "prototxt",
)
TESTED = ("layers/", "netlib/", "fast/")  # whose tests are shown too
SHOWN = {".py", ".prototxt", ".toml", ".cfg", ".txt", ".yml", ".yaml", ".sh", ".js", ".css", ".json"}
SHOWN_NAMES = {"Makefile", "LICENSE", "run", ".gitignore"}
TO_BE_READ = 200_000  # bytes; a longer file is there to be downloaded


@dataclass
class Published:
    """Paths from the root of the project, with slashes. ``linked[document]``: what it links to or shows."""

    documents: list[str] = field(default_factory=list)
    sources: set[str] = field(default_factory=set)
    folders: set[str] = field(default_factory=set)
    as_they_are: set[str] = field(default_factory=set)
    linked: dict[str, list[str]] = field(default_factory=dict)
    root: Path = ROOT

    def address(self, path: str) -> str:
        """The name under which MkDocs knows a file or folder, a page of ours or as it is."""
        if path in self.sources:
            return path + ".md"
        if path in self.folders:
            return posixpath.join(path, "index.md")
        return path

    def link(self, document: str, target: str) -> str:
        """A link of a document in the form that MkDocs needs; unchanged for unpublished files, which MkDocs reports."""
        path, _, anchor = target.partition("#")
        if not path:
            return target
        found = readme_of(self.root, resolved(document, path))
        if found in self.sources:
            anchor = anchor.partition("-")[0]  # of lines #L3-L8, the first
        if found not in self.sources and found not in self.folders and found == resolved(document, path):
            return target
        address = posixpath.relpath(self.address(found), posixpath.dirname(document) or ".")
        return address + (f"#{anchor}" if anchor else "")

    def title(self, document: str) -> str:
        """Its first heading."""
        return markdown.title_of((self.root / document).read_text(encoding="utf-8")) or document

    def telling(self, path: str) -> list[str]:
        """The documents that link to a file, or show code of it."""
        return [document for document in self.documents if path in self.linked[document]]

    def files_in(self, folder: str) -> list[str]:
        """The source files of a folder and of those below it, folder by folder."""
        within = [path for path in self.sources if path.startswith(folder + "/")]
        return sorted(within, key=lambda path: (posixpath.dirname(path), path))


def resolved(document: str, target: str) -> str:
    """Where a link of a document leads, from the root of the project."""
    return posixpath.normpath(posixpath.join(posixpath.dirname(document), unquote(target)))


def readme_of(root: Path, path: str) -> str:
    """What is shown of a folder: its README where it has one, as on GitHub."""
    readme = posixpath.join(path, "README.md")
    return readme if (root / readme).is_file() else path


def its_tests(root: Path, path: str) -> list[str]:
    """The tests of a source file: the file of the same place and name under tests/."""
    folder, name = posixpath.split(path)
    names = (f"test_{name}", f"test_{posixpath.basename(folder)}_{name}")
    return [test for test in (posixpath.join("tests", folder, name) for name in names) if (root / test).is_file()]


def published(root: Path = ROOT, code: Iterable[str] = CODE) -> Published:
    """All of them, of the project as it lies there."""
    site = Published(root=root)
    for pattern in AS_THEY_ARE:
        site.as_they_are |= {path.relative_to(root).as_posix() for path in root.glob(pattern) if path.is_file()}
    for folder in code:
        sources = set(_sources(root, folder))
        site.sources |= sources
        site.folders |= {parent.as_posix() for path in sources for parent in Path(path).parents} - {"."}
    of_the_net = [path for path in site.sources if path.startswith(TESTED)]
    site.sources |= {test for path in of_the_net for test in its_tests(root, path)}
    waiting = [path.relative_to(root).as_posix() for pattern in DOCUMENTS for path in sorted(root.glob(pattern))]
    while waiting:
        document = waiting.pop(0)
        if document in site.documents:
            continue
        site.documents.append(document)
        links = markdown.links((root / document).read_text(encoding="utf-8"))
        targets = [link.target.partition("#")[0] for link in links]
        paths = dict.fromkeys(readme_of(root, resolved(document, target)) for target in targets if target)
        paths |= dict.fromkeys(sorted(shown_files(root / document)))
        site.linked[document] = [path for path in paths if not path.startswith("../") and (root / path).exists()]
        waiting += [path for path in site.linked[document] if path.endswith(".md")]
        for path in site.linked[document]:
            _add(site, path)
    site.folders = {folder for folder in site.folders if readme_of(root, folder) == folder}
    return site


def _add(site: Published, path: str) -> None:
    """What a document links to, when it is no document itself."""
    file = site.root / path
    if file.is_dir():
        site.folders.add(path)
        site.sources |= set(_sources(site.root, path, below=False))
    elif _is_read(file):
        site.sources.add(path)
    elif not path.endswith(".md"):
        site.as_they_are.add(path)


def _is_read(file: Path) -> bool:
    return (file.suffix in SHOWN or file.name in SHOWN_NAMES) and file.stat().st_size <= TO_BE_READ


def _sources(root: Path, folder: str, *, below: bool = True) -> Iterator[str]:
    """The source files of a folder."""
    for file in sorted((root / folder).glob("**/*" if below else "*")):
        if file.is_file() and _is_read(file):
            yield file.relative_to(root).as_posix()
