"""The published files of a small project: documents, the files they link to, and the code, each at its place."""

from __future__ import annotations

from pathlib import Path

import pytest

from docs.making.site.published import Published, its_tests, published

CODE = ("layers", "fast")


@pytest.fixture
def site(project: Path) -> Published:
    """Everything that is published."""
    return published(project, CODE)


def test_documents_and_what_they_lead_to(site: Published) -> None:
    """All documents and the files they link to are published, also from other folders, but none outside the project."""
    assert set(site.documents) == {
        "README.md", "CHANGELOG.md", "docs/apart.md", "docs/data.md", "docs/net.md", "docs/book/README.md",
        "docs/book/1_one.md", "docs/book/2_two.md", "docs/book/10_ten.md", "tests/caffe/README.md",
    }
    assert site.as_they_are == {"docs/images/x.png", "models/w.bin"}


def test_code_and_its_tests(site: Published) -> None:
    """All source files of the code folders and their tests are published; docs/making and compiled files are not."""
    layers = {f"layers/{name}.py" for name in ("__init__", "relu", "scale", "data/__init__", "data/labels")}
    tests = {"tests/layers/test_relu.py", "tests/layers/data/test_data_labels.py"}
    assert site.sources == layers | tests | {"fast/relu.py", "fast/scale.py"}
    assert site.folders == {"layers", "layers/data", "fast"}


@pytest.mark.parametrize(
    "target, wanted",
    [
        ("../layers/relu.py", "../layers/relu.py.md"),
        ("../layers/relu.py#L4-L6", "../layers/relu.py.md#L4"),
        ("../layers", "../layers/index.md"),
        ("../layers/", "../layers/index.md"),
        ("../tests/caffe/", "../tests/caffe/README.md"),
        ("data.md#a-b", "data.md#a-b"),
        ("#L4-L6", "#L4-L6"),
        ("gone.py", "gone.py"),
        ("images/x.png", "images/x.png"),
    ],
)
def test_links_lead_to_pages(site: Published, target: str, wanted: str) -> None:
    """Links to a source file or folder lead to its page; other links stay unchanged, so MkDocs reports broken ones."""
    assert site.link("docs/net.md", target) == wanted


def test_who_tells_of_a_file(site: Published) -> None:
    """A file is described in the documents that link to it and in those that show its code."""
    assert site.telling("layers/relu.py") == ["README.md", "docs/net.md"]
    assert site.telling("layers/scale.py") == ["docs/data.md"]


def test_tests_of_a_file(project: Path) -> None:
    """The tests of a file are in the file with the same folder and name under tests/."""
    assert its_tests(project, "layers/data/labels.py") == ["tests/layers/data/test_data_labels.py"]
