"""Solver: Caffe's training loop.

    solver = netlib.get_solver("solver.prototxt")
    solver.solve()                 all of it, or
    solver.step(100)               some iterations

``iter`` always equals the number of updates made. What a training prints is Caffe's log, line for line, written
to the logger "netlib"; tools/train.py gives it Caffe's time stamps.
"""

from __future__ import annotations

import dataclasses
import functools
import logging
import math
import secrets
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from netlib import parallel, prototxt, schema, snapshot
from netlib.errors import DivergenceError, NetlibError, PrototxtError, WeightsError, did_you_mean
from netlib.net import Net, Param, load_parameter
from netlib.paths import exists, find
from netlib.prototxt import Message
from netlib.schema import NetParameter, NetState, SolverParameter
from netlib.snapshot import SolverState
from netlib.updates import POLICIES, RULES, learning_rate, steps_taken

log = logging.getLogger("netlib")

# A solver's options that change the course of a training; a resume says which of them are not what they were.
_COURSE = (
    "type", "base_lr", "lr_policy", "gamma", "power", "stepsize", "stepvalue", "rampup_interval", "rampup_lr",
    "max_iter", "iter_size", "momentum", "momentum2", "rms_decay", "delta", "weight_decay", "regularization_type",
    "clip_gradients",
)  # fmt: skip


class Solver:
    """Trains a net.

    param       SolverParameter
    net         the training net
    test_nets   nets for testing; they share the parameters of ``net``
    iter        number of updates made
    history     per parameter, the arrays of the update rule

    ``requested`` may be set to "stop" or "snapshot" at any time, by a signal handler or another thread: the
    iteration is finished first.
    """

    def __init__(self, param: SolverParameter, source: str = "<solver>", seed: int | None = None) -> None:
        self.param, self.source = _checked(param), source
        self.seed = seed if seed is not None else param.random_seed if param.random_seed >= 0 else secrets.randbits(31)
        self.iter = 0
        self.requested: str | None = None
        self.on_iteration: Callable[[Solver], None] | None = None
        self.net = self._make_net(*_train_net(param, source), param.train_state, phase="TRAIN", number=0)
        self.rule, histories = RULES[param.type]
        self.history = [[np.zeros_like(p.blob.data) for _ in range(histories)] for p in self.net.learnable]
        self.smoothed: deque[float] = deque(maxlen=max(1, param.average_loss))
        self.test_nets = self._make_test_nets()
        for names in param.weights:
            for name in names.split(","):
                self.copy_weights(name.strip())
        self._lap: tuple[int, float] = (0, time.perf_counter())

    # ------------------------------------------------------------------------------------------ nets

    def _make_net(self, name: str, param: NetParameter, state: NetState, phase: schema.Phase, number: int) -> Net:
        log.info("Creating %s net from net file: %s", "training" if phase == "TRAIN" else "test", name)
        merged = NetState(phase, max(param.state.level, state.level), param.state.stage + state.stage)
        net = Net(param, state=merged, seed=self.seed + number)
        net.source = name
        return net

    def _make_test_nets(self) -> list[Net]:
        nets = []
        p = self.param
        sources = _test_nets(p, self.source)
        for field in ("test_iter", "test_state"):
            given = len(getattr(p, field))
            if given != len(sources) and (given or (field == "test_iter" and p.test_interval)):
                where = schema.position_of(p, field)
                raise PrototxtError(where, f"{given} {field} for {len(sources)} test nets; expected one each")
        for i, (name, param) in enumerate(sources):
            state = p.test_state[i] if p.test_state else NetState()
            nets.append(self._make_net(name, param, state, phase="TEST", number=i + 1))
            nets[-1].share_params(self.net)
        return nets

    def copy_weights(self, path: str | Path) -> None:
        """Start from these weights ("finetuning"). Raises WeightsError."""
        path = find(str(path), self.source)
        log.info("Finetuning from %s", path)
        ignored, missing = self.net.copy_from(path)
        for name in ignored:
            log.info("Ignoring source layer %s", name)
        for name in missing:
            log.info("Not in %s, keeps its initial values: layer %s", path, name)

    # ------------------------------------------------------------------------------------------ training

    def solve(self, resume: str | Path | None = None) -> bool:
        """Train until max_iter; False if a request stopped it early. Takes the last snapshot and test."""
        log.info("Solving %s", self.net.name)
        log.info("Learning Rate Policy: %s", self.param.lr_policy)
        if self.param.snapshot or self.param.snapshot_after_train:
            snapshot.probe_directory(self.prefix)
            self._extra()  # a layer whose state cannot be stored is found now, not after hours
        if resume is not None:
            self.restore(resume)
        finished = self.step(self.param.max_iter - self.iter)
        p = self.param
        if p.snapshot_after_train and not (p.snapshot and self.iter % p.snapshot == 0) and not self._saved():
            self.snapshot()
        if not finished:
            log.info("Optimization stopped early.")
            return False
        if p.display and self.iter % p.display == 0:
            loss = self._finite(self.net.run_forward())
            self.smoothed.append(loss)
            log.info("Iteration %d, loss = %.6g", self.iter, self.loss)
        if p.test_interval and self.iter % p.test_interval == 0:
            self.test_all()
        log.info("Optimization Done.")
        return True

    def step(self, iterations: int) -> bool:
        """Make some updates; False if a request stopped it early."""
        self._lap = (self.iter, time.perf_counter())
        for _ in range(iterations):
            self.net.clear_param_diffs()
            if self._test_is_due():
                self.test_all()
                if self.requested == "stop":
                    return self._stop()
            loss = self._forward_backward()
            self.smoothed.append(loss)
            if self._display_is_due():
                self._display()
            self._update()
            self.iter += 1
            if self.on_iteration is not None:
                self.on_iteration(self)
            if self.requested == "stop":
                return self._stop()
            asked, self.requested = self.requested, None
            if asked == "snapshot" or (self.param.snapshot and self.iter % self.param.snapshot == 0):
                self.snapshot()
        return True

    def _stop(self) -> bool:
        self.requested = None
        self.snapshot()
        return False

    def _forward_backward(self) -> float:
        """Sum the gradients of iter_size batches; returns the mean loss."""
        total = 0.0
        for _ in range(self.param.iter_size):
            total += self._finite(self.net.run_forward())
            self.net.run_backward()
        return total / self.param.iter_size

    def _finite(self, loss: float) -> float:
        if not np.isfinite(loss):
            where = self.net.first_not_finite() or "the loss alone"
            raise DivergenceError(
                f"iteration {self.iter}: the loss is {loss}; the first value that is not finite is in {where}. "
                "Lower base_lr, set clip_gradients, or look at the data; the last snapshot is untouched"
            )
        return loss

    @property
    def loss(self) -> float:
        """The mean loss of the last average_loss iterations."""
        return float(np.mean(self.smoothed)) if self.smoothed else float("nan")

    def _update(self) -> None:
        """Clip, divide by iter_size, decay, apply the rule: Caffe's order."""
        p = self.param
        rate = learning_rate(p, self.iter)
        if self._display_is_due():
            log.info("Iteration %d, lr = %.6g", self.iter, rate)
        trained = [(param, h) for param, h in zip(self.net.learnable, self.history) if param.spec.lr_mult != 0]
        scale = self._clip([param for param, _ in trained]) / p.iter_size
        parallel.run([functools.partial(self._update_param, param, h, scale, rate) for param, h in trained])

    def _update_param(self, param: Param, history: list[Any], scale: float, rate: float) -> None:
        p, w, g = self.param, param.blob.data, param.blob.diff
        if scale != 1:
            g *= scale
        decay = p.weight_decay * param.spec.decay_mult
        if decay:
            g += decay * (w if p.regularization_type == "L2" else np.sign(w))
        self.rule(p, w, g, rate * param.spec.lr_mult, history, self.iter + 1)

    def _clip(self, params: list[Param]) -> float:
        """The factor that brings the norm of all gradients together down to clip_gradients."""
        bound = self.param.clip_gradients
        if bound < 0:
            return 1.0
        norm = float(np.sqrt(sum(float(np.vdot(p.blob.diff, p.blob.diff)) for p in params)))
        if norm <= bound:
            return 1.0
        log.info("Gradient clipping: scaling down gradients (L2 norm %.6g > %.6g) by scale factor %.6g",
                 norm, bound, bound / norm)  # fmt: skip
        return bound / norm

    # ------------------------------------------------------------------------------------------ reports

    def _display_is_due(self) -> bool:
        return bool(self.param.display) and self.iter % self.param.display == 0

    def _display(self) -> None:
        before, since = self._lap
        now = time.perf_counter()
        self._lap = (self.iter, now)
        done, seconds = self.iter - before, now - since
        speed = done / seconds if seconds and done else 0.0
        log.info("Iteration %d (%.6g iter/s, %.6gs/%d iters), loss = %.6g",
                 self.iter, speed, seconds, self.param.display, self.loss)  # fmt: skip
        self._report("Train", self.net, {name: self.net.blobs[name].data.reshape(-1) for name in self.net.outputs})
        if self.param.debug_info:
            self._debug()

    def _report(self, what: str, net: Net, outputs: dict[str, Any]) -> None:
        weights = {name: weight for _, weight, name in net.losses}
        number = 0
        for name, values in outputs.items():
            for value in values:
                weight = weights.get(name)
                tail = f" (* {weight:.6g} = {weight * value:.6g} loss)" if weight else ""
                log.info("    %s net output #%d: %s = %.6g%s", what, number, name, value, tail)
                number += 1

    def _debug(self) -> None:
        """Mean absolute values of everything, Caffe's debug_info."""
        for at in self.net.connections:
            for name, blob in zip(at.layer.spec.top, at.top):
                log.info("    [Forward] Layer %s, top blob %s data: %.6g", at.layer.name, name, _mean(blob.data))
        for at in reversed(self.net.connections):
            if not at.needs_backward:
                continue
            for name, blob, down in zip(at.layer.spec.bottom, at.bottom, at.propagate_down):
                if down:
                    log.info(
                        "    [Backward] Layer %s, bottom blob %s diff: %.6g", at.layer.name, name, _mean(blob.diff)
                    )
        for p in self.net.learnable:
            log.info("    [Update] Layer %s, param %d data: %.6g; diff: %.6g",
                     p.layer, p.index, _mean(p.blob.data), _mean(p.blob.diff))  # fmt: skip

    def _test_is_due(self) -> bool:
        p = self.param
        return bool(p.test_interval) and self.iter % p.test_interval == 0 and (self.iter > 0 or p.test_initialization)

    def test_all(self) -> list[dict[str, Any]]:
        """Test every test net; returns the mean of each output."""
        means = []
        for i in range(len(self.test_nets)):
            if self.requested == "stop":
                break
            means.append(self.test(i))
        return means

    def test(self, number: int) -> dict[str, Any]:
        """Run one test net over test_iter batches; returns and logs the mean of each output."""
        net, batches = self.test_nets[number], self.param.test_iter[number]
        begun = time.perf_counter()
        log.info("Iteration %d, Testing net (#%d)", self.iter, number)
        sums: dict[str, Any] = {}
        loss = 0.0
        for _ in range(batches):
            loss += net.run_forward()
            for name in net.outputs:
                sums[name] = sums.get(name, 0.0) + net.blobs[name].data.astype(np.float64).reshape(-1)
            if self.requested == "stop":
                log.info("Test interrupted.")
                return {}
        if not np.isfinite(loss):
            where = net.first_not_finite() or "its loss alone"
            log.error("Test net (#%d) has a value that is not finite: %s", number, where)
        means = {name: total / batches for name, total in sums.items()}
        if self.param.test_compute_loss:
            log.info("Test loss: %.6g", loss / batches)
        self._report("Test", net, means)
        self._lap = (self._lap[0], self._lap[1] + time.perf_counter() - begun)  # tests do not count as training
        return means

    # ------------------------------------------------------------------------------------------ snapshots

    @property
    def prefix(self) -> Path:
        """snapshot_prefix; a directory gets the solver file's name in it, and nothing stands for that name."""
        given, name = self.param.snapshot_prefix, Path(self.source).stem
        if not given:
            return Path(self.source).with_suffix("")
        return Path(given) / name if given.endswith("/") or Path(given).is_dir() else Path(given)

    def snapshot_paths(self, iteration: int) -> tuple[Path, Path]:
        """Where the weights and the solver state after ``iteration`` updates go."""
        stem = f"{self.prefix}_iter_{iteration}"
        return Path(f"{stem}.caffemodel.h5"), Path(f"{stem}.solverstate.h5")

    def _saved(self) -> bool:
        return getattr(self, "_saved_iter", None) == self.iter

    def snapshot(self) -> Path:
        """Write weights and solver state; returns the path of the state. Raises WeightsError."""
        for param in self.net.learnable:
            if not np.isfinite(param.blob.data).all():
                raise DivergenceError(
                    f"iteration {self.iter}: parameter {param.index} of layer {param.layer!r} is not finite, so no "
                    "snapshot is written. Lower base_lr or set clip_gradients; the last snapshot is untouched"
                )
        weights_path, state_path = self.snapshot_paths(self.iter)
        log.info("Snapshotting to HDF5 file %s", weights_path)
        log.info("Snapshotting solver state to HDF5 file %s", state_path)
        histories = [h[i] for i in range(RULES[self.param.type][1]) for h in self.history]  # Caffe's order
        state = SolverState(self.iter, steps_taken(self.param, self.iter), str(weights_path), histories, self._extra())
        snapshot.write_pair(self.net, state, weights_path, state_path)
        self._saved_iter = self.iter
        return state_path

    def _extra(self) -> dict[str, Any]:
        course = {name: getattr(self.param, name) for name in _COURSE}
        extra = {
            "solver": {**course, "batch": self._batch()},
            "smoothed": list(self.smoothed),
            "layers": [net.layer_states() for net in [self.net, *self.test_nets]],
        }
        return snapshot.as_plain(extra)

    def _batch(self) -> int:
        first = next((at.top[0].shape for at in self.net.connections if at.top), ())
        return first[0] if first else 0

    def restore(self, path: str | Path) -> None:
        """Go on from a solver state, bit for bit if this project wrote it. Raises WeightsError."""
        state = snapshot.read_state(path)
        weights = snapshot.same_file_beside(path, state.learned_net)
        expected = [h.shape for h in self.history[0]] if self.history else []
        if len(state.history) != len(self.history) * len(expected):
            raise WeightsError(
                f"{path}: {len(state.history)} histories, but {self.param.type} on this net has "
                f"{len(self.history) * len(expected)}; is it from another solver type or net?"
            )
        count = len(self.history)
        for i, array in enumerate(state.history):
            param, target = self.net.learnable[i % count], self.history[i % count][i // count]
            if array.shape != target.shape:
                raise WeightsError(f"{path}: history {i} has shape {array.shape}, "
                                   f"layer {param.layer!r} parameter {param.index} {target.shape}")  # fmt: skip
        if state.extra.get("weights_crc") not in (None, snapshot.checksum(weights)):
            raise WeightsError(f"{path}: the weights beside it, {weights}, are those of another snapshot")
        self.net.copy_from(weights, strict=True)
        for i, array in enumerate(state.history):
            self.history[i % count][i // count][...] = array
        self.iter = state.iter
        self.smoothed.clear()
        self.smoothed.extend(state.extra.get("smoothed", []))
        try:
            for net, states in zip([self.net, *self.test_nets], state.extra.get("layers", [])):
                net.restore_layer_states(states)
        except (LookupError, TypeError, ValueError, AttributeError) as error:
            raise WeightsError(f"{path}: damaged: the state of a layer cannot be restored ({error})") from error
        self._saved_iter = self.iter
        log.info("SGDSolver: restoring history")
        self._tell_restored(path, weights, state)

    def _tell_restored(self, path: str | Path, weights: Path, state: SolverState) -> None:
        log.info("Resuming at iteration %d: weights from %s, history from %s", self.iter, weights, path)
        if not state.extra:
            log.info("Written by Caffe: data positions and random numbers start anew")
            return
        now = snapshot.as_plain({**{name: getattr(self.param, name) for name in _COURSE}, "batch": self._batch()})
        if self.param.lr_policy != "poly":
            now.pop("max_iter")  # training longer changes nothing on the way
        changes = []
        if not self._same_data(state):
            changes.append("the data files; they are read from the first row")
        defaults = snapshot.as_plain({name: getattr(SolverParameter, name) for name in _COURSE})
        then = {**defaults, **state.extra.get("solver", {})}  # a state may be older than a field
        for name in now:
            old = then.get(name)
            if now[name] != old:
                what = "batch size" if name == "batch" else name
                changes.append(f"{what} was {_g(old)}, is now {_g(now[name])}")
        exactly = "; the training goes on exactly" if not changes else ""
        log.info("Restored: data positions, random numbers, averaged loss%s", exactly)
        for change in changes:
            log.info("Changed: %s", change)

    def _same_data(self, state: SolverState) -> bool:
        """Do all nets read the files that they read when the state was written?"""
        for net, then in zip([self.net, *self.test_nets], state.extra.get("layers", [])):
            for name, now in snapshot.as_plain(net.layer_states()).items():
                if now.get("files") != then.get(name, {}).get("files"):
                    return False
        return True


def _g(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _mean(array: Any) -> float:
    return float(np.abs(array).mean()) if array.size else 0.0


def get_solver(path: str | Path, seed: int | None = None, **changes: Any) -> Solver:
    """The solver of a prototxt file; ``changes`` replace its fields (``max_iter=10``). Raises NetlibError."""
    param = schema.read(prototxt.parse_file(path), SolverParameter, "solver")
    if changes:
        tree = schema.tree_of(param)
        param = dataclasses.replace(param, **changes)
        object.__setattr__(param, "_tree", tree)
    return Solver(param, str(path), seed)


_OLD_TYPES = {"SGD": "SGD", "NESTEROV": "Nesterov", "ADAGRAD": "AdaGrad", "RMSPROP": "RMSProp",
              "ADADELTA": "AdaDelta", "ADAM": "Adam"}  # fmt: skip


def _checked(p: SolverParameter) -> SolverParameter:
    """Raise PrototxtError for options that cannot work; says what is accepted but ignored."""

    def fail(name: str, message: str) -> PrototxtError:
        return PrototxtError(schema.position_of(p, name), message)

    if p.solver_type is not None:
        object.__setattr__(p, "type", _OLD_TYPES[p.solver_type])
    if p.type not in RULES:
        raise fail("type", f"unknown solver type {p.type!r}{did_you_mean(p.type, RULES)}; known: {', '.join(RULES)}")
    if p.lr_policy not in POLICIES:
        found = (
            f"unknown lr_policy {p.lr_policy!r}{did_you_mean(p.lr_policy, POLICIES)}" if p.lr_policy else "no lr_policy"
        )
        raise fail("lr_policy", f"{found}; known: {', '.join(POLICIES)}")
    if p.lr_policy == "step" and not p.stepsize:
        raise fail("lr_policy", "lr_policy 'step' needs a stepsize of at least 1")
    if p.lr_policy == "multistep" and not p.stepvalue:
        raise fail("lr_policy", "lr_policy 'multistep' needs stepvalue")
    if p.lr_policy == "poly" and not p.max_iter:
        raise fail("lr_policy", "lr_policy 'poly' needs max_iter")
    if p.type in ("AdaGrad", "RMSProp") and p.momentum:
        raise fail("momentum", f"{p.type} has no momentum; leave the field out")
    for field in dataclasses.fields(p):
        value = getattr(p, field.name)
        if isinstance(value, float) and not math.isfinite(value):
            raise fail(field.name, f"{field.name} is {value}; expected a finite number")
    if p.average_loss > 10**6:
        raise fail("average_loss", f"average_loss {p.average_loss} is more than a million iterations")
    if 0 in p.test_iter:
        raise fail("test_iter", "test_iter must be at least 1")
    tree = schema.tree_of(p)
    if p.base_lr < 0 or (tree is not None and not tree.values("base_lr") and not p.base_lr):
        raise fail("base_lr", "no base_lr" if not p.base_lr else f"base_lr {p.base_lr:g} is negative")
    if p.rampup_lr < 0:
        raise fail("rampup_lr", f"rampup_lr {p.rampup_lr:g} is negative")
    if p.lr_policy in ("step", "exp", "multistep") and p.gamma <= 0:
        raise fail("gamma", f"lr_policy {p.lr_policy!r} needs a gamma above 0, found {p.gamma:g}")
    if p.lr_policy == "inv" and p.gamma < 0:
        raise fail("gamma", f"lr_policy 'inv' needs a gamma that is not negative, found {p.gamma:g}")
    if p.snapshot_diff:
        log.info("snapshot_diff is accepted, but gradients are not stored")
    for name in ("momentum", "momentum2", "rms_decay"):
        if not 0 <= getattr(p, name) < 1:
            raise fail(name, f"{name} {getattr(p, name):g} must be at least 0 and less than 1")
    if p.regularization_type not in ("L1", "L2"):
        raise fail("regularization_type", f"unknown regularization_type {p.regularization_type!r}; known: L1, L2")
    if p.iter_size < 1 or p.average_loss < 1:
        raise fail("iter_size", "iter_size and average_loss must be at least 1")
    if p.snapshot_format == "BINARYPROTO":
        raise fail("snapshot_format", "snapshot_format BINARYPROTO is not supported; expected HDF5")
    if p.test_interval and not p.test_iter:
        raise fail("test_interval", "test_interval without test_iter; expected one test_iter for each test net")
    if p.solver_mode == "GPU":
        log.info("solver_mode: GPU is accepted, but this runs on the CPU")
    return p


def _train_net(p: SolverParameter, source: str) -> tuple[str, NetParameter]:
    """The one training net that the solver names."""
    given = [(f, getattr(p, f)) for f in ("net", "net_param", "train_net", "train_net_param") if getattr(p, f)]
    if len(given) != 1:
        names = ", ".join(name for name, _ in given) or "none"
        raise PrototxtError(
            schema.position_of(p, given[1][0] if given else None),
            f"expected one of net, net_param, train_net, train_net_param; found {names}",
        )
    return _load(given[0][1], source)


def _test_nets(p: SolverParameter, source: str) -> list[tuple[str, NetParameter]]:
    """Nets to test on: test_net_param, test_net, or ``net`` itself for what remains of test_iter."""
    named: list[str | Message] = [*p.test_net_param, *p.test_net]
    general = p.net_param if p.net_param is not None else p.net
    if general is not None:
        named += [general] * (len(p.test_iter) - len(named))
    return [_load(net, source) for net in named]


def _load(net: str | Message, source: str) -> tuple[str, NetParameter]:
    if isinstance(net, Message):
        return "net_param", load_parameter(net)
    path = find(net, source)
    if not exists(path):
        raise NetlibError(f"{source}: the net {net!r} does not exist, from the working directory or from the solver's")
    return str(path), load_parameter(path)
