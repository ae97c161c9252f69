"""Looks at a run --until settled: which neighbours in the ranking are distinguished, and whether the run ends."""

from collections.abc import Sequence
from dataclasses import dataclass

from evaluate.analysis.score import counted, counts
from evaluate.rollouts.experiment import Cell, LabelledPolicy
from evaluate.statistics.sequential import Neighbours, neighbours
from quad_env.cli.command_line import UsageError
from quad_env.cli.format import number
from quad_env.scenarios.scenario import Scenario


@dataclass(frozen=True)
class Look:
    """The ranking after some of at most `limit` episodes: that of the score, or, of a run with the hardware profile
    alone, of the hardware score."""

    cells: Sequence[Cell]
    limit: int

    @property
    def neighbours(self) -> list[Neighbours]:
        """From the best on."""
        found = counted(self.cells, hardware=all(cell.scenario.hardware for cell in self.cells))
        if not found.ran:
            raise ValueError("policies that ran different episodes are not ranked")
        return neighbours({policy: found.by_episode(policy) for policy in found.ran}, self.limit)

    @property
    def ended(self) -> str:
        """Why the run ends here, in words; empty where it goes on."""
        distinct = [each.distinguished for each in self.neighbours]
        if all(distinct) or self.cells[0].episodes == self.limit:
            return f"{'' if all(distinct) else 'not '}every two neighbours in the ranking are distinguished"
        hopeless = all(each.distinguished or each.hopeless for each in self.neighbours)
        return f"the neighbours not distinguished can hardly be with {self.limit}" if hopeless else ""

    @property
    def line(self) -> str:
        """`24 of at most 96 episodes, 1 of 2 neighbours distinguished: a > b, b ~ c (p = 0.2)`."""
        found = self.neighbours
        known = f"{sum(each.distinguished for each in found)} of {len(found)} neighbours distinguished"
        pairs = (f"{a} > {b}" if yes else f"{a} ~ {b} (p = {number(p, 2)})" for a, b, p, yes, _ in found)
        return f"{self.cells[0].episodes} of at most {self.limit} episodes, {known}: {', '.join(pairs)}"


def check_ranked(policies: Sequence[LabelledPolicy], scenarios: Sequence[Scenario]) -> None:
    """Raise UsageError where no two policies would be ranked."""
    counted = [each for each in scenarios if counts(each, all(scenario.hardware for scenario in scenarios))]
    if not counted or sum(all(map(policy.runs_on, counted)) for policy in policies) < 2:
        raise UsageError("--until settled: name two policies or more that run on every scenario, and one but `steady`")
