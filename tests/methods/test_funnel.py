"""funnel: the numbers of eq. 5, 11, 12, 15, Table I and sec. III-B, worked out by hand."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import pytest
from helpers.episodes import run, specification
from helpers.stepwise import one_step
from hypothesis import given
from hypothesis import strategies as st

from stlbench.contract import Unsuitable
from stlbench.task import load_task
from stlbench.task.build import equal_payments, payments
from stlbench_methods.funnel import Funnel
from stlbench_methods.raw import Raw

NEAR = 1e-5
"""`Specification.range` is within 1e-6 of the true extremes."""

SEQUENCE = "F[4,8] x >= 1 & G[12,20] abs(x) <= 1"
BOX = {"x": (-2.0, 2.0)}
Shape = Literal["linear", "clipped", "normalised"]


def paid(method: Funnel, x: float, t: int) -> float:
    """r'(x, t): the reward of arriving at x at step t."""
    zero = np.zeros((1, 1))
    reward, _ = one_step(method, zero, zero, np.array([[x]]), np.array([t - 1]), np.zeros((1, 0)))
    return float(reward[0])


class TestSequence:
    """Eq. 11 for F[4,8] (x >= 1) & G[12,20] (abs(x) <= 1), x in [-2, 2], gamma_inf = .5, c = b1 = 8.

    psi_1: rho = x - 1 in [-3, 1], so rho_max = 1, gamma_0 = 4. (4 - .5) / (1 - .5) = 7:
    gamma(t) = 3.5 * 7^(-t/8) + .5 for t <= 8; gamma(8) = 1 = rho_max.
    psi_2: rho = 1 - abs(x) in [-1, 1], so rho_max = 1, gamma_0 = 2. (2 - .5) / (1 - .5) = 3:
    gamma(t) = 1.5 * 3^(-(t-8)/4) + .5 for t > 8; gamma(12) = 1 = rho_max.
    """

    method = Funnel(specification(SEQUENCE, BOX, steps=22), ginf=0.5)

    @pytest.mark.parametrize(
        ("x", "t", "expected"),
        [
            (0.5, 4, -0.5 + (3.5 / math.sqrt(7) + 0.5) - 1),
            (0.5, 8, -0.5),
            (2.0, 8, 1.0),
            (-2.0, 1, -3 + (3.5 * 7 ** (-1 / 8) + 0.5) - 1),
            (0.25, 9, 0.75 + (1.5 * 3 ** (-1 / 4) + 0.5) - 1),
            (0.25, 12, 0.75),
            (0.25, 16, 0.75 + 2 / 3 - 1),  # 1.5 / 9 + .5 = 2/3
            (-2.0, 20, -1 + 5 / 9 - 1),  # 1.5 / 27 + .5 = 5/9
            (0.25, 21, 0.0),  # after the last interval nothing is paid
            (-2.0, 22, 0.0),
        ],
    )
    def test_reward(self, x: float, t: int, expected: float) -> None:
        assert paid(self.method, x, t) == pytest.approx(expected, abs=NEAR)

    @pytest.mark.parametrize(("x", "t"), [(0.5, 4), (0.5, 8), (2.0, 8), (0.25, 16), (-2.0, 20), (0.25, 21)])
    def test_clipped_is_the_linear_reward_where_it_is_negative(self, x: float, t: int) -> None:
        clipped = Funnel(self.method.specification, ginf=0.5, shape="clipped")
        assert paid(clipped, x, t) == min(0.0, paid(self.method, x, t))

    @pytest.mark.parametrize(
        ("x", "t", "expected"),
        [
            # -ln(1 + (rho_max - rho) / gamma)
            (0.5, 4, -math.log(1 + 1.5 / (3.5 / math.sqrt(7) + 0.5))),
            (0.5, 8, -math.log(1 + 1.5 / 1)),
            (1.0, 8, -math.log(2)),  # on the lower bound, one width of the funnel from rho_max
            (2.0, 8, 0.0),  # at rho_max
            (-2.0, 20, -math.log(1 + 2 / (5 / 9))),
            (0.25, 21, 0.0),
        ],
    )
    def test_normalised(self, x: float, t: int, expected: float) -> None:
        method = Funnel(self.method.specification, ginf=0.5, shape="normalised")
        assert paid(method, x, t) == pytest.approx(expected, abs=NEAR)

    def test_scales(self) -> None:
        # linear: r' lies in [rho_min + gamma_inf - rho_max, gamma_0], at most the widest gamma_0 = 4 in size
        assert self.method.scale == pytest.approx(4, abs=NEAR)
        normalised = Funnel(self.method.specification, ginf=0.5, shape="normalised")
        assert normalised.scale == pytest.approx(math.log(1 + 4 / 0.5), abs=NEAR)

    @given(x=st.floats(-2, 2), y=st.floats(-2, 2), t=st.integers(1, 22))
    def test_without_overlap_it_is_raw_plus_a_function_of_time(self, x: float, y: float, t: int) -> None:
        raw = Raw(self.method.specification)
        signals, when = np.array([[x], [y]]), np.array([t - 1, t - 1])
        ours, _ = one_step(self.method, signals, np.zeros((2, 1)), signals, when, np.zeros((2, 0)))
        theirs, _ = one_step(raw, signals, np.zeros((2, 1)), signals, when, np.zeros((2, 0)))
        difference = ours - theirs
        assert difference[0] == pytest.approx(difference[1], abs=1e-12)


@pytest.mark.parametrize(
    ("formula", "share", "t_star"),
    [
        ("G[5,9] x >= 0", 1.0, 5),
        ("G[5,9] x >= 0", 0.0, 5),  # t* = a for G, whatever the share
        ("F[4,8] x >= 0", 0.0, 4),
        ("F[4,8] x >= 0", 0.5, 6),
        ("F[4,8] x >= 0", None, 8),  # by its deadline, by default
        ("F[2,6] G[1,3] x >= 0", 0.0, 3),  # [a + c2, c1 + c2] = [3, 7]
        ("F[2,6] G[1,3] x >= 0", 0.5, 5),
        ("F[2,6] G[1,3] x >= 0", 1.0, 7),
    ],
)
def test_table_1(formula: str, share: float | None, t_star: float) -> None:
    """l = ln((gamma_0 - gamma_inf) / (rho_max - gamma_inf)) / t*; x in [-2, 2]: gamma_0 = 4, rho_max = 2."""
    method = Funnel(specification(formula, BOX), ginf=1.0, **({} if share is None else {"t_star": share}))
    (curve,) = method.curves
    assert curve.t_star == t_star
    assert curve.rate == pytest.approx(math.log((4 - 1) / (2 - 1)) / t_star, abs=NEAR)
    assert curve(np.array([t_star])) == pytest.approx([2.0], abs=NEAR)  # the lower bound reaches 0


class TestAlwaysFromTheStart:
    """G[0,b]: Table I gives l = 1/0."""

    spec = specification("G[0,10] x >= 0", BOX, steps=12)

    @pytest.mark.parametrize("t", [1, 5, 10])
    def test_paper_takes_the_limit(self, t: int) -> None:
        # gamma = gamma_inf = .25 throughout: r' = x + .25 - 2
        assert paid(Funnel(self.spec, ginf=0.25), 1.5, t) == pytest.approx(-0.25, abs=NEAR)

    @pytest.mark.parametrize("t", [1, 5, 10])
    def test_code_takes_half_the_interval(self, t: int) -> None:
        # gamma_0 = 4, t* = 5, (4 - 1) / (2 - 1) = 3: gamma = 3 * 3^(-t/5) + 1; at t = 10: 4/3
        method = Funnel(self.spec, ginf=1.0, variant="code")
        assert paid(method, 1.5, t) == pytest.approx(1.5 + 3 ** (1 - t / 5) + 1 - 2, abs=NEAR)

    def test_code_has_100_of_200_in_the_comparative_study(self) -> None:
        method = Funnel(load_task("hold-disc").specification, variant="code")
        assert method.curves[0].t_star == 100

    def test_code_leaves_other_intervals_alone(self) -> None:
        spec = specification(SEQUENCE, BOX)
        assert Funnel(spec, variant="code").curves == Funnel(spec).curves

    def test_nothing_is_paid_after_it(self) -> None:
        assert paid(Funnel(self.spec), -2.0, 11) == 0


class TestOneSample:
    """x in [-2, 2], rho = x: gamma_0 = 4, rho_max = 2, gamma_inf = .9: gamma(t) = 3.1 (3.1 / 1.1)^(-t / 4) + .9."""

    @pytest.mark.parametrize("variant", ["paper", "code"])
    @pytest.mark.parametrize("activity", ["last-deadline", "literal"])
    @pytest.mark.parametrize("term", ["G[4,4]", "F[4,4]", "F[1,1] G[3,3]"])
    def test_its_funnel_reaches_it_from_the_start(
        self, term: str, activity: Literal["last-deadline", "literal"], variant: Literal["paper", "code"]
    ) -> None:
        spec = specification(f"{term} x >= 0 & F[4,9] x >= 1", BOX, steps=9)
        method = Funnel(spec, ginf=0.9, activity=activity, variant=variant)
        assert (method.curves[0].t0, method.curves[0].t_star) == (0, 4)
        gamma = [3.1 * (3.1 / 1.1) ** (-t / 4) + 0.9 for t in range(5)]
        before = 0.0 if activity == "literal" else gamma[1] - 2
        assert paid(method, 0.0, 1) == pytest.approx(before, abs=NEAR)
        if activity == "last-deadline":
            assert paid(method, 1.5, 4) == pytest.approx(1.5 + gamma[4] - 2, abs=NEAR)

    @pytest.mark.parametrize("variant", ["paper", "code"])
    @pytest.mark.parametrize("shape", ["linear", "clipped", "normalised"])
    @pytest.mark.parametrize("formula", ["G[0,0] x >= 0", "F[0,0] x >= 0", "F[0,0] G[0,0] x >= 0 & F[0,0] x >= 1"])
    def test_that_of_sample_0_is_paid_nothing_and_divides_by_nothing(
        self, formula: str, shape: Shape, variant: Literal["paper", "code"]
    ) -> None:
        method = Funnel(specification(formula, BOX, steps=3), shape=shape, variant=variant)
        rewards, _ = run(method, np.array([-2.0, 0.0, 1.0, 2.0]))
        assert rewards[0, 1:].tolist() == [0, 0, 0]
        assert method.floor == 0
        assert math.isfinite(method.scale)


@pytest.mark.parametrize(("ginf", "printed"), [(1e-9, [0.0103, 0.0138, 0.0083]), (0.01, [0.0109, 0.0145, 0.0087])])
def test_the_rates_printed_for_the_pendulum(ginf: float, printed: list[float]) -> None:
    """Eq. 15 prints rho_max = .05, gamma_0 = pi and l = .0103, .0138, .0083, which are ln(pi / .05) = 4.1405 over
    400, 1000 - 700 and 1700 - 1200, so gamma_inf = 0; with the gamma_inf = .01 of the text,
    ln((pi - .01) / .04) = 4.3604 over the same.

    Signals are the angle's distance to each of the three goals, so that each term has gamma_0 = pi.
    """
    goal = "abs(e{0}) <= 0.05 & abs(omega) <= 0.05"
    text = " & ".join(f"G[{when}] ({goal.format(i)})" for i, when in enumerate(["400,700", "1000,1200", "1700,2000"]))
    box = {name: (-math.pi, math.pi) for name in ("e0", "e1", "e2", "omega")}
    method = Funnel(specification(text, box), ginf=ginf)
    assert [curve.rate for curve in method.curves] == pytest.approx(printed, abs=6e-5)  # .010351 is printed as .0103
    assert [curve.gamma_0 for curve in method.curves] == pytest.approx([math.pi] * 3, abs=NEAR)


class TestOverlap:
    """Sec. III-B: G[2,6] (x >= 0) & F[4,9] (y >= 1), x in [-4, 2], y in [-1, 3], gamma_inf = 1.

    psi_1: rho_max = 2, gamma_0 = 6, t* = 2, (6 - 1) / (2 - 1) = 5: gamma_1 = 5 * 5^(-t/2) + 1.
    psi_2: rho_max = 2, gamma_0 = 4, t* = 9, (4 - 1) / (2 - 1) = 3: gamma_2 = 3 * 3^(-t/9) + 1.
    At x = 1: r_1 = 1 + gamma_1 - 2 = 5^(1-t/2).  At y = 2 and y = 0: r_2 = 3^(1-t/9) and 3^(1-t/9) - 2.
    """

    spec = specification("G[2,6] x >= 0 & F[4,9] y >= 1", {"x": (-4.0, 2.0), "y": (-1.0, 3.0)}, steps=11)

    @staticmethod
    def r_1(t: int) -> float:
        return 5.0 ** (1 - t / 2)

    @staticmethod
    def r_2(t: int) -> float:
        return 3.0 ** (1 - t / 9)

    def test_the_piecewise_example(self) -> None:
        """r_1 on [alpha_1, alpha_2), the minimum while both intervals last, r_2 to the end, 0 outside.

        The intervals are closed, as in Algorithm 1 and as G[2,6] has it, so the minimum includes t = 6.
        """
        expected = [0, *map(self.r_1, (2, 3, 4, 5, 6)), *map(self.r_2, (7, 8, 9)), 0, 0]
        trace = np.tile([1.0, 2.0], (1, 12, 1))
        rewards, _ = run(Funnel(self.spec, ginf=1.0, activity="literal"), trace)
        # r_1(4) = .2 < r_2(4) = 1.84: the minimum is positive, which Algorithm 1 as printed could not pay
        assert rewards[0, 1:] == pytest.approx(expected, abs=NEAR)

    def test_the_minimum_can_be_the_other_term(self) -> None:
        trace = np.tile([1.0, 0.0], (1, 12, 1))
        rewards, _ = run(Funnel(self.spec, ginf=1.0, activity="literal"), trace)
        # r_2 - 2: -.159 at 4, below r_1 = .2
        expected = [0, *map(self.r_1, (2, 3)), *(self.r_2(t) - 2 for t in range(4, 10)), 0, 0]
        assert rewards[0, 1:] == pytest.approx(expected, abs=NEAR)

    def test_last_deadline_starts_both_at_0(self) -> None:
        trace = np.tile([1.0, 2.0], (1, 12, 1))
        rewards, _ = run(Funnel(self.spec, ginf=1.0), trace)
        # r_1(1) = 5^.5 = 2.236 and r_2(1) = 3^(8/9) = 2.655
        expected = [*map(self.r_1, range(1, 7)), *map(self.r_2, (7, 8, 9)), 0, 0]
        assert rewards[0, 1:] == pytest.approx(expected, abs=NEAR)


@pytest.mark.parametrize(
    ("formula", "ginf", "limit"),
    [
        ("G[2,4] abs(x) <= 1", 1.5, "= 1 of"),  # gamma_0 = 2, rho_max = 1
        ("G[2,4] abs(x) <= 1", 1.0, "= 1 of"),  # leaves l = ln((2 - 1) / 0): the range is open, and rounded inwards
        ("G[2,4] abs(x) <= 3", 2.5, "= 2 of"),  # gamma_0 = 3 - 1, rho_max = 3
        ("F[1,2] x >= 0 & G[2,4] x >= 1.75", 0.5, "= 0.25 of"),  # the second term's
        ("G[2,4] x >= 3", 0.01, r"= -1 of G\[2,4\] x >= 3"),  # which cannot be satisfied
    ],
)
def test_ginf_out_of_range_is_unsuitable(formula: str, ginf: float, limit: str) -> None:
    with pytest.raises(Unsuitable, match=rf"ginf = {ginf:g} must be less than min\(gamma_0, rho_max\) {limit}"):
        Funnel(specification(formula, BOX), ginf=ginf)


def test_a_predicate_that_always_holds_has_a_funnel_that_does_not_move() -> None:
    # abs(x) <= 5 over [-2, 2]: rho in [3, 5], gamma_0 = 2 < rho_max: the lower bound is above 0 from the start
    method = Funnel(specification("G[3,6] abs(x) <= 5", BOX), ginf=0.5)
    assert method.curves[0].rate == 0
    assert [paid(method, 1.0, t) for t in (1, 3, 6)] == pytest.approx([4 + 2 - 5] * 3, abs=NEAR)


@pytest.mark.parametrize("shape", ["linear", "clipped", "normalised"])
def test_describe_names_each_term(shape: Shape) -> None:
    described = Funnel(specification(SEQUENCE, BOX), ginf=0.5, shape=shape).describe()
    assert list(described) == ["F[4,8]", "G[12,20]"]
    assert described["G[12,20]"].startswith("gamma_0 2, gamma_inf 0.5, rho_max 1, t0 8, t* 12, l 0.2747")  # ln(3) / 4


BEGINS = ("formation", "hold-disc", "hold-disc-coarse", "integrator-or", "overlap")
OTHERS = ("annulus", "ball-in-cup", "cartpole", "fetch-reach", "pendulum", "reach-stay", "robot-nav")


@pytest.mark.parametrize("task", [*BEGINS, *OTHERS])
def test_the_authors_variant_differs_where_a_funnel_begins_with_its_interval(task: str) -> None:
    spec = load_task(task).specification
    found = equal_payments({"one": payments(Funnel(spec)), "other": payments(Funnel(spec, variant="code"))})
    assert [difference.constant for difference in found if difference.constant is not None] == [0] * (task in OTHERS)
