"""Rules of the harness on fixed formulas and random numbers: what their bits depend on is no agent and no task."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from stlbench import stl
from stlbench.contract import Specification, Unsuitable
from stlbench.registry import choices, plugins
from stlbench.simulation.referee import race
from stlbench.simulation.verdicts import EarlyEnds, judge, without_end
from stlbench.study.trial import Patience
from stlbench.task.file import EarlyEnd
from stlbench.task.view import FormulaView

STEPS = 30
FORMULAS = (
    "G[8,30] (abs(x - 1) <= 0.6) & F[2,20] (abs(y + 1) <= 0.5)",
    "G[0,20] F[0,10] (x >= 0.5 | y >= 1)",
    "F[0,20] G[0,6] (norm(x, y) <= 1.2)",
    "F[0,30] (x >= 1 & F[0,0] y <= 0.5) & G[0,30] (y >= -3)",
    "G[0,28] (x <= 2.5 & y >= -2.5)",
)
_VIEWED = (*FORMULAS, "G[0,20] (x >= 1 -> F[0,9] norm(x, y - 1) <= 0.5) & F[3,9] y >= 0 & F[9,12] y >= 1")


def viewed() -> Iterator[bytes]:
    """What policies see of some formulas."""
    generator = np.random.default_rng(17)
    state, signals = generator.uniform(-1, 1, (40, 3)), generator.uniform(-4, 4, (40, 2))
    t, ranges = generator.integers(0, STEPS + 1, 40), {"x": (-4.0, 4.0), "y": (-4.0, 4.0)}
    for formula in _VIEWED:
        yield FormulaView(stl.parse(formula), ranges, STEPS)(state, signals, t).tobytes()


def selected() -> Iterator[bytes]:
    """Races of checkpoints that are close, from several numbers of starts, and when patience ends."""
    generator = np.random.default_rng(19)
    for starts in (5, 8, 24, 64, 200):
        for share in (0.0, 0.5, 0.95, 1.0):
            robustness = generator.normal(generator.normal(1, 0.3, (12, 1)), 0.3, (12, starts))
            satisfied = generator.random((12, starts)) < share
            chosen = race(lambda rows, part, s=satisfied, r=robustness: (s[rows, part], r[rows, part]), 12, starts)
            yield from (np.asarray(each).tobytes() for each in chosen)
    for checkpoints in (1, 2, 4):
        patience, scores = Patience(checkpoints), np.cumprod(1 + generator.uniform(-0.03, 0.08, 60))
        yield bytes(
            patience.ends(float(share), score) for share, score in zip(np.tile([1, 1, 0.9], 20), scores, strict=True)
        )


def judged() -> Iterator[bytes]:
    """Verdicts on traces that end early, by what an early end means; what is paid for the steps that are left."""
    generator = np.random.default_rng(23)
    walks = np.clip(np.cumsum(generator.normal(0, 0.5, (40, STEPS + 1, 2)), axis=1), -3.9, 3.9)
    without_end(walks, generator.integers(0, STEPS + 1, 40))
    for text in (*FORMULAS, "G[0,28] x >= -9"):  # the last holds wherever it goes
        formula = stl.parse(text)
        given = Specification(formula, ("x", "y"), (-4.0, -4.0), (4.0, 4.0), STEPS, 1.0, can_end=True)
        for terminated in ("hold", "violated", "interval"):
            known = np.nan_to_num(walks) if terminated == "hold" else walks
            yield from (each.tobytes() for each in judge(formula, known, given, terminated))
            yield from _left(given, terminated)


def _left(given: Specification, terminated: EarlyEnd) -> Iterator[bytes]:
    for name in ("raw", "flag", "hprs[violation=ends]"):
        try:
            method = plugins.build("methods", choices.parse_choice(name), given)
        except Unsuitable:
            continue
        ends, start, now = EarlyEnds(method, terminated), np.array([[0.5, -1.0]]), np.array([False, True, True])
        for t in (1, 7, STEPS - 1, STEPS):
            memory = method.initial_memory(start, np.array([t]))
            yield from (
                np.float64(ends.sum_left(start, np.zeros((1, 1)), t, memory, each)).tobytes() for each in (1, 0.9)
            )
            yield ends.standing_still(np.ones(3), ~now, now, np.full(3, t), 2).tobytes()
