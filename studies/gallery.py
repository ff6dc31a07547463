"""The gallery of tasks: `python studies/gallery.py` films each, and writes docs/gallery.md.

Controllers act, and actions are random where there is none. `python studies/gallery.py hopper --results DIR` films one
task again; the best stored policy of that folder of results acts. `--into FOLDER` keeps films elsewhere, and writes no
page: `docs/figures/robots` has those of the page Robots. `--page` writes the page alone, from the films that are there.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from stlbench.contract import ActionGrid, Array, GymTask, Integers, RewardMethod
from stlbench.contract.presentation import Drawn, Pixels
from stlbench.records.array_files import Film
from stlbench.records.result import reported
from stlbench.registry import plugins
from stlbench.simulation.baselines import Unpaid
from stlbench.simulation.environment import Simulator
from stlbench.simulation.referee import Recording, score, simulate
from stlbench.study import film
from stlbench.study.film import FRAMES_A_SECOND
from stlbench.study.policies import load_policy
from stlbench.study.results import Results
from stlbench.task import Task, load_task

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs" / "figures" / "gallery"
PAGE = ROOT / "docs" / "gallery.md"
FILMED = "films.json"
WIDTH = 480
"""Pixels of a film."""
STARTS = 16
"""Starts of the report that are tried, one of which is filmed."""
FRAMES, PICTURES = 75, 40
"""About the most pictures in a film; an environment's own pictures are larger, and so there are fewer."""

WHO = {
    "at random": "Random actions, since no policy has learned it yet.",
}

Act = Callable[[Simulator], Integers | Array]


@dataclass(frozen=True)
class Filmed:
    """The content of the film of a task."""

    by: str
    """The actor: "by hand", "at random", or a cell's name."""
    robustness: float
    seconds: float
    """That an episode lasts."""
    drawn: bool
    """Whether pictures of the task itself are seen; else the plane, or signals against time."""
    width: int
    height: int


@dataclass(frozen=True)
class Actor:
    """The thing that acts in a task."""

    task: Task
    method: RewardMethod
    act: Act
    name: str


def tasks() -> list[str]:
    """The names of those that come with stlbench."""
    return sorted(name for name, plugin in plugins.available("tasks").items() if plugin.distribution == plugins.OWN)


def actor(name: str, results: Path | None) -> Actor:
    """The best stored policy of a folder of results; without one the task's controller, or actions at random."""
    task = load_task(name)
    if results is not None:
        return _best(task, results)
    unpaid = Unpaid(task.specification)
    first = Simulator(task, unpaid)
    first.reset(task.starts.report_and_selection()[0][:1])
    if first.world.by_hand(first.t) is not None:
        return Actor(task, unpaid, _by_hand(task), "by hand")
    return Actor(task, unpaid, _at_random(task), "at random")


def _best(task: Task, results: Path) -> Actor:
    kept = [each for each in Results.load(results) if each.id.task.name == task.name and each.measurement]
    best = max(kept, key=lambda each: reported(each.measurement.selected).mean)
    found = load_policy(results, best)
    policy = found.policy
    return Actor(found.task, found.method, lambda simulator: policy.act(simulator.observe()), best.id.name)


def _by_hand(task: Task) -> Act:
    def act(simulator: Simulator) -> Integers | Array:
        vectors = np.asarray(simulator.world.by_hand(simulator.t), dtype=np.float64)
        return task.actions.nearest(vectors) if isinstance(task.actions, ActionGrid) else vectors

    return act


def _at_random(task: Task) -> Act:
    generator, actions = np.random.default_rng(0), task.actions
    assert not isinstance(actions, ActionGrid)
    return lambda simulator: generator.uniform(actions.low, actions.high, (len(simulator.t), len(actions.low)))


class Camera:
    """Pictures of one copy in the order of time, as `film.Pictures`."""

    def __init__(self, of: Actor, start: Array) -> None:
        self.of, self.simulator = of, Simulator(of.task, of.method, rewarded=False, drawn=True)
        self.simulator.reset(start)

    def __call__(self, sample: int) -> Sequence[Pixels]:
        """At the last decision before a sample. Raises `RuntimeError` where there are none."""
        while self.simulator.t[0] + self.simulator.hold <= sample:
            self.simulator.advance(self.of.act(self.simulator))
        pictures = self.simulator.world.frames()
        if pictures is None:
            raise RuntimeError("there is no picture")
        return pictures


def shoot(name: str, results: Path | None, folder: Path) -> Filmed:
    """Film the start whose robustness is the median of some of the report's."""
    of = actor(name, results)
    task, every = of.task, of.task.starts.report_and_selection()[0]
    starts = every[:: max(1, len(every) // STARTS)]
    visited = list[Array]()
    traces = simulate(task, of.method, of.act, starts, visited).traces
    robustness = score(task, traces).robustness
    chosen = int(np.argsort(robustness)[len(robustness) // 2])
    start, own = starts[[chosen]], isinstance(task.dynamics, Drawn | GymTask)
    path = folder / f"{name}.webp"
    recording = Recording(traces[[chosen]], 1, Film(np.array([0]), np.stack(visited, axis=1)[[chosen]]))
    pictures = Camera(of, start) if isinstance(task.dynamics, GymTask) else None
    if remark := film.write(task, recording, (robustness[chosen],), name, path, pictures):
        print(f"{name}: {remark}")
    width, height = _small(path, PICTURES if pictures else FRAMES)
    seconds = task.file.steps * task.file.sampling_time
    return Filmed(of.name, round(robustness[chosen], 4), seconds, own and not remark, width, height)


def _small(path: Path, most: int) -> tuple[int, int]:
    """Make a film of so many frames as wide as the page shows it, and its end a picture of its own; the film's size."""
    with Image.open(path) as shot:
        size = (WIDTH, round(shot.height * WIDTH / shot.width))
        frames = []
        every = -(-shot.n_frames // most)
        for i in range((shot.n_frames - 1) % every, shot.n_frames, every):
            shot.seek(i)
            frames.append(shot.convert("RGB").resize(size, Image.Resampling.LANCZOS))
    first, *others = frames
    how = {"quality": 30, "method": 6, "duration": round(1000 * every / FRAMES_A_SECOND)}
    first.save(path, save_all=True, append_images=others, loop=0, **how)
    frames[-1].save(path.with_name(f"{path.stem}-still.webp"), quality=75, method=6)
    return size


def page(filmed: dict[str, Filmed]) -> str:
    """The gallery in Markdown."""
    parts = [_HEAD.format(count=len(filmed))]
    parts += [_entry(load_task(name), each) for name, each in sorted(filmed.items())]
    return "\n".join(parts)


_HEAD = """# Gallery of tasks

What do the {count} tasks of stlbench look like? Click a picture to play its film. Unless it says otherwise, the task's
controller acts. [Tasks](reference/tasks.md) has formulas and sources.
"""


def _entry(task: Task, filmed: Filmed) -> str:
    name = task.name
    size = f'width="{filmed.width}" height="{filmed.height}"'
    picture = f"![{name}](figures/gallery/{name}-still.webp){{{size} loading=lazy}}"
    who = "" if filmed.by == "by hand" else " " + WHO.get(filmed.by, f"Policy `{filmed.by}`.")
    return f"""## {name}

[{picture}](figures/gallery/{name}.webp){{.film}}

{task.file.title}.{who}
"""


def main() -> None:
    """Film, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="tasks; all where none is named")
    parser.add_argument("--results", type=Path, help="folder of results whose best policies act")
    parser.add_argument("--into", type=Path, default=FOLDER, help="folder of the films")
    parser.add_argument("--page", action="store_true", help="write the page alone")
    asked = parser.parse_args()
    table = asked.into / FILMED
    filmed = {name: Filmed(**each) for name, each in json.loads(table.read_text()).items()} if table.exists() else {}
    asked.into.mkdir(parents=True, exist_ok=True)
    for name in [] if asked.page else asked.names or tasks():
        filmed[name] = shoot(name, asked.results, asked.into)
        print(name, filmed[name])
        table.write_text(json.dumps({each: asdict(filmed[each]) for each in sorted(filmed)}, indent=1) + "\n")
    if asked.into == FOLDER:
        PAGE.write_text(page(filmed), encoding="utf-8")


if __name__ == "__main__":
    main()
