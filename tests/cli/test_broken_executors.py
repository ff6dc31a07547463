"""`stlbench run` with an executor that does wrong: a line with its name, and the cells that ended are kept."""

from __future__ import annotations

from pathlib import Path

import pytest

from stlbench.records.ledger import LEDGER, Ledger

PLAN = ("run", "--tasks", "toy-line", "--agents", "toy-agent", "--methods", "toy-raw")
BROKEN = '''

class Broken(Here):
    """Does wrong."""
    def run(self, function, items, deadlines):
        outcomes = super().run(function, items, deadlines)
        {body}
'''
RULE = "its run should be a generator with one outcome for each of 2 items"
ITEMS = f"{RULE}, it gives"


@pytest.mark.parametrize(
    ("body", "message", "kept"),
    [
        ("raise SystemExit(0)", " failed: SystemExit: 0", 0),
        ('yield next(outcomes); raise RuntimeError("the\\ncluster has gone")', " failed: RuntimeError: the cluster", 1),
        ("return iter(list(outcomes))", f": {ITEMS} list_iterator", 0),
        ("yield next(outcomes); yield None", f": {ITEMS} None", 1),
        ("yield Outcome(2, 'killed')", f": {ITEMS} Outcome(index=2, status='killed'", 0),
        ("yield next(outcomes)", f": {RULE}; 1 of them are missing", 1),
        ("yield Outcome(0, 'odd')", ": its outcome has the status 'odd', the contract says done, raised, timeout", 0),
        ("yield Outcome(0, 'killed', facts=7)", ": its outcome has facts of type int, the contract says a mapping", 0),
    ],
)
def test_it_is_told_with_its_name(say, toy, body, message, kept):
    path = toy / "toy_plugins/executors.py"
    path.write_text(path.read_text() + BROKEN.format(body=body))
    (entries,) = toy.glob("*.dist-info/entry_points.txt")
    entries.write_text(entries.read_text() + "toy-broken = toy_plugins.executors:Broken\n")
    done = say(*PLAN, "--executor", "toy-broken")
    assert (done.exit_code, done.stdout) == (2, "")
    assert f"error: executor 'toy-broken' of toy-plugins 1.2{message}" in done.stderr.splitlines()[-1]
    with Ledger(Path("results") / LEDGER) as ledger:
        assert len(list(ledger.results())) == kept
    assert say(*PLAN, "--executor", "toy-here").exit_code == 0


def test_one_that_cannot_be_made(say, toy):
    path = toy / "toy_plugins/executors.py"
    path.write_text(path.read_text().replace("super().__init__(jobs=jobs)", 'raise OSError("no cluster")'))
    done = say(*PLAN, "--executor", "toy-here")
    message = "error: executor 'toy-here' of toy-plugins 1.2 failed: OSError: no cluster\n"
    assert (done.exit_code, done.stderr) == (2, message)
