"""The counters of the method counters, sample by sample, and other counters that could be there; compiled.

A part's memory ends with its state: DONE, FAILED, or a count. Its other numbers are 0 once it is decided.

- Reach: [1 while the guard has held,] the time left after each stage but the last, the run of the last stage.
- Answer: [the run of the answer,] the age of the oldest open request, 0 without one.
"""

import numpy as np

from stlbench.contract import Array, Integers, Truth
from stlbench_methods.counter_parts import DONE, FAILED, Tables
from stlbench_methods.updates import compiled


@compiled
def run(tables: Tables, truths: Truth, t: Integers, margin: bool, memory: Array) -> Array:
    """Memories (N, m) go on by h samples, the first at steps t (N,), in place: what is paid at each, (h, N).

    `truths` (predicates, h, N) says what holds. `margin`: the mean share of the parts is paid, not 1 when all are done.
    """
    _, held, rows = truths.shape
    parts = len(tables.chain)
    rewards = np.zeros((held, rows))
    for row in range(rows):
        own = memory[row]
        done, failed = _verdict(tables, own)
        for sample in range(held):
            if failed or (done == parts and not margin):
                break
            for i in range(parts):
                _step(tables, i, truths[:, sample, row], t[row] + sample, own)
            done, failed = _verdict(tables, own)
            if failed:
                rewards[sample, row] = -1.0
            elif margin:
                for i in range(parts):
                    rewards[sample, row] += _share(tables, i, own) / parts
            elif done == parts:
                rewards[sample, row] = 1.0
    return rewards


@compiled
def begin(tables: Tables, t: Integers, memory: Array) -> None:
    """Memories (N, m) right before steps t, with as much as possible still to be won; written in place."""
    for row in range(len(t)):
        for i in range(len(tables.chain)):
            if tables.chain[i]:
                _begin_reach(tables, i, t[row], memory[row])
            else:
                _begin_answer(tables, i, t[row], memory[row])


@compiled
def draw(tables: Tables, truths: Truth, t: Integers, chance: Array, memory: Array) -> None:
    """Write other memories (N, m) that samples at steps t can have, of each part on its own; `truths` is (needs, N)."""
    for row in range(len(t)):
        for i in range(len(tables.chain)):
            part = memory[row, tables.first[i] : tables.last[i] + 1]
            own = part.copy()
            if tables.chain[i]:
                found = _draw_reach(tables, i, truths[:, row], t[row], chance[row], memory[row])
            else:
                found = _draw_answer(tables, i, truths[:, row], t[row], chance[row], memory[row])
            if not found:
                part[:] = own


@compiled
def _verdict(tables: Tables, memory: Array) -> tuple[int, bool]:
    """The number of parts that are done, and whether one has failed."""
    done, failed = 0, False
    for i in range(len(tables.chain)):
        state = memory[tables.last[i]]
        done += state == DONE
        failed = failed or state == FAILED
    return done, failed


@compiled
def _share(tables: Tables, i: int, memory: Array) -> float:
    """A number from 0 to 1: the stages of a chain, the time left for an answer; 1 for a part that is done."""
    first, last = tables.first[i], tables.last[i]
    state = memory[last]
    if state == DONE:
        return 1.0
    if not tables.chain[i]:
        left: float = 1 - state / max(tables.most[last], 1)  # an answer at once has no time, and is in time
        return left
    first += tables.which[tables.needs[i]] >= 0
    stages = last - first + 1
    reached = state / tables.length[i]
    if state > 0:
        reached += stages - 1
    else:
        for k in range(1, stages):
            reached = k if memory[first + k - 1] > 0 else reached
    share: float = reached / stages
    return share


@compiled
def _decide(tables: Tables, i: int, verdict: int, memory: Array) -> None:
    memory[tables.first[i] : tables.last[i] + 1] = 0
    memory[tables.last[i]] = verdict


@compiled
def _step(tables: Tables, i: int, holds: Truth, at: int, memory: Array) -> None:
    """One sample at step `at`, of a part that may be decided."""
    if memory[tables.last[i]] < 0:
        return
    if tables.chain[i]:
        _step_reach(tables, i, holds, at, memory)
    else:
        _step_answer(tables, i, holds, at, memory)


@compiled
def _step_reach(tables: Tables, i: int, holds: Truth, at: int, memory: Array) -> None:
    column, last, need = tables.first[i], tables.last[i], tables.needs[i]
    guard, alive = tables.which[need], True
    if guard >= 0:
        alive = memory[column] == 1
        column += 1
    can_go_on = False
    # `is_open` goes from stage to stage: several may be reached at one sample, as F[0,w] may hold at once.
    is_open = alive and tables.start[i] <= at <= tables.end[i]
    for c in range(column, last):
        need += 1
        reached = is_open and holds[tables.which[need]]
        is_open = reached or memory[c] >= 1
        memory[c] = tables.most[c] if reached else max(memory[c] - 1, 0)
        can_go_on = can_go_on or memory[c] > 0
    in_run = holds[tables.which[need + 1]] and (memory[last] > 0 or is_open)
    memory[last] = memory[last] + 1 if in_run else 0
    if memory[last] >= tables.length[i]:
        _decide(tables, i, DONE, memory)
        return
    if guard >= 0 and not holds[guard]:  # asked after the stages: it need not hold at the sample of the first one
        memory[tables.first[i]] = 0
        alive = False
    if not (in_run or can_go_on or (alive and at < tables.end[i])):
        _decide(tables, i, FAILED, memory)


@compiled
def _step_answer(tables: Tables, i: int, holds: Truth, at: int, memory: Array) -> None:
    first, last, need = tables.first[i], tables.last[i], tables.needs[i]
    request, kept = tables.which[need], tables.which[need + 1]
    before = memory[first] if first < last else 0.0
    in_row = min(before + 1, tables.length[i]) if holds[tables.which[need + 2]] else 0.0
    if first < last:
        memory[first] = in_row
    missing, age = tables.length[i] - in_row, memory[last]
    asked = tables.start[i] <= at <= tables.end[i] and (request < 0 or holds[request])
    age = 0.0 if missing == 0 else age + 1 if age > 0 or asked else 0.0
    memory[last] = age
    if age == 0 and at >= tables.end[i]:
        _decide(tables, i, DONE, memory)
    elif (age > 0 and kept >= 0 and not holds[kept]) or not _in_time(tables, i, at, missing, age):
        _decide(tables, i, FAILED, memory)


@compiled
def _in_time(tables: Tables, i: int, at: int, missing: float, age: float) -> bool:
    """Whether an answer that lacks so many samples can come before the first deadline."""
    last = tables.last[i]
    asked = at - age + 1 if age > 0 else max(at + 1, tables.start[i])
    in_time: bool = at + max(missing, 1) <= asked + tables.most[last]  # the next sample is the first that can answer
    return in_time


@compiled
def _begin_reach(tables: Tables, i: int, t: int, memory: Array) -> None:
    """Each stage was reached as late as possible."""
    column, last = tables.first[i], tables.last[i]
    if tables.which[tables.needs[i]] >= 0:
        memory[column] = 1
        column += 1
    reached = tables.end[i]
    if t <= reached:
        return
    for c in range(column, last):
        left = tables.most[c] - (t - 1 - reached)
        if left > 0:
            memory[c] = left
            return
        reached += tables.most[c]
    memory[last] = t - reached
    if memory[last] >= tables.length[i]:
        _decide(tables, i, DONE, memory)


@compiled
def _begin_answer(tables: Tables, i: int, t: int, memory: Array) -> None:
    """The last answer came at the sample before; beyond the requests, the last of them is open."""
    first, last, length = tables.first[i], tables.last[i], tables.length[i]
    age = max(0, t - tables.end[i])
    memory[last] = age
    if first < last:
        deadline = max(tables.start[i], t - age) + tables.most[last]
        memory[first] = length if tables.start[i] < t <= tables.end[i] else max(0, length - (deadline - t + 1))
    if age > tables.most[last]:
        _decide(tables, i, DONE, memory)


@compiled
def _draw_reach(tables: Tables, i: int, holds: Truth, at: int, chance: Array, memory: Array) -> bool:
    """Counters from first to last, each evenly drawn among those that the ones before it leave.

    `latest` is the latest step at which the next stage can have been reached by now.
    """
    first, last, need = tables.first[i], tables.last[i], tables.needs[i]
    start, end, length = tables.start[i], tables.end[i], tables.length[i]
    done = 1 if _can_be_done(tables, i, holds, at) else 0
    memory[first : last + 1] = 0
    column, latest, alive = first, end, True
    is_open = start <= at <= end
    if tables.which[need] >= 0:
        column += 1
        holds_now = holds[tables.which[need]]
        other = 0 if last == column and length == 1 else 1  # dead, and yet a stage may be under way
        options = (1 if holds_now else 0) + other + done
        if options == 0:
            return False
        pick = int(chance[first] * options)
        if done and pick == options - 1:
            _decide(tables, i, DONE, memory)
            return True
        done = 0
        alive = bool(holds_now) and pick == 0
        memory[first] = 1 if alive else 0
        if not alive:
            latest = min(end, at - 1 if holds_now else at)
            is_open = is_open and not holds_now
    under_way = False
    for c in range(column, last):
        need += 1
        wait = tables.most[c]
        if is_open and holds[tables.which[need]]:
            memory[c], reached = wait, at
        else:
            low, high = max(1, at - latest), min(wait - 1, at - start)
            count = max(0, high - low + 1)
            none = 1 if under_way or c < last - 1 or length > 1 or (alive and at < end) else 0
            options = count + none + done
            if options == 0:
                return False
            pick = int(chance[c] * options)
            if done and pick == options - 1:
                _decide(tables, i, DONE, memory)
                return True
            done = 0
            if pick < count:
                memory[c], reached, is_open = wait - (low + pick), at - (low + pick), True
            else:
                reached, is_open = min(latest, at - wait - 1), False
        under_way = under_way or memory[c] > 0
        latest = reached + wait if reached >= start else start - 1
    count, low = 0, 1
    if holds[tables.which[need + 1]]:
        if length == 1 and is_open:
            _decide(tables, i, DONE, memory)
            return True
        low = max(1, at - latest + 1)
        count = max(0, min(length - 1, at - start + 1) - low + 1)
    may_wait = under_way or (alive and at < end)
    none = 1 if may_wait and not (is_open and holds[tables.which[need + 1]]) else 0
    options = count + none + done
    if options == 0:
        return False
    pick = int(chance[last] * options)
    if done and pick == options - 1:
        _decide(tables, i, DONE, memory)
    else:
        memory[last] = low + pick if pick < count else 0
    return True


@compiled
def _can_be_done(tables: Tables, i: int, holds: Truth, at: int) -> bool:
    """Whether a past of a chain may have completed it, now or before."""
    before = at - tables.length[i] - tables.start[i]
    if before >= 0:
        return True
    stages = tables.last[i] - tables.first[i] + 1 - (tables.which[tables.needs[i]] >= 0)
    all_now = before == -1  # completed at the first sample at which it can be
    for k in range(1 if tables.length[i] == 1 else stages, stages + 1):
        all_now = all_now and holds[tables.which[tables.needs[i] + k]]
    possible: bool = all_now
    return possible


@compiled
def _draw_answer(tables: Tables, i: int, holds: Truth, at: int, chance: Array, memory: Array) -> bool:
    """Each pair of a run and an age is as likely."""
    first, last = tables.first[i], tables.last[i]
    length, answered = tables.length[i], holds[tables.which[tables.needs[i] + 2]]
    least, most = (1, min(length, at + 1)) if answered else (0, 0)
    total = 0
    for in_row in range(least, most + 1):
        none, low, high = _ages(tables, i, holds, at, in_row)
        total += none + max(0, high - low + 1)
    request = tables.which[tables.needs[i]]
    nothing_open = most == length or (request >= 0 and not holds[request])
    done = 1 if at > tables.end[i] or (at == tables.end[i] and nothing_open) else 0
    if total + done == 0:
        return False
    pick = int(chance[last] * (total + done))
    memory[first : last + 1] = 0
    if pick == total:
        memory[last] = DONE
        return True
    for in_row in range(least, most + 1):
        none, low, high = _ages(tables, i, holds, at, in_row)
        count = none + max(0, high - low + 1)
        if pick < count:
            if first < last:
                memory[first] = in_row
            memory[last] = 0 if pick < none else low + pick - none
            break
        pick -= count
    return True


@compiled
def _ages(tables: Tables, i: int, holds: Truth, at: int, in_row: int) -> tuple[int, int, int]:
    """For runs of so many samples: 1 if no request may be open, and the least and greatest age of the oldest."""
    last, need = tables.last[i], tables.needs[i]
    start, end, missing, wait = tables.start[i], tables.end[i], tables.length[i] - in_row, tables.most[last]
    request, kept = tables.which[need], tables.which[need + 1]
    if missing == 0 or at < start:
        return (1 if at < end and _in_time(tables, i, at, missing, 0) else 0), 1, 0
    asked = at <= end and (request < 0 or holds[request])
    low, high = 1 if asked else 2, min(at - start + 1, wait + 1 - missing)
    if in_row > 0:  # an answer came before this run, or never
        low = min(in_row + 1, at - start + 1)
    if kept >= 0 and not holds[kept]:
        high = 0
    return (0 if asked or at >= end else 1), max(low, at - end + 1), high
