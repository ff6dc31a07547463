"""Is a new snapshot worse than its base? One rule, on paired seeds.

Each seed gives one *gain* of robustness and satisfaction, positive where the new snapshot is better. The gains of
a setting (one task, method, agent, budget and track) decide:

- **worse**: the mean loss is more than the tolerated one, and a t-test says that it is a loss.
- **no worse**: the mean loss is at most the tolerated one, and its interval excludes twice as much; or all gains are 0,
  as with equal code.
- **cannot tell**: anything else.

Costs of two snapshots are *not judged*: the machine was busy otherwise at another hour. `turns` judges those by turns.
"""

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy import special

from stlbench.gate.snapshot import COSTS, QUALITIES, Floats, Metric, Sample, Snapshot
from stlbench.records.identity import CellId, Setting
from stlbench.records.result import ACCIDENTS
from stlbench.statistics.differences import holm

Verdict = Literal["no worse", "worse", "cannot tell", "missing", "not judged"]
EXIT: dict[Verdict, int] = {"no worse": 0, "not judged": 0, "worse": 1, "cannot tell": 3, "missing": 4}
"""Exit code of each verdict."""
WORST_FIRST: tuple[Verdict, ...] = ("worse", "missing", "cannot tell")
"""The verdicts that are not fine. The whole has the first that is found."""
ALPHA = 0.01  # probability that anything is called worse by chance (Holm's correction)
LEVEL = 0.95
"""Confidence that the loss is less than the interval's end. It needs no correction: all must exclude, not one."""
FREEDOM = 2  # the fewest degrees of freedom from which anything is said: three seeds


@dataclass(frozen=True)
class Comparison:
    """One metric of one setting. `gain`, `low` and `high` are in the unit of the metric's gain."""

    setting: Setting
    metric: Metric
    base: float  # mean over the pairs; of a cost the median, as of the two below
    new: float
    pairs: int  # seeds that both have, or turns in which both trained a seed
    gain: float
    low: float
    """One-sided 95 % limit of the gain, from below; of a cost the lower end of its 95 % interval. NaN: not judged."""
    high: float  # the same from above
    chance: float
    """Holm-corrected p-value of the t-test that nothing is lost; of a cost, of the sign test that no more is lost than
    is tolerated."""
    verdict: Verdict
    gains: tuple[float, ...] = ()  # of a cost that is judged: turn by turn

    @property
    def differs(self) -> bool:
        return not self.gain == self.low == self.high == 0


@dataclass(frozen=True)
class Finding:
    """A cell of the base without a measurement to compare."""

    cell: CellId
    verdict: Verdict
    reason: str


@dataclass(frozen=True)
class Judgement:
    comparisons: tuple[Comparison, ...]
    findings: tuple[Finding, ...]

    @property
    def verdict(self) -> Verdict:
        """The verdict on the whole; see `WORST_FIRST`. Nothing compared is `missing`."""
        verdicts = {comparison.verdict for comparison in self.comparisons}
        verdicts |= {finding.verdict for finding in self.findings}
        worst: Verdict = next((verdict for verdict in WORST_FIRST if verdict in verdicts), "no worse")
        return "missing" if worst == "no worse" and not self.comparisons else worst


def judge(base_snapshot: Snapshot, new_snapshot: Snapshot) -> Judgement:
    """Compare every cell of the base with the same cell of the new snapshot, which may have further cells."""
    pairs = [(base_snapshot.samples[cell], new_snapshot.samples.get(cell)) for cell in sorted(base_snapshot.samples)]
    findings = tuple(finding for base, new in pairs for finding in _accidents(base, new))
    done = defaultdict[Setting, list[tuple[Sample, Sample]]](list)
    for base, new in pairs:
        if new is not None and base.status == new.status == "done":
            done[base.id.setting].append((base, new))
    qualities, costs = (
        [each for metric in metrics for setting, pairs in done.items() if (each := compare(setting, metric, pairs))]
        for metrics in (QUALITIES, COSTS)
    )
    return Judgement((*_judged(qualities), *costs), findings)


def _accidents(base: Sample, new: Sample | None) -> list[Finding]:
    """The verdict on a pair without two measurements. A method that does not fit is no accident."""
    if new is None:
        return [Finding(base.id, "missing", f"there is no result of it, and the base says {base.status}")]
    if new.status != base.status and new.status != "done" and (base.status == "done" or new.status in ACCIDENTS):
        return [Finding(base.id, "worse", f"{new.status}, the base says {base.status}: {new.reason}")]
    if new.status == base.status and new.status in ACCIDENTS:
        return [Finding(base.id, "missing", f"{new.status}, as in the base: {new.reason}")]
    return []


def values_of(metric: Metric, pairs: Iterable[tuple[Sample | None, Sample | None]]) -> Floats:
    """(n, 2): of base and new, where both have the number, and the base's is finite; of a cost, above 0."""
    values = [(metric.value(base), metric.value(new)) for base, new in pairs if base and new]
    known = [(base, new) for base, new in values if base is not None and new is not None and math.isfinite(base)]
    return np.array([each for each in known if all(each) or not metric.is_cost], dtype=np.float64).reshape(-1, 2)


def compare(
    setting: Setting, metric: Metric, members: Sequence[tuple[Sample | None, Sample | None]]
) -> Comparison | None:
    """The comparison on the members of which both have a number; None without any. The verdict is still to be given."""
    values = values_of(metric, members)
    if not len(values):
        return None
    with np.errstate(invalid="ignore"):  # a robustness that is no number any more is an infinite loss
        gains = np.nan_to_num(metric.gain(*values.T), nan=-np.inf, posinf=0.0, neginf=-np.inf)
    centre = np.median if metric.is_cost else np.mean
    base, new, gain = float(centre(values[:, 0])), float(centre(values[:, 1])), float(centre(gains))
    estimate = (math.nan,) * 3 if metric.is_cost else _estimate(gains, gain)
    return Comparison(setting, metric, base, new, len(gains), gain, *estimate, "not judged")


def _estimate(gains: Floats, gain: float) -> tuple[float, float, float]:
    """Limits of the gain from below and above, and the p-value of `Comparison.chance` before its correction."""
    freedom = len(gains) - 1
    if not gains.any() or not math.isfinite(gain):
        return gain, gain, float(gain >= 0)
    if freedom < FREEDOM:
        return -math.inf, math.inf, 1.0
    error = float(gains.std(ddof=1)) / math.sqrt(len(gains))
    half = error * float(special.stdtrit(freedom, LEVEL))
    chance = float(special.stdtr(freedom, gain / error)) if error > 0 else float(gain >= 0)
    return gain - half, gain + half, chance


def _judged(family: Sequence[Comparison]) -> Iterator[Comparison]:
    """Holm's correction counts the comparisons in which anything differs."""
    chances = iter(holm([each.chance for each in family if each.differs]))
    for each in family:
        chance = next(chances) if each.differs else 1.0
        yield replace(each, chance=chance, verdict=_verdict(each, chance))


def _verdict(of: Comparison, chance: float) -> Verdict:
    if of.gain < -of.metric.tolerated:
        return "worse" if chance < ALPHA else "cannot tell"
    return "no worse" if of.low >= -2 * of.metric.tolerated else "cannot tell"
