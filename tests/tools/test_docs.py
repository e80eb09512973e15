"""tools/docs.py: the pages of the documentation as text."""

from __future__ import annotations

import pytest

from tests.support.running import run_tool
from tests.tools.conftest import ROOT


def test_the_pages_are_listed() -> None:
    lines = run_tool("docs").out.splitlines()
    pages = {path.stem for path in (ROOT / "docs").glob("*.md")}
    assert {line.split()[0] for line in lines} == pages | {"hands.schema.json"}
    assert all(len(line.split()) > 1 for line in lines)
    assert "camera             Tracking: from a depth camera to hand poses" in lines
    assert "hands.schema.json  Hands in depth frames" in lines


@pytest.mark.parametrize("name", ["camera", "camera.md", "docs/camera.md"])
def test_a_page(name: str) -> None:
    assert run_tool("docs", name).out == (ROOT / "docs" / "camera.md").read_text(encoding="utf-8")


def test_a_word_that_names_no_page_is_searched_for() -> None:
    """Lines with the word are printed after the name of their page, whatever their case."""
    first, *found = run_tool("docs", "JSON schema").out.splitlines()
    assert first == "no page is called 'JSON schema'; these lines contain it:"
    assert any(line.startswith("camera: ") for line in found)
    assert all("json schema" in line.lower() for line in found)


def test_an_unknown_word() -> None:
    done = run_tool("docs camra", status=1)
    assert "camra: no such page (did you mean 'camera'?), and no page contains it; " in done.err
