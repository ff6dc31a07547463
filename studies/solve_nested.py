"""`stlbench solve` on nested formulas, as a new user types them.

python studies/solve_nested.py [NAME ...]               run those that have no row yet, one after another
python studies/solve_nested.py --minutes 8 [NAME ...]   with more than 4 minutes of the time of one core

Each has a row in results/solve/nested.csv, and its folder under build/solve-nested.
"""

from __future__ import annotations

import argparse

import solve_foreign
from row_by_row import add, rows

ROWS, FOLDERS = solve_foreign.ROOT / "results" / "solve" / "nested.csv", solve_foreign.ROOT / "build" / "solve-nested"
MINUTES = 4.0

FORMS = {
    "chain": "F[0,{a}] ({A} & F[0,{a}] {B})",
    "patrol": "G[0,{b}] (F[0,{b}] {A} & F[0,{b}] {B})",
    "response": "F[0,{a}] {A} & G[0,{a}] ({A} -> F[0,{a}] {B})",
    "until": "(!{B}) U[50,100] {A}",
    "two windows": "F[0,{a}] {A} & F[{a},{c}] {B}",
    "overlap": "F[0,{b}] G[0,10] {A} & F[{a},{c}] G[0,10] {B}",
}
"""Forms with a short time {a}, a longer one {b}, and {c}, twice the short one: the second of two windows in turn."""
PLACES = {
    "nested_environments:OwnUnicycle-v0": (
        ("norm(x - 4, y - 1.5) <= 0.6", "norm(x - 1.5, y - 4.5) <= 0.6"),
        ["--signal", "x=obs[0]", "--signal", "y=obs[1]"],
    ),
    "nested_environments:OwnTanks-v0": (
        ("h >= 0.9", "h <= 0.4"),
        ["--signal", "g=obs[0]", "--signal", "h=obs[1]"],
    ),
    # not the lowest angle as the second: it falls there before it can swing up, so `until` would be impossible
    "Pendulum-v1": (("abs(theta) <= 0.3", "abs(omega) >= 6"), ["--signal", "theta=atan2(y, x)"]),
    "CartPole-v1": (("x >= 0.3", "x <= -0.3"), []),
    # it needs the left hill to reach the right one
    "MountainCar-v0": (("position <= -0.8", "position >= 0.3"), []),
}
OWN_FORMS = {
    # the low level holds at the start from a quarter of the starts
    "nested_environments:OwnTanks-v0": {"until": "(!{A}) U[50,100] {B}"},
    # no way was found to both sides in each 95 steps from a sixth of the starts
    "MountainCar-v0": {"patrol": "G[0,60] (F[0,130] {A} & F[0,130] {B})"},
}
"""Forms in place of those above that are impossible, or seem to be."""
TIMES = {"a": 80, "b": 110, "c": 160}
OWN_TIMES = {
    "Pendulum-v1": {"b": 95},  # its episodes have 200 steps, as those of MountainCar
    "MountainCar-v0": {"b": 95},
    "CartPole-v1": {"a": 150, "b": 200, "c": 300},  # a cart that must not fall takes its time
}


def problems() -> dict[str, tuple[str, list[str]]]:
    """Name -> the environment, and the rest of the command."""
    found = dict[str, tuple[str, list[str]]]()
    for environment, ((first, second), options) in PLACES.items():
        for form, text in (FORMS | OWN_FORMS.get(environment, {})).items():
            times = TIMES | OWN_TIMES.get(environment, {})
            formula = text.format(A=f"({first})", B=f"({second})", **times)
            found[f"{environment.rpartition(':')[2]} {form}"] = environment, [formula, *options]
    return found


def page() -> str:
    """One row per environment, one column per form: the lower end of the certificate, and the minutes of CPU time."""
    known = {row["problem"]: row for row in rows(ROWS)}
    lines = [f"| environment | {' | '.join(FORMS)} |", f"|---|{'--:|' * len(FORMS)}"]
    for environment in PLACES:
        name = environment.rpartition(":")[2]
        own = [known.get(f"{name} {form}") for form in FORMS]
        if any(own):
            lines.append(f"| `{name}` | {' | '.join('' if row is None else _told(row) for row in own)} |")
    return "\n".join(lines)


def _told(row: dict[str, str]) -> str:
    low = f"{100 * float(row['low']):.1f} %" if row["low"] else "none"
    return f"{low}, {float(row['cpu']) / 60:.1f}"


def main(names: list[str], minutes: float) -> None:
    """Run what has no row."""
    done = {row["problem"] for row in rows(ROWS)}
    for name, (environment, arguments) in problems().items():
        if name not in done and (not names or name in names):
            row = solve_foreign.measured(environment, arguments, FOLDERS / name.replace(" ", "-"), minutes)
            add(ROWS, ("problem", *solve_foreign.COLUMNS[:-1]), [{"problem": name} | row])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=MINUTES)
    parser.add_argument("names", nargs="*")
    given = parser.parse_args()
    main(given.names, given.minutes)
