"""A small matrix of trainings, rewards and moves whose bits are pinned, so that a changed bit is seen.

A row depends on some parts of the distribution: the harness, the formula's view, an agent, a method, a task, a suite.
The file of pins has the digest of all bits of each row, and the revision of each part. A process of its own computes
the rows with `BASELINE`, in which libraries use no instruction that some processor of the architecture lacks. So the
digests are the same on every processor, but for agents of Stable-Baselines3: PyTorch computes what it computes, and
their rows count on the processor of the pins alone.

`python tests/helpers/pinned_bits.py --write` pins the matrix. It refuses where bits of a row have changed while the
revisions of its parts have not.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterable, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

import llvmlite.binding

sys.path.insert(0, str(Path(__file__).parents[1]))  # for a run as a program
from helpers.pinned_rows import rows
from stlbench.registry import plugins
from stlbench.study import cell
from stlbench.task.view import FormulaView

PINS = Path(__file__).parents[1] / "study" / "pinned_bits.json"

BASELINE = {
    "ATEN_CPU_CAPABILITY": "default",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX512F",
    "MKL_CBWR": "COMPATIBLE",
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
    "NUMBA_CPU_FEATURES": "+sse4.2",
    "NUMBA_CPU_NAME": "x86-64-v2",
    "OMP_NUM_THREADS": "1",
    "ONEDNN_MAX_CPU_ISA": "SSE41",
    "OPENBLAS_CORETYPE": "Nehalem",
}
"""Environment variables by which libraries leave out what only some processors have."""
PACKAGES = (
    *("box2d", "dm_control", "gymnasium", "gymnasium-robotics", "highway-env", "llvmlite", "mujoco", "numba", "numpy"),
    *("scipy", "stable-baselines3", "torch"),
)
"""Those whose versions can change bits. They stand in keys, as far as a cell uses them."""


def parts() -> dict[str, int]:
    """The parts of this distribution, and their revisions."""
    kinds = ("agents", "methods", "suites", "tasks")
    known = {f"{kind}.{name}": plugin for kind in kinds for name, plugin in plugins.available(kind).items()}
    own = {name: plugin.revision for name, plugin in known.items() if plugin.distribution == plugins.OWN}
    return {"harness": cell.HARNESS, "view": FormulaView.revision, **own}


def suspects(changed: Iterable[str]) -> list[str]:
    """The parts that explain which rows have changed bits.

    Of all choices the one whose rows are most nearly the changed ones (by Ochiai's coefficient) is to blame first; then
    the same for the changed rows that are left.
    """
    chosen: dict[tuple[str, str], set[str]] = {}
    for row in rows():
        for choice in row.choices:
            chosen.setdefault(choice, set()).add(row.name)
    left, blamed = {*changed}, set[str]()
    while left:
        of_choice = {choice: len(left & names) / (len(left) * len(names)) ** 0.5 for choice, names in chosen.items()}
        choice = max(of_choice, key=lambda each: of_choice[each])
        blamed.add(choice[0])
        left -= chosen[choice]
    return sorted(blamed)


# -------------------------------------------------------------------------------------------------------------- pinning


def here() -> dict[str, str]:
    """What bits may depend on beside the code: the kind of machine, Python and packages."""
    kind = f"{platform.system()} {platform.machine()} {' '.join(platform.libc_ver())}"
    python = ".".join(platform.python_version_tuple()[:2])
    return {"machine": kind, "python": python, **{name: _version(name) for name in PACKAGES}}


def processor() -> str:
    """The name that LLVM has for it."""
    return str(llvmlite.binding.get_host_cpu_name())


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "not installed"


def computed(environment: Mapping[str, str] = BASELINE, program: Path = Path(__file__)) -> dict[str, str]:
    """Row -> digest, by a process of its own. Raises `CalledProcessError`."""
    paths = os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    ended = subprocess.run(
        [sys.executable, "-W", "ignore", str(program), "--compute"],
        env={**os.environ, "PYTHONPATH": paths, **environment},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return dict(json.loads(ended.stdout.splitlines()[-1]))


def read_pins() -> dict[str, Any]:
    """The file of pins: what `here` said, the revision of each part, and the digest of each row."""
    return dict(json.loads(PINS.read_text(encoding="utf-8")))


def problem(
    digests: Mapping[str, str], pins: Mapping[str, Any], numbers: Mapping[str, int], on: str | None = None
) -> str | None:
    """In a line, what is wrong with the pins of rows; None where they hold. `on` is the processor, if not this one."""
    same = pins["processor"] == (processor() if on is None else on)
    raised = {part for part, number in numbers.items() if pins["revisions"].get(part) != number}
    old = [row.name for row in rows() if row.name in pins["rows"] and not raised.intersection(row.parts)]
    changed = [name for name in old if pins["rows"][name] != digests[name] and (same or " sb3-" not in name)]
    if changed:
        found = suspects(changed)
        part = " or ".join(f"{name} from {numbers[name]} to {numbers[name] + 1}" for name in found)
        return (
            f"bits have changed in {len(changed)} of {len(old)} rows, such as '{changed[0]}': if that is meant, raise "
            f"the revision of {part} where its code stands, list the change in CHANGELOG.md under Results, and run "
            "`python tests/helpers/pinned_bits.py --write`"
        )
    if {*digests} - {*old} or {*pins["rows"]} - {*digests}:
        return "rows are new, or of other revisions: run `python tests/helpers/pinned_bits.py --write`"
    return None


def write() -> str | None:
    """Pin the matrix; or the problem where bits have changed without a new revision, and nothing is written."""
    digests, numbers = computed(), parts()
    if PINS.exists() and "bits have changed" in (said := problem(digests, read_pins(), numbers) or ""):
        return said
    content = {**here(), "processor": processor(), "revisions": numbers, "rows": digests}
    PINS.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return None


if __name__ == "__main__":
    if sys.argv[1:] == ["--compute"]:
        print(json.dumps({row.name: row.digest for row in rows()}))
    elif sys.argv[1:] == ["--write"]:
        sys.exit(write())
    else:
        sys.exit("usage: python tests/helpers/pinned_bits.py --write")
