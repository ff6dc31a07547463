"""A figure for each reward method, on a common example: `python studies/method_figures.py` writes docs/figures/methods.

A point moves on a line: above is where it is and what the formula asks for, below what the method pays, over its scale.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from stlbench import stl
from stlbench.contract import Array, RewardMethod, Specification, Unsuitable
from stlbench.registry import plugins
from stlbench.registry.choices import parse_choice
from stlbench.report.figures.files import save_svg
from stlbench.report.figures.style import COLOURS, styled

FOLDER = Path(__file__).parents[1] / "docs" / "figures" / "methods"
STEPS = 40


class Example(NamedTuple):
    """A formula of x, what it asks for, and three ways to go."""

    formula: str
    asked: tuple[tuple[int, int, float, float], ...]
    """Boxes: first and last step, least and greatest x."""
    ways: Mapping[str, tuple[tuple[int, float], ...]]
    """Corners of each way: step, x."""


SEQUENCE = Example(
    "F[5,15] x >= 2 & G[25,35] abs(x) <= 0.5",
    ((5, 15, 2.0, 3.0), (25, 35, -0.5, 0.5)),
    {
        "satisfies": ((0, 0), (12, 2.4), (22, 0.2), (40, 0.0)),
        "is late": ((0, 0), (20, 2.4), (30, 0.2), (40, 0.0)),
        "leaves early": ((0, 0), (12, 2.4), (22, 0.2), (29, 0.2), (40, 2.0)),
    },
)
AGAIN = Example(
    "G[0,30] (F[0,10] x >= 1 & x <= 2.5)",
    ((0, 40, 1.0, 2.5),),
    {
        "satisfies": ((0, 0), (8, 1.4), (14, 0.2), (20, 1.4), (28, 0.4), (32, 1.5), (40, 1.5)),
        "too seldom": ((0, 0), (8, 1.4), (14, 0.2), (24, 0.2), (30, 1.4), (40, 1.4)),
        "too far": ((0, 0), (10, 2.0), (16, 2.9), (22, 2.0), (40, 1.5)),
    },
)
"""For methods that take no terms with absolute intervals: something is asked for again and again."""


def specification(formula: str) -> Specification:
    """The example, x in [-3, 3]."""
    return Specification(stl.parse(formula), ("x",), (-3.0,), (3.0,), STEPS, 0.1)


def trace(corners: Sequence[tuple[int, float]]) -> Array:
    """x at each step, (T + 1,)."""
    steps, places = zip(*corners, strict=True)
    return np.interp(np.arange(STEPS + 1), steps, places)


def rewards(method: RewardMethod, x: Array) -> Array:
    """The rewards of the samples 1..T, over the method's scale, (T,)."""
    zero = np.zeros(1, dtype=np.int64)
    samples = x[:, None, None]
    paid, _ = method.along(samples, np.zeros((1, 1)), zero, method.initial_memory(samples[0], zero))
    return paid[:, 0] / method.scale


def built(name: str) -> tuple[RewardMethod, Example]:
    """The method on the first example that it takes."""
    for example in (SEQUENCE, AGAIN):
        try:
            return plugins.build("methods", parse_choice(name), specification(example.formula)), example
        except Unsuitable:
            continue
    raise SystemExit(f"method {name} takes neither example; add one that it takes to studies/method_figures.py")


@styled
def draw(name: str) -> Figure:
    """The figure of a method."""
    method, example = built(name)
    figure = Figure(figsize=(5.0, 3.4), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    for (way, corners), colour in zip(example.ways.items(), COLOURS, strict=False):
        x = trace(corners)
        above.plot(x, color=colour, label=way)
        below.plot(np.arange(1, STEPS + 1), rewards(method, x), color=colour, drawstyle="steps-pre")
    for first, last, low, high in example.asked:
        above.fill_between([first, last], low, high, color="0.85")
    above.set(ylabel="x", ylim=(-1.4, 3), title=example.formula)
    above.legend(loc="lower left", ncols=3)
    below.set(ylabel="reward / scale", xlabel="step")
    return figure


def main(names: list[str]) -> None:
    """Write the figures of the methods, all of this distribution where none is named."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    own = plugins.find("methods", "raw").distribution
    for name in names or sorted(plugins.available("methods")):
        if plugins.find("methods", name).distribution == own:
            save_svg(draw(name), FOLDER / f"{name}.svg")
            print(FOLDER / f"{name}.svg")


if __name__ == "__main__":
    main(sys.argv[1:])
