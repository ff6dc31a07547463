"""Recorded traces and online monitors: traces per second, microseconds per step, beside five other libraries."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable, Collection, Iterable, Mapping
from functools import partial
from statistics import median
from typing import Any

import numpy as np
import pytest

from benchmarks import peers_stl
from benchmarks.conftest import Race, Work, ratios, seconds, without
from benchmarks.peers_stl import FORMULAS, Floats, Values
from stlbench.stl import BatchMonitor, Monitor, horizon, parse, robustness, robustness_trace

pytestmark = pytest.mark.benchmark(timer=time.process_time)

#: batch -> evaluate as many traces
Calls = dict[int, Callable[[], Any]]
#: peer -> its work, and how many traces that is
Peers = dict[str, tuple[Callable[[], Values], int]]

NAMES = ["x", "y"]
SAMPLES = 2001
#: batch -> calls that are timed together, some tens of milliseconds
BATCHES = {1: 400, 64: 16, 1024: 1}
#: peer -> its module
MODULES = {"rtamt": "rtamt", "stlrom": "stlrom", "sentil": "sentil", "mstlo": "mstlo_python", "tidystl": "tidystl"}
FIRST = ("stlrom", "sentil")
"""Who can be asked for the robustness at t = 0 alone."""
MANY = 16
"""Traces of the peers that take several."""
SLOW = {("rtamt", "until"), ("tidystl", "until")}
"""Seconds to minutes for a trace: timed once."""
EXACT, DENSE = 1e-12, 0.1
"""How far a peer's values may be from ours: rounding, or the signal's change within a step; see `peers_stl`."""

#: traces that an online monitor watches in a turn
ONLINE_TRACES = 20
#: of the online peers, so that a turn takes about a second; 0: 0.3.0 crashes (segmentation fault)
UNTIL_STEPS = {"rtamt": 20, "stlrom": 0, "sentil": 901, "mstlo": 901}
ONLINE_STEPS = {peer: {"conjunction": 2001, "nested": 1051, "until": steps} for peer, steps in UNTIL_STEPS.items()}
ONLINE = {peer: getattr(peers_stl, f"{peer}_online") for peer in UNTIL_STEPS}


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
    """The whole robustness signal of 2001 samples. Values are compared where no window reaches beyond them."""
    parsed, batch = parse(FORMULAS[formula].ours), traces(1024)
    ours: Calls = {n: partial(robustness_trace, parsed, batch[:n], NAMES, "clip") for n in BATCHES}
    lacking = _lacking(MODULES)
    peers: Peers = {peer: _full(peer, formula, batch) for peer in MODULES if peer not in lacking}
    complete = SAMPLES - horizon(parsed)
    for peer in peers.keys() - {"stlrom"}:  # its values are compared in test_first_value
        if (peer, formula) != ("rtamt", "until"):
            dense = formula == "until" and peer in ("mstlo", "tidystl")
            values, known = peers[peer][0](), ours[1]()[0]
            np.testing.assert_allclose(values[:complete], known[:complete], atol=DENSE if dense else EXACT)
    slow = {peer for peer in peers if (peer, formula) in SLOW}
    _compare(race, f"monitor_{formula}", ours, peers, lacking, slow)


def _full(peer: str, formula: str, batch: Floats) -> tuple[Callable[[], Values], int]:
    """The whole robustness signal by a peer."""
    match peer:
        case "rtamt":
            return peers_stl.rtamt_offline(formula, batch[0]), 1
        case "stlrom":
            return peers_stl.stlrom_offline(formula, batch[:MANY], SAMPLES - 1), MANY
        case "sentil":
            return peers_stl.sentil_offline(formula, batch[0]), 1
        case "mstlo":
            return peers_stl.mstlo_offline(formula, batch[0]), 1
        case _:
            count = 1 if (peer, formula) in SLOW else MANY
            return peers_stl.tidystl_offline(formula, batch[:count]), count


@pytest.mark.parametrize("formula", FORMULAS)
@pytest.mark.benchmark(group="robustness at t = 0")
def test_first_value(race: Race, formula: str) -> None:
    """The robustness at t = 0 alone, which the others cannot be asked for."""
    parsed, batch = parse(FORMULAS[formula].ours), traces(1024)
    ours: Calls = {n: partial(robustness, parsed, batch[:n], NAMES) for n in BATCHES}
    known, lacking, peers = ours[64](), _lacking(FIRST), Peers()
    if "stlrom" not in lacking:
        peers["stlrom"] = peers_stl.stlrom_offline(formula, batch[:MANY], 0.0), MANY
        np.testing.assert_allclose(peers["stlrom"][0](), known[:MANY], atol=DENSE)
    if "sentil" not in lacking:
        peers["sentil"] = peers_stl.sentil_first(formula, batch[0]), 1
        np.testing.assert_allclose(peers["sentil"][0](), known[:1], atol=EXACT)
    _compare(race, f"monitor_{formula}_t0", ours, peers, lacking, set())


def _lacking(peers: Iterable[str]) -> dict[str, str]:
    """Peer -> why it is not there."""
    return {peer: reason for peer in peers for reason in without([MODULES[peer]]).values()}


def _compare(
    race: Race, name: str, ours: Calls, peers: Peers, lacking: Mapping[str, str], slow: Collection[str]
) -> None:
    """Notes traces/s of all, and of each peer how many times as fast we are: a batch, and in the batch of the least.

    The `slow` are timed once.
    """
    works = {str(n): repeated(call, BATCHES[n]) for n, call in ours.items()}
    quick = {peer: work for peer, (work, _) in peers.items() if peer not in slow}
    times = race.run(works.pop("1"), works | quick)
    each = {n: [t / BATCHES[n] / n for t in times["ours" if n == 1 else str(n)]] for n in BATCHES}
    for n, spent in each.items():
        race.note(**{f"{name}_{n}_traces_per_second": [1 / t for t in spent]})
    for peer, reason in lacking.items():
        race.note(**{f"{name}_vs_{peer}": reason})
    for peer, (work, count) in peers.items():
        theirs = [t / count for t in ([seconds(work)] if peer in slow else times[peer])]
        found = {n: ratios(theirs, [median(spent)] if peer in slow else spent) for n, spent in each.items()}
        race.note(**{f"{name}_{peer}_traces_per_second": [1 / t for t in theirs]})
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
    lacking = _lacking(ONLINE)
    for peer in ONLINE:
        if count := 0 if peer in lacking else ONLINE_STEPS[peer][formula]:
            work = ONLINE[peer](formula, trace[:count])
            _check_last(peer, formula, work, robustness(parsed, trace, NAMES))
            rounds = ONLINE_TRACES if peer == "sentil" else 1
            works[peer], steps[peer] = repeated(work, rounds), rounds * count
        else:
            reason = lacking.get(peer, f"{peer} crashes on an incomplete trace")
            race.note(**{f"online_{formula}_vs_{peer}": reason})
    times = race.run(repeated(lambda: _watch(Monitor(parsed, NAMES), tuples), ONLINE_TRACES), works, turns=5)
    each = {key: [t / steps[key] for t in spent] for key, spent in times.items()}
    for key, spent in each.items():
        name = f"online_{formula}" if key == "ours" else f"online_{formula}_{key}"
        race.note(**{f"{name}_microseconds": [t * 1e6 for t in spent]})
        if key in ONLINE:
            race.note(**{f"online_{formula}_vs_{key}": ratios(spent, each["ours"])})


def _check_last(peer: str, formula: str, work: Callable[[], Any], known: float) -> None:
    """What a peer says after the last sample is our value at t = 0."""
    if peer in ("sentil", "mstlo"):
        assert work() == pytest.approx(known, abs=DENSE if (peer, formula) == ("mstlo", "until") else EXACT)


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
