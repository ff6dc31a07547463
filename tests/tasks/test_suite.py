"""The suite of formulas: templates by hand, laws of candidates, and what the table and the witnesses promise."""

from __future__ import annotations

import hashlib
import json
from types import ModuleType

import numpy as np
import pytest
from helpers.studies import load

from stlbench import stl
from stlbench.contract import Array
from stlbench.simulation import baselines, referee
from stlbench.simulation.baselines import replay
from stlbench.task import Task, fitting_methods, load_task
from stlbench.task.task import agent_for
from stlbench.tracks.auto import automatic
from stlbench_tasks.suite import FormulaSuite, templates
from stlbench_tasks.suite.formulas import TIERS, Candidate, distance, fits, tier
from stlbench_tasks.suite.systems import SYSTEMS, Arm, Integrator, Pair, SuiteSystem
from stlbench_tasks.suite.templates import Cramped, Disc, Draw, Scene

SUITE = FormulaSuite()
QUICK = SUITE.splits["quick"]
A, B, C = (Disc(("x", "y"), (at, 1.0), 0.5) for at in (1.0, 3.0, 5.0))


class Fixed(Scene):
    """A scene whose draws are always the least, with three regions on a line and no obstacles."""

    def __post_init__(self) -> None:
        self.slack, self.starts = 1.0, [(0.0, 1.0)]
        self.draw.whole = lambda low, high: low  # type: ignore[method-assign]
        self.given = iter((A, B, C))

    def region(self, point: int = 0, spread: float = 1.5) -> Disc:
        """The next of the three regions."""
        self.regions.append(next(self.given))
        return self.regions[-1]


def made(template: str) -> str:
    """The formula of a template in the fixed scene."""
    return templates.TEMPLATES[template](Fixed(Integrator, Draw("any"), "usual"))


def test_deadlines_by_hand() -> None:
    """At 0.9 m/s, 1 m and half a second take 1.61 s, so 4 decisions of 5 steps; 2 m take 2.72 s, so 6; 3 m 8."""
    assert made("reach") == f"(F[0,20] {A})"
    assert made("reach-stay") == f"(F[0,20] G[0,10] {A})"
    assert made("sequence") == f"(F[0,20] {A}) & (F[20,50] {B})"
    assert made("chain") == f"(F[0,20] ({A} & F[0,30] {B}))"
    assert made("free-order") == f"(F[0,50] {A}) & (F[0,50] {B})"
    assert made("either-or") == f"(F[0,40] (G[0,10] {A} | G[0,10] {B}))"
    assert made("patrol") == f"(G[0,60] (F[0,60] {A} & F[0,60] {B}))"
    assert made("response") == f"(F[0,20] {A}) & (G[0,25] ({A} -> F[0,30] {B}))"
    assert made("overlap") == f"(F[0,25] G[0,5] {A}) & (F[10,60] G[0,5] {B})"


def driven(*stops: tuple[int, float]) -> Array:
    """A trace (T + 1, 2) along y = 1 that is at x from the given steps on."""
    x = np.zeros(stops[-1][0] + 1)
    for step, at in stops:
        x[step:] = at
    return np.stack([x, np.ones_like(x)], axis=-1)


@pytest.mark.parametrize(
    ("template", "trace", "robustness"),
    [
        ("reach", driven((20, 0.8)), 0.3),  # 0.2 m from the centre
        ("reach", driven((20, 0.4)), -0.1),
        ("sequence", driven((10, 1.0), (40, 2.6), (50, 2.6)), 0.1),  # the worse of 0.5 and 0.1
        ("sequence", driven((10, 1.0), (15, 2.6), (20, 0.0), (50, 0.0)), -2.5),  # the second too early
        ("chain", driven((10, 1.0), (15, 2.6), (20, 0.0), (50, 0.0)), 0.1),  # which a chain allows
        ("either-or", driven((30, 3.2), (55, 3.2)), 0.3),
        ("until", driven((10, 3.0), (50, 1.0), (60, 1.0)), 0.5),  # the key is the second region, the door the first
        ("until", driven((10, 1.2), (20, 3.0), (50, 1.0), (60, 1.0)), -0.3),  # it was 0.3 m inside of the door
        ("response", driven((20, 1.0), (30, 3.0), (55, 3.0)), 0.5),
        ("response", driven((20, 1.0), (30, 2.0), (55, 2.0)), -0.5),
    ],
)
def test_robustness_by_hand(template: str, trace: Array, robustness: float) -> None:
    formula = stl.parse(made(template))
    trace = np.concatenate([trace, np.repeat(trace[-1:], max(0, stl.horizon(formula) + 1 - len(trace)), axis=0)])
    assert stl.robustness(formula, trace, ("x", "y")).item() == pytest.approx(robustness)


def candidates() -> list[Candidate]:
    """The first candidates of each system and template that have a place for their regions."""
    found = []
    for system in SYSTEMS:
        for template in templates.TEMPLATES:
            for number in range(5 if fits(system, template) else 0):
                try:
                    found.append(Candidate(system, template, "hard", number))
                    found[-1].content("any")
                except Cramped:
                    found.pop()
    return found


@pytest.mark.parametrize("candidate", candidates(), ids=str)
def test_laws_of_candidates(candidate: Candidate) -> None:
    content, (scene, _) = candidate.content("any"), candidate.scene
    formula, hold = stl.parse(content["formula"]), content["hold"]
    assert 0 <= content["steps"] - stl.horizon(formula) < hold
    assert content["steps"] % hold == 0
    assert set(stl.signals(formula)) <= set(content["signals"])
    for disc in scene.regions:
        assert all(disc.radius <= at <= 6 - disc.radius for at in disc.centre[: len(disc.names)])
    assert candidate.content("any") == content  # drawn again


@pytest.mark.parametrize("system", SYSTEMS.values())
def test_no_point_is_farther_than_its_system_says(system: type[SuiteSystem]) -> None:
    made, about, generator = system(0.1), system.about, np.random.default_rng(0)
    low, high = np.array([(low, high) for low, high, *_ in about.axes.values()]).T
    box = np.array(list(system.begin(tuple((2.0, 3.0 + i) for i in range(len(about.points)))).values()))
    state = generator.uniform(*box.T, (200, len(system.state)))
    constant = generator.choice([0.0, 1.0], (200, len(low))) * (high - low) + low
    columns = [[list(about.ranges).index(name) for name in names] for names in about.points]
    start = made.signals(state)
    for t in range(1, 60):
        random = generator.uniform(low, high, (200, len(low)))
        state = made.step(state, np.where(np.arange(200)[:, None] < 100, constant, random))
        away = made.signals(state) - start
        way = max(np.linalg.norm(away[:, own], axis=1).max() for own in columns)
        assert way <= about.farthest(np.array(0.1 * t)) + 1e-9


def test_the_arm_starts_where_it_is_put() -> None:
    box = Arm.begin(((1.5, 4.5),))
    assert Arm.tip(np.array([sum(ends) / 2 for ends in box.values()])) == pytest.approx([1.5, 4.5], abs=0.05)


def test_two_points_keep_their_distance() -> None:
    of_pair = [candidate for candidate in candidates() if candidate.system == "pair"]
    assert all(Pair.about.always in candidate.content("any")["formula"] for candidate in of_pair)


# ------------------------------------------------------------------------------------------------ the accepted tasks

DIGESTS = {
    "integrator": "e826f7b3abaf8acc",
    "double-integrator": "430251ce9904c3c2",
    "unicycle": "c652b91a812a0b9d",
    "quadrotor": "1da45e5c48f65186",
    "cart-pendulum": "b8dbe3fda4a322a5",
    "arm": "5afebecd39e02192",
    "pair": "748a631d1def65de",
}
"""A hash of the content of all tasks of a system that are not fresh, without what is known of them."""
FRESH = SUITE.splits["fresh"]


def digest(names: list[str]) -> str:
    contents = [SUITE.candidate(name).content(name) | {"source": "", "budgets": ""} for name in names]
    return hashlib.sha256(json.dumps(contents).encode()).hexdigest()[:16]


@pytest.mark.parametrize("system", SYSTEMS)
def test_a_name_gives_the_same_task_for_ever(system: str) -> None:
    assert (
        digest([name for name in SUITE.names if name.startswith(f"{system}/") and name not in FRESH])
        == (DIGESTS[system])
    )


def test_fresh_tasks_stay_as_they_are() -> None:
    """Thirty draws of one form, in windows that overlap, drawn as the usual ones are, from other numbers."""
    assert digest([*FRESH]) == "c0d6abce453118d7"
    assert len(FRESH) == 30
    for name in FRESH:
        system, template, _ = name.split("/")
        others = {SUITE.candidate(f"{system}/{template}/{n}") for n in range(4)}
        assert SUITE.candidate(name).level == "usual"
        assert template == "overlap"
        assert SUITE.candidate(name) not in others


def test_splits() -> None:
    """dev, core, core, hard, then fresh ones; quick is a part of core with 24 tasks."""
    splits = {split: set(names) for split, names in SUITE.splits.items()}
    parts = [splits[split] for split in ("dev", "core", "hard", "fresh")]
    assert set().union(*parts) == set(SUITE.names)
    assert sum(map(len, parts)) == len(SUITE.names)
    assert splits["quick"] < splits["core"]
    assert len(QUICK) == 24
    assert len(splits["core"]) >= 120
    assert len({name.split("/")[0] for name in QUICK}) == len(SYSTEMS)


def test_tiers_by_hand() -> None:
    """The witness has .5 m, the best baseline misses by 1 m: that is 3 times .5 m less; at 1.5 m it is 4 times."""
    facts = {"robustness": 0.5, "baselines": {"zero": {"robustness": -3.0}, "random": {"robustness": -1.0}}}
    assert (distance(facts), tier(facts)) == (3.0, "near")
    facts["baselines"]["random"]["robustness"] = -1.5
    assert (distance(facts), tier(facts)) == (4.0, "middle")
    facts["baselines"]["random"]["robustness"] = -9.0
    assert (distance(facts), tier(facts)) == (7.0, "far")  # the action zero is the best now


def test_groups_of_tasks() -> None:
    groups = [SUITE.groups(name) for name in SUITE.names]
    assert {tuple(of_task) for of_task in groups} == {("system", "template", "tier")}
    assert {of_task["template"] for of_task in groups} == set(templates.TEMPLATES)
    counts = [sum(of_task["tier"] == each for of_task in groups) for each in TIERS]
    assert min(counts) > len(groups) / 5


def task_of(name: str) -> Task:
    return load_task(f"suite:{name}")


@pytest.mark.parametrize("name", QUICK)
def test_a_witness_has_the_robustness_that_the_table_says(name: str) -> None:
    task, known = task_of(name), SUITE.facts(name)
    score = referee.score(task, replay(task, SUITE.witness(name)).traces)
    assert score.mean == pytest.approx(known["robustness"], abs=1e-4)
    assert score.minimum > 0
    assert known["robustness"] <= known["upper_bound"]


@pytest.mark.parametrize("name", QUICK[::6])
def test_no_task_is_trivial(name: str) -> None:
    """What the table says of constant and random actions is measured again."""
    task, known = task_of(name), SUITE.facts(name)["baselines"]
    bare = Task(task.choice, task.file.model_copy(update={"baselines": None}), task.dynamics)
    measured, random = baselines.constants(bare), baselines.at_random(bare)
    for score, row in ((measured.zero, "zero"), (measured.best, "constant"), (random, "random")):
        assert score.satisfaction == known[row]["satisfied"] <= 0.05
        assert score.mean == pytest.approx(known[row]["robustness"], abs=1e-4)


@pytest.mark.parametrize("name", QUICK[::4])
def test_the_track_auto_takes_it(name: str) -> None:
    task = task_of(name)
    helped = automatic(task, agent_for(task.actions))
    assert {"bhnr", "dense", "tltl"} <= set(fitting_methods(helped))
    assert not task.file.agents


@pytest.fixture(scope="module")
def study() -> ModuleType:
    return load("suite")


SOUND = ["integrator/tube/1", "unicycle/tube/1", "pair/reach-stay/1", "integrator/patrol-stay/1", *QUICK[1::6]]


@pytest.mark.parametrize("name", SOUND)
def test_an_upper_bound_is_above_all_that_was_reached(study: ModuleType, name: str) -> None:
    task, known = task_of(name), SUITE.facts(name)
    bound = study.upper_bound(task, SYSTEMS[name.split("/")[0]])
    assert known["robustness"] - 1e-5 <= known["upper_bound"] <= bound + 1e-5
    assert bound == pytest.approx(known["upper_bound"], abs=1e-4)
    assert baselines.at_random(task).mean <= bound


def bound_of(study: ModuleType, formula: str, steps: int, x: float) -> float:
    """The upper bound on the integrator, from (x, 3)."""
    task = study.load(Candidate("integrator", "reach", "usual", 0))[0]
    region = type(task.file.initial)(box={"x": x, "y": 3.0})
    file = task.file.model_copy(update={"formula": stl.parse(formula), "steps": steps, "initial": region})
    return float(study.upper_bound(Task(task.choice, file, task.dynamics), Integrator))


@pytest.mark.parametrize(
    ("formula", "steps", "x", "bound"),
    [
        ("F[0,10] norm(x - 3, y - 3) <= 0.5", 10, 1.9, 0.5),  # 1.1 m away; within 1 s a point gets 1.414 m far
        ("F[0,5] norm(x - 3, y - 3) <= 0.5", 5, 1.9, 0.5 - (1.1 - 0.5 * 2**0.5)),
        ("F[5,10] G[0,5] norm(x - 3, y - 3) <= 0.5", 15, 2.9, 0.4),  # after decisions x is 2.9 + .25 k
        ("G[5,10] norm(x - 3, y - 3) <= 0.5 & G[10,15] norm(x - 3.5, y - 3) <= 0.5", 15, 3.0, 0.25),  # between both
        ("G[5,10] norm(x - 3, y - 3) <= 0.5 & G[10,15] norm(x - 3.5, y - 3) <= 0.5", 15, 2.9, 0.15),  # x is 3.15 then
        ("G[5,10] norm(x - 3, y - 3) >= 0.5", 10, 3.0, 0.5 * 2**0.5 - 0.5),  # no lattice bounds what goes far away
    ],
)
def test_upper_bounds_by_hand(study: ModuleType, formula: str, steps: int, x: float, bound: float) -> None:
    assert bound_of(study, formula, steps, x) == pytest.approx(bound, abs=2e-3)
