"""tools/docs.py: the pages of the documentation as text."""

from __future__ import annotations

import pytest

from tests.support.running import run_tool
from tests.tools.conftest import ROOT


def test_the_pages_are_listed() -> None:
    lines = run_tool("docs").out.splitlines()
    assert {line.split()[0] for line in lines} == {
        *(path.stem for path in (ROOT / "docs").glob("*.md")), "hands.schema.json"
    }
    assert all(len(line.split()) > 1 for line in lines)
    assert "camera             Tracking: from a depth camera to hand poses" in lines
    assert "hands.schema.json  Hands in depth frames" in lines


@pytest.mark.parametrize("name", ["camera", "camera.md", "docs/camera.md"])
def test_a_page(name: str) -> None:
    assert run_tool("docs", name).out == (ROOT / "docs" / "camera.md").read_text(encoding="utf-8")


def test_finding_words() -> None:
    """Lines with the words are printed after the name of their page, whatever their case."""
    found = run_tool("docs", "--find", "JSON schema").out.splitlines()
    assert any(line.startswith("camera: ") for line in found)
    assert all("json schema" in line.lower() for line in found)


def test_a_word_that_is_no_page() -> None:
    """Its lines are found as by --find."""
    first, *found = run_tool("docs", "freeze").out.splitlines()
    assert first == "no page is called 'freeze'; these lines contain it:"
    assert found == run_tool("docs", "--find", "freeze").out.splitlines()
    assert any(line.startswith("caffe_nets: ") for line in found)


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["camra"], "camra: no such page (did you mean 'camera'?), and no page contains it; "),
        (["--find", "xyzzy!"], "no page contains 'xyzzy!'"),
    ],
)
def test_mistakes(argv: list[str], message: str) -> None:
    assert message in run_tool("docs", *argv, status=1).err
