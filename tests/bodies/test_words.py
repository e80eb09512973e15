"""Nothing about hands remains where any body is drawn, rendered, posed, fitted or computed with."""

from __future__ import annotations

import io
import re
import tokenize
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ANATOMY = re.compile(r"finger|thumb|palm|wrist|knuckle|forearm|pinky|little_|index_(mcp|base|tip)", re.IGNORECASE)
PLACES = [
    *(ROOT / "layers").rglob("*.py"),
    *(ROOT / "fast").rglob("*.py"),
    *(ROOT / "handpose" / "flesh").rglob("*.py"),
    *(ROOT / "handpose" / "fitting").rglob("*.py"),
    *(ROOT / "handpose" / "synthetic").rglob("*.py"),
    *(ROOT / "tools").rglob("*.py"),
]  # fmt: skip
PEOPLE = "synthetic recordings and scenes are of people who move their hands; other bodies have frames"
HANDS = "its question is about hands"
TEXTBOOK = "the example of a chapter"
ALLOWED = {  # a file, and why it may
    "handpose/synthetic/acts.py": PEOPLE,
    "handpose/synthetic/choices.py": PEOPLE,
    "handpose/synthetic/gestures.py": PEOPLE,
    "handpose/synthetic/movements.py": PEOPLE,
    "handpose/synthetic/person.py": PEOPLE,
    "handpose/synthetic/scenes.py": PEOPLE,
    "handpose/synthetic/stage.py": PEOPLE,
    "handpose/synthetic/recipes.py": "the recipes with a name are of hands; that of another body is its prior",
    "tools/exercises/hand.py": TEXTBOOK,
    "tools/exercises/joint_transform.py": TEXTBOOK,
    "tools/exercises/torque_gradient.py": TEXTBOOK,
    "tools/measure_finding.py": HANDS,
    "tools/measure_fit.py": HANDS,
    "tools/predict.py": "hands are searched for, and crops moved to them; other bodies stay where they are",
    "tools/prepare_icvl.py": HANDS,
    "tools/track.py": "only hands are followed",
}


def words_of(text: str) -> list[str]:
    """What is code, string or comment in a file and speaks of a hand's anatomy."""
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return [f"{token.start[0]}: {token.string[:60]}" for token in tokens if ANATOMY.search(token.string)]


def test_the_words_are_found() -> None:
    """In names, strings and comments."""
    assert len(words_of('def palm(x):  # of the wrist\n    return "thumb_tip" + x.fingers\n')) == 4
    assert not words_of("index = little = 1  # whole\n")


def test_no_word_of_a_hands_anatomy() -> None:
    """Neither in code nor in strings and comments, but where it is said why."""
    assert len(PLACES) > 150
    found = {str(path.relative_to(ROOT)): words for path in PLACES if (words := words_of(path.read_text()))}
    assert {name: words for name, words in found.items() if name not in ALLOWED} == {}
    assert set(ALLOWED) <= set(found)
