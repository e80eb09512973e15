"""What MkDocs calls while it builds the site (``hooks`` in mkdocs.yml).

README, CONTRIBUTING and CHANGELOG lie outside docs/, which is all that MkDocs reads; pages for the
browser are not in git. Links to files outside docs/ stay: from site/, which is next to docs/, they
lead to the files of the clone.
"""

from __future__ import annotations

import html
import re
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from mkdocs.config.defaults import MkDocsConfig  # noqa: E402
from mkdocs.structure.files import File, Files, InclusionLevel  # noqa: E402

from docs.making import pages  # noqa: E402

TOP_PAGES = {  # file in the project's root -> page
    "README.md": "index.md",
    "CONTRIBUTING.md": "CONTRIBUTING.md",
    "CHANGELOG.md": "CHANGELOG.md",
}
# A page that GitHub cannot show is a comment there: <!-- embed: ../hand.html#body=arm 640 The
# book's arm -->
EMBEDDED = re.compile(r"^<!-- embed: (\S+) (\d+) (.+) -->$", re.MULTILINE)
LOCAL_LINK = re.compile(r"\]\((?!https?:|#)(docs/)?")
IFRAME = '<iframe src="{}" height="{}" title="{}" loading="lazy"></iframe>'
FIGURE = re.compile(r"^!\[[^\]\n]*\]\(([^)\s]+\.(?:svg|png|jpg))\)$", re.MULTILINE)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the files that are not in docs/."""
    for name, address in TOP_PAGES.items():
        text = (ROOT / name).read_text(encoding="utf-8")
        text = LOCAL_LINK.sub(lambda link: "](" if link[1] else "](../", text)
        files.append(File.generated(config, address, content=text))
    for name, page in pages.pages().items():
        address = f"{name}.html"
        if old := files.get_file_from_path(address):
            files.remove(old)
        files.append(
            File.generated(config, address, content=page, inclusion=InclusionLevel.NOT_IN_NAV)
        )
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Embed pages for the browser, and link each figure to its file, which a phone can enlarge."""
    markdown = FIGURE.sub(r"[\g<0>](\g<1>)", markdown)
    return EMBEDDED.sub(lambda page: IFRAME.format(*map(html.escape, page.groups())), markdown)
