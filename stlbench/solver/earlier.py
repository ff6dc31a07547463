"""A policy that an earlier solve made, from which another one starts: `stlbench solve --from DIR`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from stlbench.contract import Intractable, Unsuitable
from stlbench.errors import UsageError, one_line
from stlbench.records.observation import Observation
from stlbench.records.result_files import cell_files
from stlbench.simulation.worlds import observation_of
from stlbench.solver.contestants import Contestant, again
from stlbench.solver.solution import FILE, cells_of, certificate_of
from stlbench.study.initial import Initial, read, refuse_other
from stlbench.study.results import Results
from stlbench.task import Task, build_agent, build_method


@dataclass(frozen=True)
class EarlierPolicy:
    """A stored policy, who trained it, and what it observes. No code of its folder runs."""

    path: Path
    digest: str
    trained_by: Contestant
    observation: Observation | None

    @classmethod
    def of(cls, folder: Path) -> EarlierPolicy:
        """The policy that the certificate in a folder is of. Raises `UsageError` where there is none."""
        try:
            facts = certificate_of(folder / FILE)
        except (OSError, ValueError) as error:
            raise UsageError(f"--from {folder}: it has no solution; `stlbench solve` writes one: {error}") from error
        cells = folder / cells_of(facts["budget"])
        result = Results.load(cells).cell(facts["cell"], facts["budget"])
        path, digest = Initial.of(cell_files(cells, result.id, result.key).policies)
        stored = result.measurement and result.measurement.policies
        if not stored or stored.selected != digest:
            raise UsageError(f"--from {folder}: {path} is not the policy that was recorded")
        return cls(path, digest, Contestant.of(result), stored.observation)

    def check(self, task: Task) -> None:
        """Raises `UsageError` where trainings on a task cannot start from it."""
        method, agent = self.trained_by.method, self.trained_by.agent
        helped = again(self.trained_by, task).helped
        try:
            shown = observation_of(helped, build_method(helped, method), method)
            refuse_other(read(self.path), build_agent(helped, agent), agent, helped)
        except (Intractable, Unsuitable) as error:
            raise UsageError(f"--from: its policy was trained with {method} and {agent}: {one_line(error)}") from error
        if self.observation is not None:
            self.observation.check("--from", shown)
