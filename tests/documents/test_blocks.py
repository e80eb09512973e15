"""Every code block in every document runs and prints the output shown; a block that cannot run
gives its reason.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import pytest

pytest.importorskip("sybil", reason="sybil runs the blocks of documents: pip install -e '.[test]'")

from netlib.files.paths import ROOT
from tests.docs.test_documents import DOCUMENTS
from tests.documents import given, workplace
from tests.documents.blocks import failures

NAMES = sorted(path.relative_to(ROOT).as_posix() for path in DOCUMENTS)


@pytest.mark.parametrize("name", NAMES)
def test_every_block_does_what_it_shows(name: str, tmp_path: Path) -> None:
    """Every block of a document does what is shown, in a temporary folder."""
    for package in given.NEEDS.get(name, ()):
        if find_spec(package) is None:
            pytest.skip(f"{name} uses {package}: pip install -e '.[test]'")
    folder = tmp_path / "project"
    workplace.furnish(folder)
    with workplace.at_work_in(folder):
        names = {
            key: value
            for make in given.BY_DOCUMENT.get(name, ())
            for key, value in (make(folder) or {}).items()
        }
        try:
            found = [f"{name}, {failure}" for failure in failures(ROOT / name, folder, names)]
        except ModuleNotFoundError as error:
            if error.name not in given.OPTIONAL:
                raise
            pytest.skip(f"{name} imports {error.name}: pip install -e '.[test]'")
    if found:
        pytest.fail("\n\n".join(found), pytrace=False)
