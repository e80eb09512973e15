"""Fixtures of all tests: the recorded data, nets and solvers from text, and a
deterministic hypothesis.
"""

from __future__ import annotations

import functools
import gc
import importlib
import os
import random
import secrets
import signal
import sys
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import h5py  # noqa: E402
import numpy as np  # noqa: E402
import pytest  # noqa: E402
from hypothesis import settings  # noqa: E402

import netlib  # noqa: E402  before NumPy: it chooses the BLAS threads
from netlib import engine  # noqa: E402
from netlib.files.reading import Content  # noqa: E402
from netlib.proto import prototxt  # noqa: E402
from netlib.snapshots import hdf5_format  # noqa: E402

ENGINES = ("plain", "fast") if engine.has_fast() else ("plain",)

# a background job ignores SIGINT, which tests send
signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile(
    "deterministic", derandomize=True, deadline=None, database=None, max_examples=60
)
settings.load_profile("deterministic")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run tests of layers, and those with the marker ``both_engines``, under every engine that
    makes a difference.
    """
    path = Path(metafunc.module.__file__).relative_to(ROOT / "tests")
    if path.parts[0] == "layers" or metafunc.definition.get_closest_marker("both_engines"):
        engines = ENGINES if has_fast_class(path) else ENGINES[-1:]
        metafunc.parametrize("engine_in_use", engines, indirect=True, scope="module")


def has_fast_class(path: Path) -> bool:
    """Return whether the fast engine affects this test file: false for a layer without a
    class in fast/.
    """
    source = ROOT / path.with_name(path.name.removeprefix("test_"))
    if path.parts[0] != "layers" or len(ENGINES) == 1 or not source.exists():
        return True
    module = importlib.import_module(".".join(source.relative_to(ROOT).with_suffix("").parts))
    classes = [value for value in vars(module).values() if isinstance(value, type)]
    return any(engine.get("fast").implementation(cls) is not cls for cls in classes)


def pytest_addoption(parser: pytest.Parser) -> None:
    """--order SEED: files, and the tests of each, in a random order; --order random
    prints its seed.
    """
    parser.addoption(
        "--order",
        metavar="SEED|random",
        help="run test files, and the tests of each, in random order",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Choose a seed for --order random; the processes of xdist inherit it."""
    if config.option.order == "random":
        config.option.order = os.environ.setdefault("TEST_ORDER", str(secrets.randbits(32)))


def pytest_report_header(config: pytest.Config) -> str | None:
    """The seed with which the same order can be repeated."""
    return None if config.option.order is None else f"random order: --order {config.option.order}"


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Collect without garbage collections: they would search the growing list of tests, all of
    which stays in use.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Run test_without_fast first: it takes minutes, during which other processes run
    the other tests.
    """
    if config.option.order is not None:
        shuffle = random.Random(config.option.order)
        files = {path: shuffle.random() for path in dict.fromkeys(item.path for item in items)}
        items.sort(key=lambda item: (files[item.path], shuffle.random()))
    items.sort(key=lambda item: item.path.stem != "test_without_fast")


@pytest.fixture(autouse=True, scope="module")
def engine_in_use(request: pytest.FixtureRequest) -> Iterator[str | None]:
    """The engine of this run of the test, also for child processes."""
    name = getattr(request, "param", None)
    with pytest.MonkeyPatch.context() as patch:
        if name is not None:
            patch.setenv("NETLIB_ENGINE", name)
        yield name


@pytest.fixture(autouse=True, scope="session")
def forget_weights() -> Iterator[Callable[[], None]]:
    """Cache the weights of equal file contents: hundreds of tests read those of a packaged model.

    ``forget_weights()`` clears the cache.
    """
    read = hdf5_format.read_weights
    known = functools.lru_cache(maxsize=4)(read)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            hdf5_format,
            "read_weights",
            lambda path: (known if isinstance(path, Content) else read)(path),
        )
        yield known.cache_clear


@pytest.fixture(scope="session")
def caffe_data() -> Path:
    """The folder of real Caffe's recorded results: tests/caffe/README.md."""
    return ROOT / "tests/caffe"


@pytest.fixture
def net_of() -> Callable[..., netlib.Net]:
    """``net_of(text, phase=netlib.TRAIN, **options)``: a net from the text of its prototxt."""

    def make(text: str, phase: int = netlib.TRAIN, **options: Any) -> netlib.Net:
        options.setdefault("seed", 1)
        return netlib.Net(prototxt.parse(text, "net.prototxt"), phase, **options)

    return make


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder, which is the working directory."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def write_rows(tmp_path: Path) -> Callable[..., Path]:
    """``write_rows("list.txt", [4, 3], data=(2, 5, 5), label=(3,))``: HDF5 files of 4 and 3 rows,
    and their list.
    """

    def write(name: str, rows: list[int], seed: int = 0, **shapes: tuple[int, ...]) -> Path:
        rng = np.random.default_rng(seed)
        files = [tmp_path / f"{Path(name).stem}{i}.h5" for i in range(len(rows))]
        for path, count in zip(files, rows):
            with h5py.File(path, "w") as file:
                for blob, shape in shapes.items():
                    file[blob] = rng.normal(size=(count, *shape)).astype(np.float32)
        (tmp_path / name).write_text("".join(f"{path}\n" for path in files), encoding="utf-8")
        return tmp_path / name

    return write


@pytest.fixture
def keep_threads() -> Iterator[None]:
    """Restore the number of threads after a test that changes it."""
    before = netlib.threads()
    yield
    netlib.set_threads(before)


@pytest.fixture
def rng() -> np.random.Generator:
    """A random generator with the same seed for every test."""
    return np.random.default_rng(0)
