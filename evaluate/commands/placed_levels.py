"""A run in rounds: every policy at every level of the axes, then each at levels of its own, where it breaks."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from evaluate.analysis.breaking_points import grid, wanted
from evaluate.commands.execution import simulate
from evaluate.commands.outputs import Ending, conclude
from evaluate.commands.plan import Plan, limited
from evaluate.records.manifest import Manifest
from evaluate.records.store import ChunkStore, Run, remove_chunks
from evaluate.report.table import print_breaking_points
from evaluate.rollouts.experiment import Cell
from quad_env.files.writing import sole_use
from quad_env.scenarios.axes import Axis, axes_of
from quad_env.scenarios.named import Scenario

Names = Mapping[str, Sequence[str]]
"""Names of scenarios by policy."""


def scenario_names(axis: Axis) -> tuple[str, ...]:
    """Names of the levels of an axis, and of every severity between them that may be run."""
    between = (severity for severity in grid(axis) if severity not in axis.levels)
    return (f"{axis.name}:all", *(f"{axis.name}={severity!r}" for severity in between))


def execute(plan: Plan, budget: int, go_on: str) -> int:
    """Run round after round and conclude; the exit code. The plan has every scenario that may be run.

    What comes next follows from what was run before: a run that was stopped goes on where it was. `budget` is in
    episodes of a policy on an axis. Raises as `execution.execute`; `go_on` is the command for after Ctrl-C.
    """
    out = plan.options.out
    with sole_use(out):
        store = ChunkStore(out, plan.manifest, resumed=plan.options.resume)
        done, interrupted = _rounds(plan, store, budget // plan.options.episodes)
        if interrupted:
            raise KeyboardInterrupt(f"kept {len(done)} finished parts in {out}; go on with: {go_on}")
        manifest = _manifest(plan.manifest, done)
        ran = Run(manifest, tuple(sorted(done, key=lambda cell: manifest.cells.index((cell.scenario, cell.policy)))))
        code = conclude(ran, out, Ending(print_breaking_points, plan.gates, plan.options.baseline))
        manifest.write(out)
        remove_chunks(out)
        return code


def _rounds(plan: Plan, store: ChunkStore, most: int) -> tuple[list[Cell], bool]:
    """The cells that were finished, and whether the user interrupted; each policy has so many levels an axis at most,
    or those of the axis."""
    done: list[Cell] = []
    levels = [scenario.name for scenario in plan.scenarios if ":" in scenario.name]
    todo: dict[str, list[str]] = {policy.label: levels for policy in plan.policies}
    while any(todo.values()):
        cells, interrupted = simulate(_part(plan, todo), store)
        done += cells
        if interrupted:
            return done, True
        todo = {policy: _next(plan, [cell for cell in done if cell.policy == policy], most) for policy in todo}
    return done, False


def _next(plan: Plan, cells: Sequence[Cell], most: int) -> list[str]:
    """Names of the scenarios that a policy runs in the next round, after these cells of its own."""
    found, axes = [], axes_of(plan.options.hardware.quadruped)
    for axis in dict.fromkeys(scenario.axis for scenario in plan.scenarios):
        severities = wanted([cell for cell in cells if cell.scenario.axis == axis], grid(axes[axis]), most)
        found += [each.name for each in plan.scenarios if each.axis == axis and each.severity in severities]
    return found


def _part(plan: Plan, todo: Names) -> Plan:
    """One round."""
    policies = [replace(policy, only_on=tuple(todo[policy.label])) for policy in plan.policies if todo[policy.label]]
    scenarios = tuple(each for each in plan.scenarios if any(policy.runs_on(each) for policy in policies))
    manifest = replace(plan.manifest, scenarios=scenarios, only_on=todo)
    return replace(plan, policies=tuple(policies), scenarios=scenarios, manifest=manifest)


def _manifest(whole: Manifest, done: Sequence[Cell]) -> Manifest:
    """That of a run of these cells, which the command in it makes again in one go."""
    ran = {policy: [cell.scenario.name for cell in done if cell.policy == policy] for policy in whole.policies}
    names = {name for each in ran.values() for name in each}
    scenarios: tuple[Scenario, ...] = tuple(each for each in whole.scenarios if each.name in names)
    only_on = {policy: tuple(each) for policy, each in ran.items() if set(each) < names}
    options = {
        "scenarios": [each.name for each in scenarios],
        "policies": list(limited(whole.policies, only_on)),
    }
    return replace(whole, scenarios=scenarios, only_on=only_on, options={**whole.options, **options}).begun()
