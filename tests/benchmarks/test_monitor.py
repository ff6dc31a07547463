"""Recorded traces and online monitors: traces per second, microseconds per step, beside rtamt and stlrom."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable
from functools import partial
from statistics import median
from typing import Any

import numpy as np
import pytest

from benchmarks import peers_stl
from benchmarks.conftest import Race, Work, ratios, seconds
from benchmarks.peers_stl import FORMULAS, Floats
from stlbench.stl import BatchMonitor, Monitor, horizon, parse, robustness, robustness_trace

pytestmark = pytest.mark.benchmark(timer=time.process_time)

#: batch -> evaluate as many traces
Calls = dict[int, Callable[[], Any]]

NAMES = ["x", "y"]
SAMPLES = 2001
#: batch -> calls that are timed together, some tens of milliseconds
BATCHES = {1: 400, 64: 16, 1024: 1}
STLROM_TRACES = 16
#: traces that an online monitor watches in a turn
ONLINE_TRACES = 20
#: of the online peers, so that a turn takes about a second; 0: 0.3.0 crashes (segmentation fault)
ONLINE_STEPS = {
    "rtamt": {"conjunction": 2001, "nested": 1051, "until": 20},
    "stlrom": {"conjunction": 2001, "nested": 1051, "until": 0},
}


def traces(count: int) -> Floats:
    """Smooth signals around the formulas' thresholds, with some noise: (count, SAMPLES, 2)."""
    generator = np.random.default_rng(0)
    phase = generator.uniform(0, 6, (count, 1, 2))
    noise = generator.normal(0, 0.005, (count, SAMPLES, 2)).cumsum(axis=1)
    wave: Floats = 2 * np.sin(np.linspace(0, 20, SAMPLES)[:, None] + phase) + noise
    return wave


def repeated(work: Callable[[], Any], times: int) -> Work:
    def run() -> None:
        for _ in range(times):
            work()

    return run


@pytest.mark.parametrize("formula", FORMULAS)
@pytest.mark.benchmark(group="robustness at every sample")
def test_full_trace(race: Race, formula: str) -> None:
    """The whole robustness signal, as rtamt gives it, of 2001 samples."""
    parsed, batch = parse(FORMULAS[formula].ours), traces(1024)
    ours: Calls = {n: partial(robustness_trace, parsed, batch[:n], NAMES, "clip") for n in BATCHES}
    peers: dict[str, tuple[Work, int]] = {}
    if peers_stl.imported("rtamt"):
        work = peers_stl.rtamt_offline(formula, batch[0])
        if formula != "until":
            np.testing.assert_allclose([rho for _, rho in work()], ours[1]()[0], atol=1e-12)
        peers["rtamt"] = work, 1
    if peers_stl.imported("stlrom"):
        peers["stlrom"] = peers_stl.stlrom_offline(formula, batch[:STLROM_TRACES], SAMPLES - 1), STLROM_TRACES
    _compare(race, f"monitor_{formula}", ours, peers)


@pytest.mark.parametrize("formula", FORMULAS)
@pytest.mark.benchmark(group="robustness at t = 0")
def test_first_value(race: Race, formula: str) -> None:
    """The robustness at t = 0 alone, which rtamt cannot be asked for."""
    parsed, batch = parse(FORMULAS[formula].ours), traces(1024)
    ours: Calls = {n: partial(robustness, parsed, batch[:n], NAMES) for n in BATCHES}
    peers: dict[str, tuple[Work, int]] = {}
    if peers_stl.imported("stlrom"):
        work = peers_stl.stlrom_offline(formula, batch[:STLROM_TRACES], 0.0)
        np.testing.assert_allclose(work(), ours[64]()[:STLROM_TRACES], atol=0.1)  # the same question: see peers_stl
        peers["stlrom"] = work, STLROM_TRACES
    _compare(race, f"monitor_{formula}_t0", ours, peers, asked=("stlrom",))


def _compare(
    race: Race,
    name: str,
    ours: Calls,
    peers: dict[str, tuple[Work, int]],
    asked: tuple[str, ...] = ("rtamt", "stlrom"),
) -> None:
    """Notes traces/s of all, and of each peer how many times as fast we are: a batch, and in the batch of the least."""
    slow = {peer: peers.pop(peer) for peer in list(peers) if (name, peer) == ("monitor_until", "rtamt")}
    works = {str(n): repeated(call, BATCHES[n]) for n, call in ours.items()}
    times = race.run(works.pop("1"), works | {peer: work for peer, (work, _) in peers.items()})
    each = {n: [t / BATCHES[n] / n for t in times["ours" if n == 1 else str(n)]] for n in BATCHES}
    theirs = {peer: [t / count for t in times[peer]] for peer, (_, count) in peers.items()}
    theirs |= {peer: [seconds(work)] for peer, (work, _) in slow.items()}  # a minute and more: once
    for n, spent in each.items():
        race.note(**{f"{name}_{n}_traces_per_second": [1 / t for t in spent]})
    for peer in asked:
        if peer not in theirs:
            race.note(**{f"{name}_vs_{peer}": f"{peer} is not installed"})
            continue
        once = len(theirs[peer]) == 1
        found = {n: ratios(theirs[peer], [median(spent)] if once else spent) for n, spent in each.items()}
        race.note(**{f"{name}_{peer}_traces_per_second": [1 / t for t in theirs[peer]]})
        race.note(**{f"{name}_{n}_vs_{peer}": values for n, values in found.items()})
        race.note(**{f"{name}_vs_{peer}": min(found.values(), key=median)})


@pytest.mark.parametrize("formula", FORMULAS)
@pytest.mark.benchmark(group="online monitor, a trace")
def test_online(race: Race, formula: str) -> None:
    """CPU microseconds of a step from the first sample to the last that counts, samples as tuples and as arrays."""
    parsed, trace = parse(FORMULAS[formula].ours), traces(1)[0]
    needed = trace[: horizon(parsed) + 1]
    tuples, arrays = [tuple(row) for row in needed.tolist()], list(needed)
    works = {"array": repeated(lambda: _watch(Monitor(parsed, NAMES), arrays), ONLINE_TRACES)}
    steps = dict.fromkeys(("ours", "array"), ONLINE_TRACES * len(arrays))
    for peer, make in (("rtamt", peers_stl.rtamt_online), ("stlrom", peers_stl.stlrom_online)):
        if not peers_stl.imported(peer):
            race.note(**{f"online_{formula}_vs_{peer}": f"{peer} is not installed"})
        elif not (count := ONLINE_STEPS[peer][formula]):
            race.note(**{f"online_{formula}_vs_{peer}": f"{peer} crashes on an incomplete trace"})
        else:
            works[peer], steps[peer] = make(formula, trace[:count]), count
    times = race.run(repeated(lambda: _watch(Monitor(parsed, NAMES), tuples), ONLINE_TRACES), works, turns=5)
    each = {key: [t / steps[key] for t in spent] for key, spent in times.items()}
    for key, spent in each.items():
        name = f"online_{formula}" if key == "ours" else f"online_{formula}_{key}"
        race.note(**{f"{name}_microseconds": [t * 1e6 for t in spent]})
        if key in ONLINE_STEPS:
            race.note(**{f"online_{formula}_vs_{key}": ratios(spent, each["ours"])})


def _watch(monitor: Monitor | BatchMonitor, samples: list[Any]) -> None:
    update = monitor.update
    for sample in samples:
        update(sample)


@pytest.mark.parametrize("count", [16, 64, 1024])
@pytest.mark.parametrize("formula", FORMULAS)
@pytest.mark.benchmark(group="online monitor, many traces")
def test_online_batch(race: Race, formula: str, count: int) -> None:
    """CPU nanoseconds of a step of one of `count` traces that are watched together."""
    parsed = parse(FORMULAS[formula].ours)
    rows = list(np.ascontiguousarray(traces(count).swapaxes(0, 1)[: horizon(parsed) + 1]))
    times = race.run(lambda: _watch(BatchMonitor(parsed, NAMES, count), rows), {}, turns=5)["ours"]
    race.note(**{f"online_{formula}_{count}_nanoseconds": [t * 1e9 / len(rows) / count for t in times]})


@pytest.mark.parametrize("formula", FORMULAS)
@pytest.mark.benchmark(group="memory")
def test_memory(race: Race, formula: str) -> None:
    """Megabytes at work beyond traces and answer, at every sample of 64 and 1024 traces, and of 8 times the samples."""
    parsed, batch = parse(FORMULAS[formula].ours), traces(1024)
    long = np.tile(batch[:64], (1, 8, 1))
    for name, recorded in (("64", batch[:64]), ("1024", batch), ("64_long", long)):
        race.note(**{f"memory_{formula}_{name}_megabytes": _working_set(parsed, recorded) / 1e6})
    race.run(lambda: robustness_trace(parsed, batch, NAMES, "clip"), {}, turns=2)


def _working_set(formula: Any, recorded: Floats) -> float:
    tracemalloc.start()
    answer = robustness_trace(formula, recorded, NAMES, "clip")
    peak = tracemalloc.get_traced_memory()[1] - answer.nbytes
    tracemalloc.stop()
    return float(peak)
