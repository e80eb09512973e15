"""What setup.cfg cannot express: where each folder is installed, and a long description without
links into the clone.

netlib, layers and handpose keep their names. The other folders have names that other packages may
have, too; they are installed below netlib/share (netlib/files/paths.py), and only netlib and the
command handpose look for them there.
"""

import os
import re
from pathlib import Path

from setuptools import setup

IMPORTED = ("netlib", "layers", "handpose")
SHARED = ("fast", "tools", "exercises", "export", "prototxt", "models")


def folders_in(top: str) -> list[str]:
    """The folder ``top`` and those in it that hold files, with dots for slashes."""
    found = [folder for folder, _, names in os.walk(top) if names and "__pycache__" not in folder]
    return [folder.replace(os.sep, ".") for folder in sorted(found)]


def long_description() -> str:
    """README.md for a package index, which has none of the repository's files.

    Pictures and comments are removed; a relative link is replaced by its text.
    """
    text = Path("README.md").read_text(encoding="utf-8")
    text = re.sub(r"^!\[[^\]]*\]\([^)]*\)\n+", "", text, flags=re.MULTILINE)
    text = re.sub(r"<!--.*?-->\n?", "", text, flags=re.DOTALL)
    return re.sub(r"\[([^\]]*)\]\((?!https?:)[^)]*\)", r"\1", text)


# Of docs/ the pages are installed, which ``handpose docs`` shows, without pictures and without
# what makes them.
shared = [*(name for top in SHARED if Path(top).is_dir() for name in folders_in(top)), "docs"]
setup(
    long_description=long_description(),
    long_description_content_type="text/markdown",
    packages=[name for top in IMPORTED for name in folders_in(top)]
    + [f"netlib.share.{name}" for name in shared],
    package_dir={f"netlib.share.{top}": top for top in (*SHARED, "docs")},
    # the pages for the browser, where make docs has been run
    exclude_package_data={"netlib.share.docs": ["*.html"]},
    package_data={
        "": [
            "*.schema.json",
            "*.prototxt",
            "*.proto",
            "*.md",
            "*.h5",
            "*.npz",
            "*.html",
            "*.css",
            "*.js",
            "py.typed",
        ]
    },
)
