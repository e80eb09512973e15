"""docs/making/markdown.py: links, anchors and headings."""

from __future__ import annotations

import pytest

from docs.making.markdown import anchor_of, headings, links, title_of, with_links


def test_links_are_found_and_code_is_passed_by() -> None:
    """Links, images and definitions that point into the project are found in order; those in code are skipped."""
    text = (
        "[a](b.md#c) and ![d](e.png 'title'), [`f`](g.py#L3-L8), [out](https://x.y), `[no](no.md)`, ``[`no`](no)``\n"
        "```\n[no](no.md)\n```\n[h](<i j.md>)\n\n[k]: l.md\n[m](#here) [n](mailto:x@y.z) [o](p_(q).md)\n"
    )
    assert [link.target for link in links(text)] == [
        "b.md#c",
        "e.png",
        "g.py#L3-L8",
        "i j.md",
        "l.md",
        "#here",
        "p_(q).md",
    ]


def test_links_are_changed_where_they_stand() -> None:
    """Only link targets are changed; titles, code and external addresses stay."""
    text = '[a](b.md "b.md")\n```\n[a](b.md)\n```\n`[a](b.md)` [x](http://b.md)\n'
    assert with_links(text, lambda link: f"../{link.target}") == text.replace("(b.md ", "(../b.md ")


@pytest.mark.parametrize(
    "heading, anchor",
    [("The gradient, by torques", "the-gradient-by-torques"), ("`x` and y_z", "x-and-y_z"), ("What? (2)", "what-2")],
)
def test_anchors_are_github_s(heading: str, anchor: str) -> None:
    """Anchors are in lower case, without punctuation, with hyphens for spaces, as on GitHub."""
    assert anchor_of(heading) == anchor


def test_the_title_is_the_first_heading() -> None:
    """The title is the first heading outside code."""
    assert title_of("text\n```bash\n# no\n```\n# The `net` of \\_x\n## more\n") == "The net of _x"
    assert title_of("text") is None


def test_titles_of_links() -> None:
    """The title of a link or definition is the text in double quotes."""
    text = '[a](b.md "c d") [e](<f g.md> "h") [i](j.md) ![k](l.png "m.n")\n[o]: p.md "q"\n'
    assert [link.title for link in links(text)] == ["c d", "h", "", "m.n", "q"]


def test_headings_are_those_outside_of_code() -> None:
    """Headings of any level outside code are found, without closing marks."""
    assert list(headings("# a\n~~~text\n# no\n~~~\n### b `c` ##\n#no\n")) == ["a", "b `c`"]
