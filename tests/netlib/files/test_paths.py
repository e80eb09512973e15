"""netlib/files/paths.py: the location of files that a prototxt names."""

from __future__ import annotations

from pathlib import Path

import pytest

from netlib.files.paths import ROOT, find, real


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project folder with prototxt/; the working directory is another folder."""
    (tmp_path / "project" / "prototxt" / "body").mkdir(parents=True)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    return tmp_path / "project"


def put(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()
    return path


def test_the_working_directory_comes_first(tree: Path) -> None:
    source = str(put(tree / "prototxt" / "solver.prototxt"))
    beside = put(tree / "prototxt" / "net.prototxt")
    assert find("net.prototxt", source) == beside
    put(Path("net.prototxt"))
    assert find("net.prototxt", source) == Path("net.prototxt")


@pytest.mark.parametrize("solver", ["prototxt/solver.prototxt", "prototxt/body/solver.prototxt"])
def test_the_tree_of_the_file_that_names_it(tree: Path, solver: str) -> None:
    """A name that begins with a parent folder of the prototxt is found there from any
    working directory.
    """
    net = put(tree / "prototxt" / "body" / "net.prototxt")
    assert find("prototxt/body/net.prototxt", str(put(tree / solver))) == net


def test_the_projects_own_files(tree: Path) -> None:
    """A solver may name a net of the project, also of an installed package; the working
    directory comes first.
    """
    source = str(put(tree / "solver.prototxt"))
    assert (
        find("prototxt/nyu_train_test.prototxt", source)
        == ROOT / "prototxt" / "nyu_train_test.prototxt"
    )
    own = put(Path("prototxt/nyu_train_test.prototxt"))
    assert find("prototxt/nyu_train_test.prototxt", source) == own


def test_no_other_place(tree: Path) -> None:
    """Parent folders are not searched for data, as they may belong to another project."""
    put(tree / "data" / "nyu" / "train.txt")
    source = str(put(tree / "prototxt" / "net.prototxt"))
    for name in ("data/nyu/train.txt", "prototxt/none.prototxt", "none.prototxt"):
        assert find(name, source) == Path(name)


def test_the_command_line(tree: Path) -> None:
    """A name on the command line may be a file of the project, but is not searched in
    other folders.
    """
    packaged = Path("prototxt/nyu_train_test.prototxt")
    assert find(str(packaged), None) == ROOT / packaged
    assert find("nyu_train_test.prototxt", None) == Path("nyu_train_test.prototxt")
    own_net = put(packaged)
    assert find(str(packaged), None) == own_net


def test_a_real_path(tree: Path) -> None:
    """Without links; a name that no file can have is unchanged."""
    Path("link").symlink_to(put(Path("file")))
    assert real("link") == Path("file").absolute()
    assert real("a\0b") == Path("a\0b")
