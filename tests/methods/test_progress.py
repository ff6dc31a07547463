"""What a formula is worth so far, from a memory of few numbers, against the same on the whole trace."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.episodes import specification
from hypothesis import given
from hypothesis import strategies as st

from stlbench import stl
from stlbench.contract import Array, Specification, Unsuitable
from stlbench_methods.formula_parts import Margins, Truths
from stlbench_methods.progress import Progress

BOX = {"x": (-3.0, 3.0), "y": (-3.0, 3.0)}
STEPS, ROWS = 14, 6
PSIS = st.sampled_from(["x >= 1", "!(y <= 1)", "(x >= 1 | y < 0)", "(abs(x) <= 1 & y >= -1)"])
intervals = st.tuples(st.integers(0, 4), st.integers(0, 3)).map(lambda ends: f"[{ends[0]},{sum(ends)}]")


def grow(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    return st.one_of(
        st.builds("{}{} ({})".format, st.sampled_from(["F", "G", "!F", "!G"]), intervals, inner),
        st.builds("({} {} {})".format, inner, st.sampled_from(["&", "|", "->"]), inner),
    )


formulas = st.recursive(PSIS, grow, max_leaves=5).filter(lambda text: stl.horizon(stl.parse(text)) <= STEPS)
names = st.sampled_from(["classic", "lse", "gilpin", "agm", "gmsr"])
seeds = st.integers(0, 2**32)


def samples(seed: int) -> Array:
    return np.random.default_rng(seed).integers(-12, 13, size=(ROWS, STEPS + 1, 2)) / 4


def memories(progress: Progress, traces: Array) -> list[Array]:
    zero = np.zeros(len(traces), dtype=np.int64)
    first = progress.begin(traces[:, 0], zero)
    return [first, *progress.along(traces[:, 1:].transpose(1, 0, 2), zero + 1, first)]


def at(t: int) -> Array:
    return np.full(ROWS, t)


def of_margins(text: str, name: str) -> tuple[Specification, Margins, Progress]:
    spec = specification(text, BOX, steps=STEPS)
    values = Margins(spec, stl.semantics(name))  # type: ignore[arg-type]
    return spec, values, Progress(spec, values)


@given(text=formulas, name=names, seed=seeds)
def test_at_the_end_it_is_the_formulas_value(text: str, name: str, seed: int) -> None:
    spec, values, progress = of_margins(text, name)
    traces = samples(seed)
    whole = stl.Quantity(spec.formula, spec.signals, values.semantics, values.of)
    expected = whole.values(whole.read(traces))[:, 0]
    last = memories(progress, traces)[-1]
    assert last.shape == (ROWS, progress.size)
    # gmsr of one value is that value but for its eps
    near = 2e-3 if name == "gmsr" else 1e-9
    assert progress.so_far(last, at(STEPS)) == pytest.approx(expected, abs=near)
    assert progress.at_least(last, at(STEPS)) == pytest.approx(expected, abs=near)


@given(text=formulas, seed=seeds)
def test_truths_give_the_verdict(text: str, seed: int) -> None:
    spec = specification(text, BOX, steps=STEPS)
    progress = Progress(spec, Truths(spec, stl.semantics("classic")))
    traces = samples(seed)
    verdict = progress.so_far(memories(progress, traces)[-1], at(STEPS)) > 0.5
    assert np.array_equal(verdict, stl.satisfied(spec.formula, traces, spec.signals))


@given(text=formulas, seed=seeds)
def test_at_least_is_the_monitors_lower_bound_and_never_shrinks(text: str, seed: int) -> None:
    spec, _, progress = of_margins(text, "classic")
    traces, low = samples(seed), progress.ends[0]
    found = np.stack([progress.at_least(memory, at(t)) for t, memory in enumerate(memories(progress, traces))], axis=1)
    assert (np.diff(found, axis=1) >= -1e-9).all()
    for t in range(STEPS + 1):
        known = stl.robustness_bounds(spec.formula, traces[:, : t + 1], spec.signals).lower
        # the monitor knows no box: where it has nothing yet it says -inf
        assert (found[:, t] >= np.maximum(known, low) - 1e-5).all()
        assert (found[:, t][known > low] <= traces_with_worst_end(spec, traces, t)[known > low] + 1e-5).all()


def traces_with_worst_end(spec: Specification, traces: Array, t: int) -> Array:
    """The least robustness over some ways to go on: resting in a corner of the box."""
    found = []
    for corner in ((-3, -3), (-3, 3), (3, -3), (3, 3)):
        ended = traces.copy()
        ended[:, t + 1 :] = corner
        found.append(stl.robustness(spec.formula, ended, spec.signals))
    least: Array = np.min(found, axis=0)
    return least


@given(text=formulas, seed=seeds, t=st.integers(1, STEPS))
def test_a_later_start_is_as_if_its_sample_had_been_there_before(text: str, seed: int, t: int) -> None:
    _, _, progress = of_margins(text, "agm")
    still = np.repeat(samples(seed)[:, :1], STEPS + 1, axis=1)
    begun, grown = progress.begin(still[:, 0], at(t)), memories(progress, still)[t]
    assert progress.so_far(begun, at(t)) == pytest.approx(progress.so_far(grown, at(t)), abs=1e-9)
    assert progress.inputs(begun) == pytest.approx(progress.inputs(grown), abs=1e-9)


def test_so_far_by_hand() -> None:
    """F[1,2] x >= 1 & G[2,3] x <= 2, rho of F in [-4, 2] and of G in [-1, 5]; x = 0 .5 1.5 -1."""
    progress = of_margins("F[1,2] x >= 1 & G[2,3] x <= 2", "classic")[2]
    zero = np.zeros(1, dtype=np.int64)
    trace = np.array([[[0.0, 0.0], [0.5, 0.0], [1.5, 0.0], [-1.0, 0.0]]])
    found = [
        (float(progress.so_far(memory, zero + t)[0]), float(progress.at_least(memory, zero + t)[0]))
        for t, memory in enumerate(memories(progress, trace))
    ]
    # before step 1 F has its least, before step 2 G its greatest; G is not certain before step 3
    assert np.array(found) == pytest.approx(np.array([[-4, -4], [-0.5, -1], [0.5, -1], [0.5, 0.5]]), abs=1e-5)


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("F[2,5] x >= 1 & G[6,9] y <= 2", 2),
        ("F[1,4] G[2,5] x >= 0", 1 + 4),
        ("G[0,6] (F[0,3] x >= 1 & F[0,2] y >= 1)", 1 + 4 * 2),
        ("G[0,6] F[2,3] x >= 1", 1 + 2),
        ("x >= 0 U[2,4] y >= 0", 1 + 5 * 2),
    ],
)
def test_the_size_of_a_memory(text: str, size: int) -> None:
    assert of_margins(text, "classic")[2].size == size


def test_an_operator_that_looks_back_is_unsuitable() -> None:
    with pytest.raises(Unsuitable, match=r"the past operator O\[0,3\] at column 18 looks back"):
        of_margins("F[0,2] (x >= 1 | O[0,3] y >= 1)", "classic")


def test_true_has_no_bounds() -> None:
    with pytest.raises(Unsuitable, match="the robustness of True has no bounds"):
        of_margins("True U[0,3] y >= 1", "classic")
