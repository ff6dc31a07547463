"""Tasks: what is made of a task file and a system, without parts of it, and errors of both at once."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.line_task import line, text

from stlbench import stl
from stlbench.contract import ActionBox
from stlbench.errors import UsageError
from stlbench.registry import plugins
from stlbench.task import build_agent, load_task
from stlbench.task.file import OPTIONAL, TaskFile
from stlbench.task.reading import read_task_file
from stlbench_agents.dqn import DQNPerRobot


def part_of(file: TaskFile, part: str) -> Any:
    if part == "near":
        return file.training.exploring.near if file.training.exploring else ()
    return getattr(file if part in ("features", "schedule", "rewarded", "hold") else file.training, part)


class TestWithout:
    FULL = text(
        schedule="G[0,4] (x <= 1)",
        rewarded="G[0,4] (0.5 * x <= 0.5)",
        hold=2,
        training={
            "cuts": [4],
            "ends": [{"where": "violation"}, {"where": "x >= 5"}],
            "exploring": {"share": 0.5, "states": {"box": {"x": [-2, 2]}}, "near": [{"until": 4, "where": "x >= 1"}]},
        },
    )

    PLAIN = text(features="state")

    @pytest.mark.parametrize("part", OPTIONAL)
    def test_everything_optional_can_be_left_out_once(self, part: str) -> None:
        full = read_task_file(self.FULL, "line")
        plain, less = read_task_file(self.PLAIN, "line"), full.without(part)
        for other in {*OPTIONAL} - {"near" if part == "exploring" else "exploring" if part == "near" else ""}:
            expected = plain if other == part else full
            assert part_of(less, other) == part_of(expected, other)
        with pytest.raises(ValueError, match=f"the task is without {part} as it is"):
            less.without(part)

    def test_a_plain_file_is_without_what_it_has_of_these(self) -> None:
        file, plain = read_task_file(self.FULL, "line"), read_task_file(self.PLAIN, "line")
        for part in OPTIONAL:
            file = file.without(part)
        assert file == plain
        for full in (self.FULL, text(hold=2), self.PLAIN):
            assert read_task_file(full, "line").plain() == plain

    def test_a_plain_file_starts_training_where_the_task_does(self) -> None:
        starts = {"starts": {"box": {"x": [-2, 2]}}}
        plain = read_task_file(text(training={**starts, "cuts": [4]}), "line").plain()
        assert plain == read_task_file(text(training=starts, features="state"), "line")

    def test_other_parts_stay(self) -> None:
        with pytest.raises(ValueError, match="a task is never without 'formula', but perhaps without features, sched"):
            read_task_file(self.FULL, "line").without("formula")


class TestTask:
    def test_methods_are_told_the_rewarded_form(self) -> None:
        task = line(rewarded="G[0,4] (0.5 * x <= 0.5)")
        assert task.specification.formula == stl.parse("G[0,4] (0.5 * x <= 0.5)")
        assert task.formula == stl.parse("G[0,4] (x <= 1)")

    def test_actions_without_counts_are_a_box(self) -> None:
        actions = {"v": {"low": -1, "high": 2}, "w": {"low": 0, "high": 1}}
        assert line(actions=actions).actions == ActionBox(("v", "w"), (-1, 0), (2, 1))

    def test_the_specification_is_what_a_method_needs(self) -> None:
        task = load_task("hold-disc")
        specification = task.specification
        assert specification.formula == stl.parse("G[0,200] norm(x - 2, y - 2) <= 1")
        assert specification.nested == stl.parse("G[0,190] G[0,10] norm(x - 2, y - 2) <= 1")
        assert (specification.signals, specification.low, specification.high) == (("x", "y"), (0, 0), (4, 4))
        assert (specification.steps, specification.dt) == (200, 0.01)

    def test_unknown_names(self) -> None:
        with pytest.raises(UsageError, match=r"no task 'hold-disk'; did you mean 'hold-disc'\?"):
            load_task("hold-disk")
        task = load_task("hold-disc")
        with pytest.raises(UsageError, match=r"task hold-disc has no budget 'smok'; did you mean 'smoke'\?"):
            task.budget("smok")

    def test_an_agent_without_a_recipe_has_its_defaults(self) -> None:
        task = load_task("hold-disc")
        assert task.recipe("sb3-dqn")["net_arch"] == [64, 64]
        assert task.recipe("td3") == {}
        assert build_agent(task, "dqn-per-robot") == DQNPerRobot()
        assert build_agent(task, "dqn-per-robot[gamma=0.5]") == DQNPerRobot(gamma=0.5)

    ENTRIES = "[stlbench.tasks]\nzz-line = zz_task.system:Line\n"
    SYSTEM = (
        "from stlbench.contract import System\n"
        "class Line(System):\n"
        "    state = ('x', 'y')\n"
        "    def __init__(self, dt, *, mass: float = 1.0):\n"
        "        super().__init__(dt)\n"
        "        self.mass = mass\n"
        "    def step(self, state, action): return state\n"
        "    def signals(self, state): return state\n"
        "    def features(self, state, t): return state\n"
    )

    def install(self, site: Callable[..., Path], by_hand: str | None = None, **changes: Any) -> Path:
        files = {"zz_task/__init__.py": "", "zz_task/system.py": self.SYSTEM, "zz_task/task.yaml": text(**changes)}
        return site("zz-distribution", self.ENTRIES, files | ({"zz_task/by_hand.yaml": by_hand} if by_hand else {}))

    def test_parameters_arrive_at_the_system(self, site: Callable[..., Path]) -> None:
        self.install(site, parameters={"mass": 2.5}, initial={"box": {"x": 0, "y": 0}})
        system: Any = load_task("zz-line").system
        assert (system.mass, system.dt) == (2.5, 0.5)

    def test_errors_of_the_file_of_its_parameters_and_of_its_boxes_at_once(self, site: Callable[..., Path]) -> None:
        self.install(site, hold=3, sampling_time=-1, parameters={"weight": 2.5, "mass": "heavy"})
        with pytest.raises(UsageError) as caught:
            load_task("zz-line")
        assert str(caught.value).splitlines() == [
            "task zz-line: task.yaml has errors:",
            "  sampling_time: should be more than 0",
            "  hold: an episode of 8 steps is no multiple of hold = 3",
            "  parameters: no parameter 'weight'; there are: mass; mass should be a number, got 'heavy'",
            "  initial: the box must name x, y, in this order",
        ]

    def test_what_is_made_by_hand_may_be_in_a_file_of_its_own(
        self, site: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setitem(plugins._ADDED, "tasks", {})
        root = self.install(site, "agents: {sb3-dqn: {}, dqn: {}}\n", agents=None, initial={"box": {"x": 0, "y": 0}})
        assert load_task("zz-line").own_agent == "sb3-dqn"
        assert load_task(f"{(root / 'zz_task').rename(root / 'zz-folder')}").own_agent == "sb3-dqn"
        (root / "zz-folder/by_hand.yaml").write_text("training: {cuts: [8], cut: 8}\n")
        with pytest.raises(
            UsageError, match=r"^task zz-folder: task.yaml with by_hand.yaml has errors:\n  training.cut:"
        ):
            load_task("zz-folder")
        (root / "zz-folder/by_hand.yaml").write_bytes(b"\xff")
        with pytest.raises(UsageError, match=r"^task zz-folder: by_hand.yaml cannot be read: "):
            load_task("zz-folder")

    def test_a_system_that_refuses_its_parameters_says_why(self, site: Callable[..., Path]) -> None:
        refuse = "        if mass < 0: raise ValueError('mass must be positive')\n"
        system = self.SYSTEM.replace("        self.mass", f"{refuse}        self.mass")
        content = text(parameters={"mass": -1}, hold=3)
        site("zz", self.ENTRIES, {"zz_task/__init__.py": "", "zz_task/system.py": system, "zz_task/task.yaml": content})
        with pytest.raises(UsageError) as caught:
            load_task("zz-line")
        assert str(caught.value).splitlines()[1:] == [
            "  hold: an episode of 8 steps is no multiple of hold = 3",
            "  parameters: mass must be positive",
            "  initial: the box must name x, y, in this order",
        ]

    @pytest.mark.parametrize("box", [{"x": 0}, {"y": 0, "x": 0}, {"x": 0, "y": 0, "z": 0}])
    def test_a_box_names_the_states_in_their_order(self, site: Callable[..., Path], box: dict[str, float]) -> None:
        far = {"far": {"title": "t", "initial": {"box": box}}}
        self.install(site, initial={"box": {"x": 0, "y": 0}}, training={"starts": {"box": box}}, protocols=far)
        with pytest.raises(UsageError) as caught:
            load_task("zz-line")
        assert str(caught.value).splitlines() == [
            "task zz-line: task.yaml has errors:",
            "  training.starts: the box must name x, y, in this order",
            "  protocols.far.initial: the box must name x, y, in this order",
        ]
