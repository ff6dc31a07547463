"""Give committed results the keys of today's code, where a new training of the same settings has the same bits.

    stlbench run --tasks reach-stay,annulus --methods funnel,raw --seeds 1 --results build/proof
    python studies/rekey.py results/reference --proof build/proof

A part is stlbench itself, a task, a method or an agent. A part is proven if the proof has a cell with it, and all of
these cells have the scores of the committed ones, bit for bit. A result gets a new key if its task, its method and its
agent are proven. All other results keep their old keys, so `stlbench run` trains them anew. The script names the parts
that are not proven.

Only a change of the code makes this necessary, for example a key that is computed in another way. It says nothing about
other processors: a training may differ there in its last bits.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

from stlbench.records.identity import CellId
from stlbench.records.result import Result
from stlbench.records.stored import LINES, read
from stlbench.study.plan import plan_cells
from stlbench.study.tracks import Recipes, read_recipes

TUNED = Path(__file__).parents[1] / "results" / "tuning" / "recipes.yaml"


def parts(cell: CellId) -> tuple[str, str, str]:
    """Task, method and agent of a cell, without their parameters."""
    return f"task {cell.task.name}", f"method {cell.method.name}", f"agent {cell.agent.name}"


def proven(old: Mapping[CellId, Result], proofs: Iterable[Path]) -> dict[str, bool]:
    """For each part with a cell in a proof: whether all its cells there have the bits of the committed results."""
    equal = dict[str, bool]()
    for new in (result for proof in proofs for result in read(proof)):
        if new.id in old and new.measurement is not None:
            same = scores(new) == scores(old[new.id])
            print(f"{'equal' if same else 'DIFFERENT'}: {new.id.name}")
            equal |= {part: equal.get(part, True) and same for part in parts(new.id)}
    return equal


def scores(result: Result) -> object:
    """What the selected and the final policy got from each start."""
    return result.measurement and (result.measurement.selected, result.measurement.final)


def key_of(result: Result, recipes: Recipes) -> str:
    """Today's key of the cell of a result."""
    cell = result.id
    tuned = recipes if cell.track == "tuned" else None
    (planned,) = plan_cells([cell.task], [cell.method], [cell.agent], [cell.seed], cell.budget, cell.track, tuned)
    return planned.key


def main() -> None:
    """Rewrite `cells.jsonl` of a folder; each line keeps all but its key."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="committed results, with a cells.jsonl")
    parser.add_argument("--proof", type=Path, action="append", required=True, help="results of today's code; repeat it")
    chosen = parser.parse_args()
    old = {result.id: result for result in read(chosen.folder)}
    equal, recipes = proven(old, chosen.proof), read_recipes(TUNED)
    keys = {result.key: key_of(result, recipes) for result in old.values() if all(map(equal.get, parts(result.id)))}
    file = chosen.folder / LINES
    text = "".join(rekeyed(line, keys) for line in file.read_text(encoding="utf-8").splitlines(keepends=True))
    file.write_text(text, encoding="utf-8")
    lacking = Counter(part for cell in old for part in parts(cell) if not equal.get(part))
    for part, cells in lacking.items():
        print(f"not proven: {part}, in {cells} results")
    print(f"{len(keys)} of {len(old)} results have the key of today's code")


def rekeyed(line: str, keys: Mapping[str, str]) -> str:
    """A line of `cells.jsonl` with the new key in place of the old one."""
    key = json.loads(line)["key"]
    return line.replace(f'"key": "{key}"', f'"key": "{keys.get(key, key)}"', 1)


if __name__ == "__main__":
    main()
