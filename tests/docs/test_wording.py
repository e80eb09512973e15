"""docs/wording.txt and setup.cfg: codespell, run by ``make lint``, finds each word and phrase of the list."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("codespell_lib", reason="the linter is in the extra dev: pip install -e '.[dev]'")

ROOT = Path(__file__).resolve().parents[2]
PHRASES = [line.split("->")[0] for line in (ROOT / "docs/wording.txt").read_text(encoding="utf-8").splitlines()]


def found_in(text: str, tmp_path: Path) -> list[str]:
    """Return the words that codespell reports in a document, without its suggestions."""
    (tmp_path / "page.md").write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "codespell_lib", str(tmp_path / "page.md")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode in (0, 65) and not done.stderr
    return [line.partition(": ")[2].partition(" ==> ")[0] for line in done.stdout.splitlines()]


def test_each_phrase_is_found(tmp_path: Path) -> None:
    """Each phrase is found; one of two words must also be in the regular expression of setup.cfg."""
    assert sorted(set(PHRASES), key=PHRASES.index) == PHRASES
    assert found_in("".join(f"It {phrase} here.\n" for phrase in PHRASES), tmp_path) == PHRASES


def test_spelling_is_checked_and_code_is_not(tmp_path: Path) -> None:
    """Code and link targets may contain any word."""
    assert found_in("Teh net `told()` [its name](twin.md), https://twin.example/told, foretold\n", tmp_path) == ["Teh"]
