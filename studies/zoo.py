"""Write the policies that come with stlbench: seed 0 of the reference's twelve tasks.

    stlbench run studies/zoo.yaml
    python studies/zoo.py results/zoo

Only selected policies are taken along, since two would be twice as large.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from stlbench.records import array_files
from stlbench.records.array_files import read_policy
from stlbench.records.lines import write_lines
from stlbench.records.result_files import LINES, cell_files
from stlbench.share.zoo import ZOO, with_policies


def main(folder: Path) -> None:
    found = with_policies(folder)
    shutil.rmtree(ZOO, ignore_errors=True)
    write_lines(found, ZOO / LINES)
    for result in found:
        arrays = read_policy(found.folder, result, "selected")
        named = {f"selected/{name}": array for name, array in arrays.items()}
        array_files.write_arrays(cell_files(ZOO, result.id, result.key).policies, named)
    size = sum(path.stat().st_size for path in ZOO.rglob("*") if path.is_file())
    print(f"{ZOO}: policies of {len(found)} cells, {size / 1e6:.2f} MB")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
