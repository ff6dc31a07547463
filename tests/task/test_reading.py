"""What a task file says once it is read, and every way in which it can be wrong."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import yaml
from helpers.line_task import text

from stlbench import stl
from stlbench.errors import UsageError
from stlbench.task.entry import Region
from stlbench.task.reading import dump_yaml, load_yaml, read, read_task_file


def errors(**changes: Any) -> list[str]:
    """The lines of the message about a task file with some entries replaced."""
    with pytest.raises(UsageError) as caught:
        read_task_file(text(**changes), "line")
    head, *lines = str(caught.value).splitlines()
    assert head == "task line: task.yaml has errors:"
    return [entry.removeprefix("  ") for entry in lines]


class TestRead:
    def test_defaults(self) -> None:
        file = read_task_file(text(), "line")
        assert (file.steps, file.hold, file.starts, file.time) == (8, 1, 4, "steps")
        assert (file.training.starts, file.environment, file.terminated) == (None, None, "hold")
        assert file.formula == stl.parse("G[0,4] x <= 1")
        assert file.budgets["smoke"].steps == 40

    def test_intervals_in_seconds(self) -> None:
        file = read_task_file(text(time="seconds", formula="G[0.5,2] x <= 1"), "line")
        assert file.formula == stl.parse("G[1,4] x <= 1")

    def test_without_an_interval_to_the_end_of_the_episode(self) -> None:
        file = read_task_file(text(formula="G x <= 1 & F G[0,2] x <= 1"), "line")
        assert file.formula == stl.parse("G[0,8] x <= 1 & F[0,6] G[0,2] x <= 1")

    def test_an_axis_has_round_values(self) -> None:
        file = read_task_file(text(actions={"v": {"low": -0.3, "high": 0.3, "count": 7}}), "line")
        assert file.actions["v"].values == (-0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3)

    def test_a_region_keeps_what_fulfils_its_condition(self) -> None:
        region = Region(box={"x": (-1, 1), "y": 2}, where="x >= 0 & y >= 2")
        assert (region.low.tolist(), region.high.tolist()) == ([-1, 2], [1, 2])
        assert region.keep(np.array([[0.5, 2], [-0.5, 2], [0.5, 1]])).tolist() == [[0.5, 2]]


PLAIN = "expected a formula without temporal operators"
BOX, UNIT = {"box": {"x": 1}}, {"low": 0, "high": 1}


def near(signal: str) -> list[dict[str, Any]]:
    return [{"until": 4, "where": f"{signal} >= 1"}]


def exploring(**entries: Any) -> dict[str, Any]:
    return {"training": {"exploring": {"share": 1, **entries}}}


def ends(where: str, **entries: Any) -> dict[str, Any]:
    return {"training": {"ends": [{"where": where, **entries}]}}


class TestMessages:
    def test_a_name_that_yaml_reads_as_something_else(self) -> None:
        """`on` is true, which pydantic calls 1, and `7` is a number."""
        lines = errors(signals={True: {"low": -2, "high": 2}, 7: {"low": -2, "high": 2}})
        assert sorted(lines[:2]) == [f"signals.{key}.[key]: should be a text" for key in ("1", "7")]
        assert lines[2].startswith("formula: no signal 'x'")

    def test_a_file_that_nests_too_deep(self) -> None:
        for deep in ("[" * 700, "{" * 700, "- " * 700):
            with pytest.raises(UsageError, match=r"^task line: task\.yaml nests too deep$"):
                read_task_file(deep, "line")

    @pytest.mark.parametrize(
        ("changes", "expected"),
        [
            ({"titel": "x"}, "titel: there is no such key; did you mean 'title'?"),
            ({"signals": {"x": {"low": 1, "high": 2, "hihg": 1}}}, "signals.x.hihg: there is no such key; did you"),
            ({"sampling_time": 0}, "sampling_time: should be more than 0"),
            ({"sampling_time": float("inf")}, "sampling_time: should be a finite number"),
            ({"time": "hours"}, "time: should be 'steps' or 'seconds'"),
            ({"signals": {}}, "signals: should not be empty"),
            ({"initial": {"box": {"x": [0, "a"]}}}, "initial.box.x.1: should be a number"),
            ({"initial": {"box": {"x": 1}, "where": "F[0,1] x >= 0"}}, f"initial.where: {PLAIN}, got F[0,1] x >= 0"),
            ({"formula": "G[0,9] x <= 1"}, "formula: its horizon of 9 steps exceeds steps = 8"),
            (
                {"formula": "True"},
                "formula: it reads no signal, so every trace has the same verdict; name a signal in it",
            ),
            (
                {"best_known": {"robustness": 0.5, "upper_bound": 0.25}},
                "best_known: a robustness of 0.5 is more than its upper_bound, 0.25",
            ),
            ({"starts": 100_001}, "starts: should be at most 100000"),
            (
                {"formula": "x <= 1 -> True"},
                "formula: every trace satisfies it; leave out what makes it constant",
            ),
            (
                {"formula": "G[0,4] O[5,8] x <= 1"},
                "formula: every trace violates it; leave out what makes it constant",
            ),
            (
                {"formula": "F[0,1000000000] H[5,1000000000] x <= 1"},
                "formula: its horizon of 1000000000 steps exceeds steps = 8",
            ),
            ({"formula": "G F x <= 1"}, "formula: F without an interval at column 3 stands inside another temporal"),
            ({"formula": "G F[0,9] x <= 1"}, "formula: G without an interval needs 10 samples, the trace has 9"),
            ({"formula": "G[0,9 x <= 1"}, "formula: line 1, column 7: expected"),
            ({"signals": {"xs": UNIT}, "formula": "G[0,4] sx <= 1"}, "formula: no signal 'sx'; did you mean 'xs'?"),
            ({"signals": {"pi": UNIT}, "formula": "G[0,4] pi <= 1"}, "formula: pi in a formula is a constant; the"),
            ({"time": "seconds", "formula": "G[0,0.7] x <= 1"}, "formula: line 1, column 5: expected a whole number"),
            ({"nested": "G[0,4] G[0,4] x <= 1"}, "nested: its horizon is 8 steps, that of the formula 4"),
            ({"protocols": {"formula": {"title": "t"}}}, "protocols: the name 'formula' is that of the task's own"),
            ({"hold": 4, "budgets": {"smoke": {"steps": 41}}}, "budgets.smoke: 41 steps are no multiple of hold = 4"),
            (exploring(near=near("x")), "training.exploring.near: its states are drawn from `states`, which is"),
            (exploring(near=near("y"), states=BOX), "training.exploring.near.0.where: no signal 'y'; there are: x"),
            ({"training": {"cuts": [8]}}, "training.cuts: 8 is no multiple of hold = 1 below steps = 8"),
            (ends("violation", reward=-1), "training.ends.0.reward: there is no such key; there are: where"),
            (ends("G[0,1] x <= 1"), f"training.ends.0.where: {PLAIN}, got G[0,1] x <= 1"),
            ({"formula": "F[0,4] x >= 1"} | ends("violation"), "training.ends.0.where: 'violation' is of a term G"),
            ({"terminated": "violated"} | ends("lost"), "training.ends.0.where: 'lost' is of episodes whose last"),
            ({"initial": {"box": {"x": [-1e308, 1e308]}}}, "initial.box.x: low and high are farther apart than any"),
            ({"rewarded": "G[0,3] (x <= 1)"}, "rewarded: its horizon is 3 steps, that of the formula 4"),
            ({"actions": {"v": UNIT | {"count": 2}, "w": UNIT}}, "actions: give each axis a count, for a grid, or"),
        ],
    )
    def test_one_error_is_one_line_with_its_place(self, changes: dict[str, Any], expected: str) -> None:
        found = errors(**changes)
        assert found[0].startswith(expected)
        excerpt = 2 if "line 1, column" in expected else 0  # of the formula, and a caret below it
        assert len(found) == 1 + excerpt

    def test_an_entry_that_is_wrong_in_part_is_checked_in_its_other_parts(self) -> None:
        """What a second run would tell, were a wrong range, count, title or share to hide what stands beside it."""
        ending = {"where": "z >= 0"}
        assert errors(
            sampling_time="fast",
            hold=3,
            formula="G[0,4] (y <= 1 & z <= 1)",
            signals={"x": {"low": 0}, "w": {"low": 2, "high": 1}},
            plane=["x", "v"],
            actions={"v": {"low": -1, "high": 1, "count": 1}, "u": {"low": 1, "high": 0}},
            robots={"a": ["v"], "b": []},
            initial={"box": {"x": [1, 0], "w": "0"}, "where": "v >= 0"},
            training={"cuts": [4, 0], "ends": [ending, {"where": "x >= 0 &"}], "exploring": {"share": 2}},
            protocols={"late": {"formula": "G[0,4] u <= 1", "initial": {"box": {"x": 0}, "where": "y <= 0"}}},
            budgets={"smoke": {"steps": 0, "seeds": 0}},
        ) == [
            "sampling_time: should be a number",
            "signals.x.high: must be given",
            "actions.v.count: should be at least 2",
            "robots.b: should not be empty",
            "initial.box.x: low must not exceed high, got [1.0, 0.0]",
            "initial.box.w: expected a number or [low, high], got '0'",
            "training.cuts.1: should be at least 1",
            "training.ends.1.where: line 1, column 9: expected a formula or an expression but found the end of the formula",  # noqa: E501
            "    x >= 0 &",
            "            ^",
            "training.exploring.share: should be at most 1",
            "protocols.late.title: must be given",
            "budgets.smoke.steps: should be at least 1",
            "budgets.smoke.seeds: should be at least 1",
            "signals.w: low must be less than high, got 2.0 and 1.0",
            "actions.u: low must be less than high, got 1.0 and 0.0",
            "formula: no signal 'y'; there are: w, x",
            "formula: no signal 'z'; there are: w, x",
            "protocols.late.formula: no signal 'u'; there are: w, x",
            "hold: an episode of 8 steps is no multiple of hold = 3",
            "training.cuts: 4 is no multiple of hold = 3 below steps = 8",
            "training.ends.0.where: no signal 'z'; there are: w, x",
            "plane: no signal 'v'; there are: w, x",
            "robots: together they have v; they should have each of v, u once, in this order",
            "initial.where: no state 'v'; there are: w, x",
            "protocols.late.initial.where: no state 'y'; there are: x",
        ]

    def test_an_unknown_unit_says_nothing_of_the_terms_of_a_schedule(self) -> None:
        changes = {"schedules": {"late": "F x >= 1"}}
        assert errors(steps="abc", **changes) == ["steps: should be a whole number"]
        assert read_task_file(text(**changes), "line").schedules["late"] == stl.parse("F[0,8] x >= 1")

    def test_what_has_two_forms(self) -> None:
        expected = ["environment.names: expected a list", "environment.names: expected a mapping, {key: value}"]
        assert errors(environment={"names": 3}) == expected

    def test_intervals_of_an_unknown_unit_are_not_judged(self) -> None:
        """Whether 0.7 s are whole steps, and how many, only the sampling time could tell; the syntax is checked."""
        assert errors(time="seconds", sampling_time=0, formula="G[0,0.7] x <= 1") == [
            "sampling_time: should be more than 0"
        ]
        found = errors(time="hours", formula="G[0,0.7 x <= 1", nested="F[0,50] y <= 1")
        assert [line.partition(":")[0] for line in found if not line.startswith("  ")] == ["formula", "time", "nested"]

    @pytest.mark.parametrize(
        ("content", "said"),
        [
            ("formula: x >= 0\nsteps: 3\n'formula': x <= 0\n", "the key 'formula' in line 1 and again in line 3"),
            ("signals:\n  x: {low: 0, low: 1}\n", "the key 'low' in line 2 and again in line 2"),
            ("training:\n- {ends: [{at: 1}]}\n- ends:\n  - at: 1\n    at: 2", "the key 'at' in line 4 and again in"),
        ],
    )
    def test_a_key_that_is_there_twice(self, content: str, said: str) -> None:
        with pytest.raises(UsageError, match=f"^task line: task.yaml has {said}"):
            read_task_file(content, "line")

    def test_a_key_may_override_what_is_merged(self) -> None:
        text = "x: &x {low: 0, high: 1}\ny: &y\n  <<: *x\n  low: 2\nz:\n  <<: *y\n  high: 3\n"
        assert load_yaml(text, "here")["z"] == {"low": 2, "high": 3}

    @pytest.mark.parametrize(
        ("text", "value"),
        [
            ("1e-3", 0.001),
            ("-2E0", -2.0),
            ("[+.5e3, 1.5e3]", [500.0, 1500.0]),
            ("1_0e2", 1000.0),
            ("'1e3'", "1e3"),
            ("[e3, 1e, 1e-3x, v1e3]", ["e3", "1e", "1e-3x", "v1e3"]),
            ("{1e-3: 2e3}", {0.001: 2000.0}),
        ],
    )
    def test_a_number_may_have_an_exponent_without_a_point(self, text: str, value: Any) -> None:
        read = load_yaml(text, "here")
        assert repr(read) == repr(value)
        assert repr(load_yaml(dump_yaml({"k": read}), "here")) == repr({"k": value})

    @pytest.mark.parametrize(
        ("text", "value"), [("010", 10), ("-08", -8), ("1_000", 1000), ("1:30", "1:30"), ("1:30.5", "1:30.5")]
    )
    def test_a_number_is_decimal(self, text: str, value: Any) -> None:
        assert load_yaml(text, "here") == value
        assert yaml.safe_load(dump_yaml({"k": value})) == {"k": value}

    @pytest.mark.parametrize(
        "content", ["", "- a\n- b", "words", "title: [", "title: !!python/object/apply:os.getcwd []"]
    )
    def test_what_is_no_yaml_or_no_mapping_and_nothing_of_it_runs(self, content: str) -> None:
        said = "is no YAML: " if "title" in content else r"has errors:\n  expected a mapping, {key: value}"
        with pytest.raises(UsageError, match=rf"^task line: task\.yaml {said}"):
            read_task_file(content, "line")


class TestByHand:
    """The file beside a task file, which has what somebody made so that a robot learns."""

    def test_its_keys_count_as_those_of_the_task_file(self) -> None:
        recipes = "agents: {dqn: &one {gamma: 0.9}, sb3-dqn: *one}\nrewarded: G[0,4] (2 * x <= 2)\n"
        both, file = read(text(agents=None), "line", recipes), read(text(agents=None) + recipes, "line").file
        assert (both.file, both.errors) == (file, ())
        assert file is not None
        assert list(file.agents) == ["dqn", "sb3-dqn"]
        assert read(text(), "line", "training: {cuts: [8]}").errors == (
            "training.cuts: 8 is no multiple of hold = 1 below steps = 8",
        )

    @pytest.mark.parametrize(
        ("content", "said"),
        [
            ("agents: [", "by_hand.yaml is no YAML: "),
            ("training: *anchor", "by_hand.yaml is no YAML: "),
            ("", "by_hand.yaml: expected a mapping, {key: value}$"),
            ("steps: 4", "by_hand.yaml: steps: the keys of this file are rewarded, nested, features, training, ag"),
            ("agents: {dqn: {}}", "by_hand.yaml: agents: task.yaml has it too; leave it in one of the two files$"),
        ],
    )
    def test_what_is_wrong_with_it_is_one_line(self, content: str, said: str) -> None:
        with pytest.raises(UsageError, match=f"^task line: {said}"):
            read(text(title="&anchor A line"), "line", content)


@pytest.mark.parametrize("line", ['nested: "\\ud800"', 'source: "a \\udfff b"', '"\\ud800": 1'])
def test_half_a_character_is_refused_with_what_it_is(line: str) -> None:
    with pytest.raises(UsageError, match=r"^task line: task.yaml has a text with .ud(800|fff), which is a half of a "):
        read_task_file(f"title: A line\n{line}\n", "line")
