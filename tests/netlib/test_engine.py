"""The two engines: how one is chosen, and that both compute the same results."""

from __future__ import annotations

import pytest

import netlib
from netlib import engine
from netlib.engine import Engine, Step
from tests.netlib.conftest import ONE_WEIGHT, MakeNet, MakeSolver
from tests.support.nets import ONE
from tests.support.running import run_python

needs_fast = pytest.mark.skipif(not engine.has_fast(), reason="the folder fast/ is not there")

NET = ONE + 'layer { name: "r" type: "ReLU" bottom: "a" top: "a" }'


def test_the_plain_engine_runs_each_layer_in_its_own_step(net_of: MakeNet) -> None:
    net = net_of(NET, engine="plain")
    assert net.engine.name == "plain"
    assert type(net.engine) is Engine
    assert [(type(step), step.connections) for step in net.steps] == [
        (Step, [at]) for at in net.connections
    ]


@needs_fast
def test_one_net_or_the_whole_process(net_of: MakeNet, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NETLIB_ENGINE", raising=False)
    assert net_of(NET).engine.name == "fast"
    monkeypatch.setenv("NETLIB_ENGINE", "plain")
    assert net_of(NET).engine.name == "plain"
    assert net_of(NET, engine="fast").engine.name == "fast"


def test_an_unknown_engine(net_of: MakeNet, monkeypatch: pytest.MonkeyPatch) -> None:
    message = r"unknown engine 'plane' \(did you mean 'plain'\?\); known: fast, plain"
    with pytest.raises(netlib.NetlibError, match=message):
        net_of(NET, engine="plane")
    monkeypatch.setenv("NETLIB_ENGINE", "plane")
    with pytest.raises(netlib.NetlibError, match=message):
        net_of(NET)


def test_without_its_folder_fast_is_refused_by_name_only(
    net_of: MakeNet, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("netlib.engine.has_fast", lambda: False)
    monkeypatch.delenv("NETLIB_ENGINE", raising=False)
    engine._engine.cache_clear()
    try:
        assert net_of(NET).engine.name == "plain"
        with pytest.raises(netlib.NetlibError, match="the engine 'fast' needs the folder fast/"):
            net_of(NET, engine="fast")
    finally:
        engine._engine.cache_clear()


@needs_fast
def test_a_solver_takes_an_engine(solver_of: MakeSolver) -> None:
    solver_of(ONE_WEIGHT, "test_iter: 1 test_interval: 100")
    for name in ("plain", "fast"):
        solver = netlib.get_solver("solver.prototxt", engine=name)
        assert {net.engine.name for net in [solver.net, *solver.test_nets]} == {name}


@needs_fast
def test_an_empty_variable_selects_the_default_engine() -> None:
    """BLAS is configured as usual."""
    code = "import netlib; from netlib import engine; print(engine.get().name, netlib.BLAS_NOTE)"
    out = run_python("-c", code, NETLIB_ENGINE="").out
    assert out.startswith("fast BLAS: ")
    assert "as NumPy sets it up" not in out


def test_plain_has_one_thread() -> None:
    plain = engine.get("plain")
    plain.set_threads(3)
    assert plain.threads() == 1
    with pytest.raises(ValueError, match="at least 1, got 0"):
        plain.set_threads(0)


@pytest.mark.parametrize("name", ["plain", pytest.param("fast", marks=needs_fast)])
def test_for_each(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setenv("NETLIB_ENGINE", name)
    done: list[int] = []
    engine.for_each(range(100), done.append)
    assert sorted(done) == list(range(100))
    with pytest.raises(ZeroDivisionError):
        engine.for_each([1, 0], lambda divisor: done.append(1 // divisor))
