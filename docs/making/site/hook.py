"""What MkDocs calls while it makes the site (``hooks`` in mkdocs.yml): its files and its pages.

The documents lie all over the project, not in the one folder that MkDocs reads: ``on_files`` lists
them.
"""

from __future__ import annotations

import functools
import html
import re
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[3]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from mkdocs.config.defaults import MkDocsConfig  # noqa: E402
from mkdocs.structure.files import File, Files, InclusionLevel  # noqa: E402
from mkdocs.structure.pages import Page  # noqa: E402
from pygments import highlight  # noqa: E402
from pygments.formatters import HtmlFormatter  # noqa: E402

from docs.making import hand_page, pages  # noqa: E402
from docs.making.markdown import anchor_of, with_links  # noqa: E402
from docs.making.site import folders, github, sources  # noqa: E402
from docs.making.site.published import DOCUMENTS, Published, published  # noqa: E402

HERE = ROOT / "docs/making/site"
# A page that GitHub cannot show is a comment there: <!-- embed: ../hand.html#body=arm 640 The book's arm -->
EMBEDDED = re.compile(r"^<!-- embed: (?P<address>\S+) (?P<height>\d+) (?P<title>.+) -->$", re.MULTILINE)
# A figure is a link to its file, where a phone can enlarge it.
FIGURE = re.compile(r"^!\[[^\]\n]*\]\((?P<file>[^)\s]+\.(?:svg|png|jpg))\)$", re.MULTILINE)
SITE: dict[str, Published] = {}  # of this build: MkDocs keeps one module for all builds of `mkdocs serve`


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Find what is to be published."""
    SITE["now"] = published(ROOT, **({"code": config.extra["code"]} if "code" in config.extra else {}))
    _text.cache_clear()
    config.mdx_configs.setdefault("toc", {})["slugify"] = anchor_of
    fences = config.mdx_configs.setdefault("pymdownx.superfences", {}).setdefault("custom_fences", [])
    if not fences:
        fences.append({"name": "prototxt", "class": "highlight", "format": prototxt_block})
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """All of the site, each file with the place that it has in the project."""
    site = SITE["now"]
    theme = [file for file in files if file.src_dir and not Path(file.src_dir).is_relative_to(ROOT / "docs")]
    made = Files(theme)
    in_nav = {path.relative_to(ROOT).as_posix() for pattern in DOCUMENTS for path in ROOT.glob(pattern)}
    for path in site.documents:
        made.append(_file(config, path, InclusionLevel.INCLUDED if path in in_nav else InclusionLevel.NOT_IN_NAV))
    for path in sorted(site.as_they_are):
        made.append(_file(config, path, InclusionLevel.NOT_IN_NAV))
    for page in (*hand_page.made(), *pages.made()):
        path = page.path.relative_to(ROOT).as_posix()
        made.append(File.generated(config, path, content=page.make(), inclusion=InclusionLevel.NOT_IN_NAV))
    for asset in sorted(path for path in (HERE / "assets").rglob("*") if path.is_file()):
        path = asset.relative_to(HERE).as_posix()
        made.append(File(path, str(HERE), config.site_dir, config.use_directory_urls))
    for path in sorted(site.sources):
        boost = 0.3 if path.startswith("tests/") else 1
        text = f"---\ntitle: {path}\nhide: [navigation, toc]\nsource: {path}\nsearch: {{boost: {boost}}}\n---\n"
        text += sources.page(path, _text(path), site)
        made.append(File.generated(config, site.address(path), content=text, inclusion=InclusionLevel.NOT_IN_NAV))
    for path in sorted(site.folders):
        text = "---\nsearch: {exclude: true}\n---\n" + folders.page(path, site, _text)
        made.append(File.generated(config, site.address(path), content=text, inclusion=InclusionLevel.NOT_IN_NAV))
    return made


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """GitHub's Markdown converted for Python-Markdown, with links to pages instead of files."""
    site = SITE["now"]
    linked = with_links(markdown, lambda link: site.link(page.file.src_uri, link.target))
    return EMBEDDED.sub(_frame, FIGURE.sub(r"[\g<0>](\g<file>)", github.for_python_markdown(linked)))


def _frame(match: re.Match[str]) -> str:
    """The page within the document. It is HTML as it is, so its place in the site is that in the project."""
    address, title = html.escape(match["address"]), html.escape(match["title"])
    return f'<iframe src="{address}" title="{title}" height="{match["height"]}" loading="lazy"></iframe>'


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """The anchors of the lines of a source file, for the links to them."""
    path: Any = page.meta.get("source")
    if path is not None:
        lines = range(1, _text(path).count("\n") + 2)
        page.present_anchor_ids = {*(page.present_anchor_ids or ()), *(f"L{number}" for number in lines)}
    return html


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> str:
    """Its code. The search has been through the page by now: of code its index would be large and slow to make."""
    path: Any = page.meta.get("source")
    return output if path is None else output.replace(sources.CODE, sources.code(path, _text(path)), 1)


def prototxt_block(source: str, *args: Any, **options: Any) -> str:
    """A fenced block of prototxt, which Pygments does not have."""
    return highlight(source, sources.PrototxtLexer(), HtmlFormatter(wrapcode=True))


@functools.cache
def _text(path: str) -> str:
    return (ROOT / path).read_text(encoding="utf-8")


def _file(config: MkDocsConfig, path: str, inclusion: InclusionLevel) -> File:
    return File(path, str(ROOT), config.site_dir, config.use_directory_urls, inclusion=inclusion)
