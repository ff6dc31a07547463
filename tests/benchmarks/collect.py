"""What `make bench` measured, boiled down: results/bench.json, the tables of docs/performance.md, its figure.

    python tests/benchmarks/collect.py BENCHMARK_JSON --json results/bench.json --page docs/performance.md

BENCHMARK_JSON is what `pytest --benchmark-json` wrote. Each benchmark put its figures into `extra_info`: a number, a
list of samples, or a text, the reason why there is no number. With `--merge`, what was not measured this time stays as
it is in the file that `--json` names; of those figures the table has the median alone.
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

FIGURE = Path("figures/reward-cost")
METHODS = ("funnel", "flag", "tau_mdp", "raw")
PEERS = ("jax", "optax", "sbx-rl", "stable-baselines3", "torch", "sentil", "mstlo-python", "tidystl", "rtamt", "stlrom")


class Line(NamedTuple):
    """A line of the table: what it is, where it is found, how it is shown, and what the goal is."""

    title: str
    key: str
    form: str
    goal: str = ""


def _training() -> Iterator[Line]:
    for actions, goal in ((61, "10"), (273, "7")):
        name = f"train_{actions}"
        yield Line(f"Training, {actions} actions: times SB3's steps/s", f"{name}_vs_sb3", "{:.1f} x", f"{goal} x")
        yield Line("... times SBX's", f"{name}_vs_sbx", "{:.1f} x")
        yield Line("... times the plain torch loop's", f"{name}_vs_torch", "{:.1f} x")
        yield Line("... one copy alone: times SB3's", f"{name}_single_vs_sb3", "{:.1f} x")
        yield Line("... one copy alone: times SBX's", f"{name}_single_vs_sbx", "{:.1f} x")
        yield Line("... one copy alone: times the torch loop's", f"{name}_single_vs_torch", "{:.1f} x")
        yield from _whole_loop("dqn" if actions == 61 else f"dqn_{actions}", 16)
        sides = {"ours": "dqn", "single": "dqn, one copy", "jax_16": "JAX, 16 copies", "jax_1": "JAX, one copy"}
        for who, words in (sides | {"torch": "torch", "sbx": "SBX", "sb3": "SB3"}).items():
            yield Line(f"... steps/s of {words}", f"{name}_steps_per_second_{who}", "{:,.0f}")
            yield Line(f"... share of the sgemm limit, {words}", f"{name}_share_of_sgemm_{who}", "{:.0%}")


def _continuous() -> Iterator[Line]:
    yield Line("Training, any torque: times SB3's steps/s", "td3_vs_sb3", "{:.1f} x")
    yield Line("... times SBX's", "td3_vs_sbx", "{:.1f} x")
    yield Line("... one copy alone: times SB3's", "td3_single_vs_sb3", "{:.1f} x")
    yield Line("... one copy alone: times SBX's", "td3_single_vs_sbx", "{:.1f} x")
    yield from _whole_loop("td3", 8)
    sides = {"ours": "td3", "single": "td3, one copy", "jax_8": "JAX, 8 copies", "jax_1": "JAX, one copy"}
    for who, words in (sides | {"sbx": "SBX", "sb3": "SB3"}).items():
        yield Line(f"... steps/s of {words}", f"td3_steps_per_second_{who}", "{:,.0f}")


def _whole_loop(name: str, copies: int) -> Iterator[Line]:
    """Beside the JAX program; below 1 it is the faster."""
    yield Line(f"... times the JAX program's, {copies} copies each", f"{name}_{copies}_vs_jax", "{:.2f} x", "1 x")
    yield Line("... times the JAX program's, one copy each", f"{name}_1_vs_jax", "{:.2f} x", "1 x")


def _time_to_result() -> Iterator[Line]:
    for task in ("hold_disc", "integrator_or", "robot_nav"):
        name, words = f"time_to_95_{task}", task.replace("_", "-")
        yield Line(f"Time to 95 % on {words}: times faster than SB3, its recipe", f"{name}_vs_sb3", "{:.1f} x", "10 x")
        yield Line("... than SB3 with one environment", f"{name}_vs_sb3_single", "{:.1f} x", "10 x")
        for who, title in (("dqn", "dqn"), ("sb3", "SB3, its recipe"), ("sb3_single", "SB3, one environment")):
            yield Line(f"... CPU seconds of {title}", f"{name}_{who}_seconds", "{:.2g}")
            if who != "dqn":
                yield Line(f"... {title} got there on", f"{name}_{who}_reached", "{}")


def _monitor() -> Iterator[Line]:
    goals = {"rtamt": "100 x", "stlrom": "10 x", "tidystl": "", "mstlo": "", "sentil": "1 x"}
    for formula, words in (("conjunction", "three-term conjunction"), ("nested", "F G"), ("until", "timed until")):
        for kind, where in (("", "every sample"), ("_t0", "the first value")):
            name = f"monitor_{formula}{kind}"
            for peer, goal in goals.items():
                yield Line(f"Robustness, {words}, {where}: times {peer}", f"{name}_vs_{peer}", _times(peer), goal)
                yield Line(f"... {peer}, traces/s", f"{name}_{peer}_traces_per_second", "{:,.3g}")
            for batch in (1, 64, 1024):
                yield Line(f"... batch of {batch}, traces/s", f"{name}_{batch}_traces_per_second", "{:,.0f}")
        yield Line(f"Online, {words}: a step", f"online_{formula}_microseconds", "{:.2f} us", "1 us")
        for peer, goal in goals.items():
            yield Line(f"... times {peer}", f"online_{formula}_vs_{peer}", _times(peer), "1 x" if goal == "1 x" else "")
            yield Line(f"... a step of {peer}", f"online_{formula}_{peer}_microseconds", "{:.3g} us")
        for count in (16, 64, 1024):
            yield Line(f"... one of {count} together", f"online_{formula}_{count}_nanoseconds", "{:.0f} ns")
        for size, traces in (("64", "64 traces"), ("1024", "1024 traces"), ("64_long", "64 traces 8 times as long")):
            yield Line(f"Memory, {words}, {traces}", f"memory_{formula}_{size}_megabytes", "{:.1f} MB")


def _times(peer: str) -> str:
    return "{:.2f} x" if peer == "sentil" else "{:,.0f} x"


def _methods() -> Iterator[Line]:
    for method in METHODS:
        words = method.replace("_", "-")
        yield Line(f"Reward {words}: worst share of training", f"method_share_{method}", "{:.1%}", "10 %")
        for task in ("hold_disc", "hold_disc_coarse", "integrator_or", "robot_nav"):
            yield Line(f"... on {task.replace('_', '-')}", f"method_share_{method}_{task}", "{:.1%}")


def _rest() -> Iterator[Line]:
    for task in ("hold_disc", "robot_nav"):
        for copies in ("16", "1024", "gymnasium"):
            words = f"Environment {task.replace('_', '-')}, {copies}: steps/s"
            yield Line(words, f"environment_{task}_{copies}_steps_per_second", "{:,.0f}")
    for recipe in ("joint", "additive", "joint_plain"):
        for width in (64, 128, 256):
            words = f"One update, {recipe.replace('_', ', ')}, {width} x {width}"
            yield Line(words, f"update_{recipe}_{width}_microseconds", "{:.0f} us")
    for rows in (1, 16, 64):
        yield Line(f"Acting, {rows} rows", f"act_{rows}_microseconds", "{:.0f} us")
    yield Line("Plan 10,000 cells", "plan_10000_seconds", "{:.2f} s", "2 s")
    yield Line("Resume 10,000 cells", "resume_10000_seconds", "{:.2f} s", "3 s")
    yield Line("Report 10,000 cells", "report_10000_seconds", "{:.1f} s", "10 s")
    yield Line("... peak memory", "report_10000_peak_megabytes", "{:.0f} MB")
    yield Line("Harness and referee, CPU above training: a run", "harness_run_seconds", "{:.2f} s")
    yield Line("... and each cell", "harness_cell_seconds", "{:.2f} s")
    yield Line("... as a share of 20 cells of two minutes", "harness_overhead_share", "{:.1%}", "1 %")
    yield Line("Two workers: times one", "two_workers_speedup", "{:.2f} x", "1.9 x")


LINES = (*_training(), *_continuous(), *_time_to_result(), *_monitor(), *_methods(), *_rest())


def read(path: Path) -> tuple[dict[str, Any], str]:
    """Key -> what the benchmarks noted under it; and the machine in words."""
    content = json.loads(path.read_text(encoding="utf-8"))
    noted: dict[str, Any] = {}
    for entry in content["benchmarks"]:
        twice = noted.keys() & entry["extra_info"].keys()
        if twice:
            raise SystemExit(f"{path}: {entry['name']} notes {', '.join(sorted(twice))}, which another has noted")
        noted |= entry["extra_info"]
    machine = content["machine_info"]
    words = f"{machine['cpu'].get('brand_raw', machine['processor'])}, {machine['cpu'].get('count', '?')} cores"
    return noted, f"{words}, Python {machine['python_version']}, {content['datetime'][:10]}"


def standing(path: Path) -> dict[str, float | None]:
    """Key -> median, as `--json` wrote it before; nothing where there is no file."""
    content: dict[str, float | None] = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    return content


def versions(names: Iterable[str]) -> str:
    """Those of the distributions that are installed here, with their versions."""
    found = []
    for name in names:
        with suppress(PackageNotFoundError):
            found.append(f"{name} {version(name)}")
    return ", ".join(found)


def flat(noted: Mapping[str, Any]) -> dict[str, float | None]:
    """Key -> median; None where there is none to give."""
    return {key: middle(value) for key, value in sorted(noted.items())}


def middle(value: Any) -> float | None:
    """The median of what was noted, None for a text or nothing."""
    if value is None or isinstance(value, str) or value == []:
        return None
    return float(median(value) if isinstance(value, list) else value)


def table(noted: Mapping[str, Any]) -> str:
    """The Markdown table of all that was measured."""
    rows = ["| | Median | Least to greatest | Goal |", "|:--|--:|:-:|--:|"]
    rows += [_row(line, noted[line.key]) for line in LINES if noted.get(line.key) is not None]
    return "\n".join(rows)


def _row(line: Line, value: Any) -> str:
    found = middle(value)
    shown = value if isinstance(value, str) else "none" if found is None else line.form.format(found)
    spread = f"{line.form.format(min(value))} to {line.form.format(max(value))}" if _is_spread(value) else ""
    title = f"&nbsp; {line.title.removeprefix('... ')}" if line.title.startswith("...") else line.title
    return f"| {title} | {shown} | {spread} | {line.goal} |"


def _is_spread(value: Any) -> bool:
    return isinstance(value, list) and len(value) > 1


def horizons(noted: Mapping[str, Any]) -> list[int]:
    """Horizons at which the methods' cost was measured."""
    found = (re.fullmatch(r"reward_raw_(\d+)_nanoseconds", key) for key in noted)
    return sorted(int(match[1]) for match in found if match)


def horizon_table(noted: Mapping[str, Any]) -> str:
    """Nanoseconds a transition, and inputs added, by horizon: Markdown."""
    rows = [
        "| Horizon | " + " | ".join(method.replace("_", "-") for method in METHODS) + " | inputs of tau-mdp |",
        "|--:" * (len(METHODS) + 2) + "|",
    ]
    for horizon in horizons(noted):
        times = [middle(noted[f"reward_{method}_{horizon}_nanoseconds"]) or 0 for method in METHODS]
        inputs = noted[f"reward_tau_mdp_{horizon}_inputs"]
        rows.append(f"| {horizon:,} | " + " | ".join(f"{each:,.0f} ns" for each in times) + f" | {inputs:,} |")
    return "\n".join(rows)


def draw(noted: Mapping[str, Any], path: Path) -> None:
    """Time a transition and inputs added, against the horizon; both axes logarithmic. Writes .svg and .png."""
    import matplotlib as mpl

    mpl.use("Agg")
    mpl.rcParams |= {"svg.hashsalt": "stlbench", "font.size": 9}
    from matplotlib import pyplot as plt

    steps = horizons(noted)
    figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.2), layout="constrained")
    for method, marker in zip(METHODS, "osD^", strict=True):
        times = [middle(noted[f"reward_{method}_{step}_nanoseconds"]) for step in steps]
        inputs = [noted[f"reward_{method}_{step}_inputs"] for step in steps]
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


def replaced(page: str, name: str, text: str) -> str:
    """The page with `text` between the markers of that name."""
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    if begin not in page or end not in page:
        raise SystemExit(f"the page has no markers '{begin}' and '{end}'")
    before, rest = page.split(begin, 1)
    return f"{before}{begin}\n\n{text}\n\n{end}{rest.split(end, 1)[1]}"


def main(words: Sequence[str] | None = None) -> None:
    """Write the files that the options name, and print the table."""
    parser = argparse.ArgumentParser(description="Boil down what the benchmarks measured.")
    parser.add_argument("benchmarks", type=Path, help="what pytest --benchmark-json wrote")
    parser.add_argument("--json", type=Path, help="write the medians there")
    parser.add_argument("--merge", action="store_true", help="keep what stands there and was not measured now")
    parser.add_argument("--page", type=Path, help="put the tables between the markers of this Markdown page")
    options = parser.parse_args(words)
    if options.merge and not options.json:
        parser.error("--merge keeps what stands in the file that --json names")
    noted, machine = read(options.benchmarks)
    if options.merge:
        noted = standing(options.json) | noted
    shown = f"{machine}. Peers: {versions(PEERS)}.\n\n{table(noted)}"
    if options.json:
        options.json.parent.mkdir(parents=True, exist_ok=True)
        options.json.write_text(json.dumps(flat(noted), indent=2) + "\n", encoding="utf-8")
    if options.page:
        page = replaced(options.page.read_text(encoding="utf-8"), "bench", shown)
        if horizons(noted):
            page = replaced(page, "horizon", horizon_table(noted))
            draw(noted, options.page.parent / FIGURE)
        options.page.write_text(page, encoding="utf-8")
    print(shown)


if __name__ == "__main__":
    main()
