"""The policies that come with stlbench, and how one is taken out of a folder of results.

They are a folder of results like any other: `cells.jsonl` and `policies/`, of which each file has the selected policy
alone. `studies/zoo.py` writes it.
"""

from pathlib import Path

from stlbench.errors import UsageError
from stlbench.records.array_files import read_policy
from stlbench.records.lines import write_lines
from stlbench.records.result import Result
from stlbench.records.result_files import LINES, cell_files, is_there, write
from stlbench.records.result_files import read as read_file
from stlbench.study.results import Results

ZOO = Path(__file__).parent / "zoo"


def with_policies(folder: Path) -> Results:
    """The results of a folder whose policies are there. Raises `UsageError` as `Results.load`."""
    results = Results.load(folder)
    folder = results.folder
    there = (each for each in results if is_there(cell_files(folder, each.id, each.key).policies, folder))
    return Results.of(there, folder)


def take(folder: Path, result: Result, target: Path) -> list[Path]:
    """Write the policy of a cell as a folder of results of its own, with its record; the files.

    All commands that take `--results` read the folder. Raises `UsageError` if something is there already, which would
    be written over, or the policy is missing or not as it was recorded.
    """
    if target.exists():
        raise UsageError(f"{target} is there already; name a new folder")
    read_policy(folder, result, "selected")
    content = read_file(cell_files(folder, result.id, result.key).policies, folder)
    record = target / LINES
    write_lines([result], record)
    return [record, write(cell_files(target, result.id, result.key).policies, content, target)]
