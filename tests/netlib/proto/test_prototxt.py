"""The text format: valid and invalid texts, the error messages, and printing without loss."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import netlib
from netlib.proto import prototxt
from netlib.proto.prototxt import Field, Message, Position, Scalar

HERE = Path(__file__).parent
VALID = sorted(path.stem for path in (HERE / "valid").glob("*.prototxt"))
INVALID = sorted(path.stem for path in (HERE / "invalid").glob("*.prototxt"))


def as_lists(message: Message) -> list[Any]:
    """Return fields as [name, [kind, text]] or [name, fields]."""
    return [
        [
            f.name,
            as_lists(f.value) if isinstance(f.value, Message) else [f.value.kind, f.value.text],
        ]
        for f in message.fields
    ]


def test_there_are_examples() -> None:
    assert len(VALID) >= 13
    assert len(INVALID) >= 20


@pytest.mark.parametrize("name", VALID)
def test_valid(name: str) -> None:
    tree = prototxt.parse_file(HERE / "valid" / f"{name}.prototxt")
    assert as_lists(tree) == json.loads(
        (HERE / "valid" / f"{name}.json").read_text(encoding="utf-8")
    )
    assert prototxt.parse(str(tree)) == tree


@pytest.mark.parametrize("name", INVALID)
def test_invalid(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(HERE / "invalid")
    with pytest.raises(netlib.PrototxtError) as error:
        prototxt.parse_file(f"{name}.prototxt")
    assert str(error.value) == Path(f"{name}.txt").read_text(encoding="utf-8").rstrip("\n")


def test_every_node_keeps_its_place() -> None:
    tree = prototxt.parse('a: 1\n  b {\n\tc:   "x"  }\nd: [1,\n 2]', "f")
    a, b, *elements = tree.fields
    assert isinstance(b.value, Message)
    [c] = b.value.fields
    assert isinstance(c.value, Scalar)
    places = [a.position, b.position, b.value.position, c.position, c.value.position]
    assert [str(p) for p in places] == ["f:1:1", "f:2:3", "f:2:5", "f:3:2", "f:3:7"]
    assert [str(element.position) for element in elements] == ["f:4:5", "f:5:2"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, " cannot read the prototxt: No such file or directory"),
        (b"\xff\xfe\x00", "1:1: error: not a text file (byte 0xff is not UTF-8)"),
    ],
)
def test_files_that_cannot_be_read(tmp_path: Path, content: bytes | None, message: str) -> None:
    path = tmp_path / "n.prototxt"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(netlib.NetlibError) as error:
        prototxt.parse_file(path)
    assert str(error.value).startswith(f"{path}:{message}")


def test_comments_and_strings_in_any_encoding(tmp_path: Path) -> None:
    """Comments and strings need not be UTF-8, as in Caffe; positions are right after them."""
    path = tmp_path / "n.prototxt"
    path.write_bytes(
        b"# don't: \xbe\xed\xbb\xfd\nname: '#\"' # \xe9\n" + "other: 'é".encode() + b"\xe9'"
    )
    assert [(f.name, f.value.text, f.position.line) for f in prototxt.parse_file(path).fields] == [
        ("name", '#"', 2),
        ("other", "é\udce9", 3),
    ]


@pytest.mark.parametrize("name", ["net.caffemodel", "net.caffemodel.h5"])
def test_weights_in_place_of_a_net(name: str) -> None:
    with pytest.raises(
        netlib.NetlibError,
        match=f"^{name}: found weights, expected a .prototxt; a net stands before",
    ):
        netlib.Net(name, "net.prototxt", netlib.TEST)


NOWHERE = Position("", 1, 1)
NAMES = st.from_regex(r"[A-Za-z_][A-Za-z_0-9]{0,6}", fullmatch=True)
STRINGS = st.text(st.characters(exclude_categories=["Cs"]), max_size=12).map(
    lambda t: Scalar("string", t, NOWHERE)
)
NUMBERS = st.from_regex(
    r"-?([0-9]{1,4}|[0-9]{1,3}\.[0-9]{0,3}|\.[0-9]{1,3})([eE][+-]?[0-9]{1,2})?f?", fullmatch=True
)
WORDS = st.from_regex(r"-?[A-Za-z_][A-Za-z_0-9]{0,6}", fullmatch=True)
SCALARS = st.one_of(
    STRINGS,
    NUMBERS.map(lambda t: Scalar("number", t, NOWHERE)),
    WORDS.map(lambda t: Scalar("word", t, NOWHERE)),
)


def messages(children: st.SearchStrategy[Any]) -> st.SearchStrategy[Message]:
    fields = st.builds(Field, NAMES, st.one_of(SCALARS, children), st.just(NOWHERE))
    return st.builds(Message, st.lists(fields, max_size=4), st.just(NOWHERE))


TREES = st.recursive(messages(st.nothing()), messages, max_leaves=8)


@given(TREES)
@settings(max_examples=20)
def test_parse_print_parse_is_stable(tree: Message) -> None:
    assert prototxt.parse(str(tree)) == tree


@given(st.text(max_size=40) | st.text(alphabet="ab1.-e:{}<>[]\",;\\'# \n", max_size=30))
def test_any_text_is_read_or_refused_in_one_line(text: str) -> None:
    try:
        tree = prototxt.parse(text, "f")
    except netlib.PrototxtError as error:
        assert str(error).startswith("f:")
        assert len(str(error).splitlines()) == 1
    else:
        assert prototxt.parse(str(tree)) == tree
