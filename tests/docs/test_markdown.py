"""docs/making/markdown.py"""

from __future__ import annotations

import pytest

from docs.making.markdown import anchor_of, headings, links, title_of, with_links


def test_links_are_found_and_code_is_passed_by() -> None:
    """Links, images and definitions of this project, in their order."""
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
    """Titles, code and other addresses stay."""
    text = '[a](b.md "b.md")\n```\n[a](b.md)\n```\n`[a](b.md)` [x](http://b.md)\n'
    assert with_links(text, lambda link: f"../{link.target}") == text.replace("(b.md ", "(../b.md ")


@pytest.mark.parametrize(
    "heading, anchor",
    [("The gradient, by torques", "the-gradient-by-torques"), ("`x` and y_z", "x-and-y_z"), ("What? (2)", "what-2")],
)
def test_anchors_are_github_s(heading: str, anchor: str) -> None:
    """Lower case, marks left out, spaces made hyphens."""
    assert anchor_of(heading) == anchor


def test_the_title_is_the_first_heading() -> None:
    """One in code is none."""
    assert title_of("text\n```bash\n# no\n```\n# The `net` of \\_x\n## more\n") == "The net of _x"
    assert title_of("text") is None


def test_titles_of_links() -> None:
    """Those in double quotes; a definition has one, too."""
    text = '[a](b.md "c d") [e](<f g.md> "h") [i](j.md) ![k](l.png "m.n")\n[o]: p.md "q"\n'
    assert [link.title for link in links(text)] == ["c d", "h", "", "m.n", "q"]


def test_headings_are_those_outside_of_code() -> None:
    """At any depth, without what closes them."""
    assert list(headings("# a\n~~~text\n# no\n~~~\n### b `c` ##\n#no\n")) == ["a", "b `c`"]
