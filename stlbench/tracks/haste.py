"""Whether the windows of a formula leave time for the ways between its goals, beside what held actions reach.

A robot whose actions are held at random moves in no direction that anybody chose. A way that none of many such robots
goes in so few steps may still be possible. So this warns and refuses nothing.
"""

from itertools import pairwise
from math import inf

import numpy as np

from stlbench.contract import ActionGrid, Array, Integers
from stlbench.simulation.baselines import held_at_random, in_pieces, replay
from stlbench.stl import Formula, FragmentError, Term, fragment
from stlbench.task import Task
from stlbench.task.forms import normal_form
from stlbench.tracks.auto import regions, scheduled

_COPIES, _PIECES = 32, 20
"""Episodes that are looked at, and the most different actions in one."""


def too_fast(task: Task) -> str | None:
    """The two goals that follow each other too fast, their windows, and the steps that are missing.

    The goals are those of the schedule, or of the formula if it is one itself. The answer is None if there is neither,
    or if all goals have time.
    """
    schedule = scheduled(task)
    try:
        terms = fragment(normal_form(task.file.formula) if schedule is None else schedule)
    except FragmentError:
        return None
    known = regions(task)
    goals = sorted((term for term in terms if term.kind != "G"), key=lambda term: term.end)
    ways = [  # goals in turn alone: if the windows overlap, the second may be visited first
        (first, second)
        for first, second in pairwise([None, *goals])
        if second is not None and (first is None or first.end <= second.start + first.length)
    ]
    far = [(first, second) for first, second in ways if known.distance(_psi(first), second.psi) > 0]
    if not far:
        return None
    actions = _held(task)
    held = actions[:, in_pieces(task.file.decisions, actions.shape[1])]
    begun = task.starts.report_and_selection()[0]
    traces = replay(task, held, begun[np.arange(_COPIES) % len(begun)]).traces
    missing = dict[tuple[Term | None, Term], float]()
    for first, second in far:
        given = _last(second) - (0 if first is None else first.start + first.length - 1)
        needed = known.steps(_psi(first), second.psi, traces)
        missing[first, second] = (inf if needed is None else needed) - given
    first, second = max(missing, key=lambda way: missing[way])
    if missing[first, second] <= 0:
        return None
    return _told(first, second, missing[first, second])


def _held(task: Task) -> Integers | Array:
    """Actions (copies, pieces, ...). Half of the copies have them at the ends of their ranges, as these go fastest."""
    pieces = min(_PIECES, task.file.decisions)
    found = held_at_random(task.actions, np.random.default_rng(0), _COPIES, pieces)
    if not isinstance(task.actions, ActionGrid):
        low, high = np.array(task.actions.low), np.array(task.actions.high)
        found[_COPIES // 2 :] = np.where(found[_COPIES // 2 :] < (low + high) / 2, low, high)
    return found


def _psi(term: Term | None) -> Formula | None:
    return None if term is None else term.psi


def _last(term: Term) -> int:
    """The last step at which what is asked for may begin."""
    return term.end - term.length + 1


def _told(first: Term | None, second: Term, missing: float) -> str:
    origin = "the start" if first is None else f"'{first.psi}' in {first.start}..{first.end}"
    lacking = "longer than an episode" if missing == inf else f"{missing} steps more"
    return (
        f"perhaps too fast: from {origin} to '{second.psi}' in {second.start}..{second.end}; "
        f"with actions held at random such a way takes {lacking}"
    )
