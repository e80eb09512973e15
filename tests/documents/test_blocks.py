"""Every code block in every document runs and prints the output shown; a block that cannot run gives its reason."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import pytest

pytest.importorskip("sybil", reason="sybil runs the blocks of documents: pip install -e '.[test]'")

from tests.documents import given, workplace
from tests.documents.blocks import failures

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = [path for place in ("*.md", "docs/**/*.md", "models/**/*.md", "tests/**/*.md") for path in ROOT.glob(place)]
NAMES = sorted(path.relative_to(ROOT).as_posix() for path in DOCUMENTS)


@pytest.mark.parametrize("name", NAMES)
def test_every_block_does_what_it_shows(name: str, tmp_path: Path) -> None:
    """Every block of a document does what is shown, in a temporary folder and without changing the project."""
    for package in given.NEEDS.get(name, ()):
        if find_spec(package) is None:
            pytest.skip(f"{name} uses {package}: pip install -e '.[test]'")
    folder = tmp_path / "project"
    python = workplace.furnish(folder)
    before = workplace.state()
    with workplace.at_work_in(folder):
        names = {key: value for make in given.BY_DOCUMENT.get(name, ()) for key, value in make(folder).items()}
        try:
            found = [f"{name}, {failure}" for failure in failures(ROOT / name, folder, python, names)]
        except ModuleNotFoundError as error:
            pytest.skip(f"{name} imports {error.name}: pip install -e '.[test]'")
    assert not workplace.written(before), f"{name} wrote into the project"
    if found:
        pytest.fail("\n\n".join(found), pytrace=False)
