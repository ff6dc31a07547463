"""The figures that `make bench` measured: results/bench.json, the tables of docs/performance-tables.md, a chart.

    python tests/benchmarks/collect.py                               write the page from results/bench.json
    python tests/benchmarks/collect.py BENCHMARK_JSON [--merge]      take in a new measurement first

BENCHMARK_JSON is what `pytest --benchmark-json` wrote. Each benchmark put its figures into `extra_info`: a number, a
list of samples, or a text, the reason why there is no number. With `--merge`, figures that were not measured this time
stay as they are in results/bench.json.
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

CHART = Path("figures/reward-cost")
METHODS = ("funnel", "flag", "tau_mdp", "raw")
PEERS = ("jax", "optax", "sbx-rl", "stable-baselines3", "torch", "sentil", "mstlo-python", "tidystl", "rtamt", "stlrom")
RACED = ("pendulum", "cartpole", "mountain-car", "reach-stay", "patrol", "hopper")
RACED += ("cartpole-chain", "pendulum-chain", "mountain-car-chain")
FORMULAS = {"three-term conjunction": "conjunction", "F G": "nested", "timed until": "until"}

Figure = float | str | None
"""A median, or the reason why there is no number."""


class Table(NamedTuple):
    """A table of the page. The key of an entry is the column's pattern with the row's name put in."""

    title: str
    rows: Mapping[str, str]
    """Label -> name."""
    columns: Mapping[str, tuple[str, str]]
    """Label -> pattern of the key, form of the number."""


def _times(peers: Iterable[tuple[str, str]], form: str = "{:.1f}") -> dict[str, tuple[str, str]]:
    return {f"times {label}": (f"{{}}_vs_{peer}", form) for label, peer in peers}


MONITORS = (("rtamt", "rtamt"), ("stlrom", "stlrom"), ("tidystl", "tidystl"), ("mstlo", "mstlo"))
TABLES = (
    Table(
        "Training: environment steps a second, and times the steps of a peer",
        {"61 actions": "train_61", "273 actions": "train_273", "any torque": "td3"},
        {
            "steps/s": ("{}_steps_per_second_ours", "{:,.0f}"),
            **_times((("SB3", "sb3"), ("SBX", "sbx"), ("torch loop", "torch"))),
            "one copy, times SB3": ("{}_single_vs_sb3", "{:.1f}"),
        },
    ),
    Table(
        "Training beside the JAX program",
        {
            **{"61 actions, 16 copies": "dqn_16", "61 actions, one copy": "dqn_1"},
            **{"any torque, 8 copies": "td3_8", "any torque, one copy": "td3_1"},
        },
        _times([("JAX", "jax")], "{:.2f}"),
    ),
    Table(
        "CPU seconds of training until 95 % of the selection starts are satisfied",
        {name.replace("_", "-"): f"time_to_95_{name}" for name in ("hold_disc", "integrator_or", "robot_nav")},
        {
            "`dqn`": ("{}_dqn_seconds", "{:.2g}"),
            "SB3, its recipe, times `dqn`": ("{}_vs_sb3", "{:.1f}"),
            "SB3, one environment, times `dqn`": ("{}_vs_sb3_single", "{:.1f}"),
        },
    ),
    Table(
        "CPU seconds until 95 % of fresh starts are satisfied; rewards of SB3 from rtamt",
        {name: f"solve_race_{name.replace('-', '_')}" for name in RACED},
        {
            "`stlbench solve`": ("{}_solve", "{:.0f}"),
            **{f"SB3 {peer}": (f"{{}}_{peer}", "{:.0f}") for peer in ("PPO", "SAC", "TD3", "DQN")},
            "fastest of SB3, times `solve`": ("{}_times", "{:.1f}"),
        },
    ),
    Table(
        "Robustness of recorded traces: traces a second, and times a peer with one trace",
        {
            f"{words}, {where}": f"monitor_{formula}{kind}"
            for words, formula in FORMULAS.items()
            for kind, where in (("", "every sample"), ("_t0", "first value"))
        },
        {
            **{f"batch of {batch}": (f"{{}}_{batch}_traces_per_second", "{:,.0f}") for batch in (1, 1024)},
            **_times((*MONITORS, ("sentil", "sentil")), "{:,.0f}"),
        },
    ),
    Table(
        "Online monitors: microseconds a step",
        {words: f"online_{formula}" for words, formula in FORMULAS.items()},
        {
            "a step": ("{}_microseconds", "{:.2f}"),
            **_times(MONITORS, "{:,.0f}"),
            **_times([("sentil", "sentil")], "{:.2f}"),
            "one of 1024 together, ns": ("{}_1024_nanoseconds", "{:.0f}"),
        },
    ),
    Table(
        "The harness",
        {"": ""},
        {
            "plan 10,000 cells": ("plan_10000_seconds", "{:.2f} s"),
            "report": ("report_10000_seconds", "{:.1f} s"),
            "CPU of a run beside training": ("harness_run_seconds", "{:.2f} s"),
            "of each cell": ("harness_cell_seconds", "{:.2f} s"),
            "share of 20 cells of two minutes": ("harness_overhead_share", "{:.1%}"),
            "two workers, times one": ("two_workers_speedup", "{:.2f}"),
        },
    ),
)


def read(path: Path) -> dict[str, Figure]:
    """Key -> median of what the benchmarks noted, or the reason why there is none; and the machine in words."""
    content = json.loads(path.read_text(encoding="utf-8"))
    noted: dict[str, Any] = {}
    for entry in content["benchmarks"]:
        twice = noted.keys() & entry["extra_info"].keys()
        if twice:
            raise SystemExit(f"{path}: {entry['name']} notes {', '.join(sorted(twice))}, which another has noted")
        noted |= entry["extra_info"]
    machine = content["machine_info"]
    words = f"{machine['cpu'].get('brand_raw', machine['processor'])}, {machine['cpu'].get('count', '?')} cores"
    words += f", Python {machine['python_version']}, {content['datetime'][:10]}. Peers: {versions(PEERS)}."
    return {"machine": words, **{key: middle(value) for key, value in sorted(noted.items())}}


def versions(names: Iterable[str]) -> str:
    """Those of the distributions that are installed here, with their versions."""
    found = []
    for name in names:
        with suppress(PackageNotFoundError):
            found.append(f"{name} {version(name)}")
    return ", ".join(found)


def middle(value: Any) -> Figure:
    """The median of what was noted; a text stays."""
    if value is None or isinstance(value, str) or value == []:
        return value or None
    return float(median(value) if isinstance(value, list) else value)


def markdown(figures: Mapping[str, Figure]) -> str:
    """All tables that have a figure."""
    parts = [str(figures.get("machine", "")), *(_table(each, figures) for each in TABLES)]
    return "\n\n".join(part for part in parts if part)


def _table(table: Table, figures: Mapping[str, Figure]) -> str:
    """Without the columns that have no figure; empty where there is none at all."""
    found = {
        label: [_shown(figures.get(pattern.format(name)), form) for name in table.rows.values()]
        for label, (pattern, form) in table.columns.items()
    }
    found = {label: column for label, column in found.items() if any(column)}
    lines = [[label, *(column[place] for column in found.values())] for place, label in enumerate(table.rows)]
    return _grid(table.title, ["", *found], [line for line in lines if any(line[1:])]) if found else ""


def _shown(figure: Figure, form: str) -> str:
    return form.format(figure) if isinstance(figure, float) else figure or ""


def _grid(title: str, header: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    shown, *others = (f"| {' | '.join(row)} |" for row in (header, *lines))
    return f"**{title}**\n\n" + "\n".join((shown, "|---" + "|--:" * (len(header) - 1) + "|", *others))


def horizons(figures: Mapping[str, Figure]) -> list[int]:
    """Horizons at which the methods' cost was measured."""
    found = (re.fullmatch(r"reward_raw_(\d+)_nanoseconds", key) for key in figures)
    return sorted(int(match[1]) for match in found if match)


def draw(figures: Mapping[str, Figure], path: Path) -> None:
    """Time a transition and inputs added, against the horizon; both axes logarithmic. Writes .svg and .png."""
    import matplotlib as mpl

    mpl.use("Agg")
    mpl.rcParams |= {"svg.hashsalt": "stlbench", "font.size": 9}
    from matplotlib import pyplot as plt

    steps = horizons(figures)
    figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.2), layout="constrained")
    for method, marker in zip(METHODS, "osD^", strict=True):
        costs = ("nanoseconds", "inputs")
        times, inputs = ([figures[f"reward_{method}_{step}_{what}"] for step in steps] for what in costs)
        left.plot(steps, times, marker=marker, markersize=4, label=method.replace("_", "-"))
        right.plot(steps, inputs, marker=marker, markersize=4)
    left.set(xscale="log", yscale="log", xlabel="horizon of G[0,H], steps", ylabel="CPU ns a transition")
    right.set(xscale="log", xlabel="horizon of G[0,H], steps", ylabel="inputs added to the policy")
    right.set_yscale("symlog", linthresh=1)
    right.set_ylim(-0.3, 1e5)
    for axes in (left, right):
        axes.grid(alpha=0.3)
    figure.legend(loc="outside upper center", ncols=len(METHODS), frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path.with_suffix(".svg"), metadata={"Date": None})
    figure.savefig(path.with_suffix(".png"), dpi=150)
    plt.close(figure)


def main(words: Sequence[str] | None = None) -> None:
    """Write the file of figures, the tables between the markers of the page, and the chart."""
    parser = argparse.ArgumentParser(description="Write the tables of what the benchmarks measured.")
    parser.add_argument("benchmarks", type=Path, nargs="?", help="what pytest --benchmark-json wrote")
    parser.add_argument("--merge", action="store_true", help="keep figures that were not measured now")
    parser.add_argument("--json", type=Path, default=Path("results/bench.json"), help="the file of all figures")
    parser.add_argument("--page", type=Path, default=Path("docs/performance-tables.md"), help="the page of the tables")
    options = parser.parse_args(words)
    figures: dict[str, Figure] = {}
    if options.merge or not options.benchmarks:
        figures = json.loads(options.json.read_text(encoding="utf-8"))
    if options.benchmarks:
        figures |= read(options.benchmarks)
        options.json.write_text(json.dumps(figures, indent=2, sort_keys=True) + "\n", encoding="utf-8")
    page = options.page.read_text(encoding="utf-8")
    begin, end = "<!-- --8<-- [start:bench] -->\n", "\n<!-- --8<-- [end:bench] -->"
    head, tail = page.index(begin) + len(begin), page.index(end)
    options.page.write_text(f"{page[:head]}\n{markdown(figures)}\n{page[tail:]}", encoding="utf-8")
    if horizons(figures):
        draw(figures, options.page.parent / CHART)


if __name__ == "__main__":
    main()
