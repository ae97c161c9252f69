"""A plan carried out: every cell simulated and kept, then everything shown and written, even after Ctrl-C."""

import shlex
import sys
from pathlib import Path

# Everything that is needed to the end, so that no interrupt can come in the middle of an import.
import quad_env.envs.vector_env  # noqa: F401
from evaluate.commands.options import PROGRAM
from evaluate.commands.outputs import Ending, Show, conclude, print_all
from evaluate.commands.plan import Plan
from evaluate.records import trace
from evaluate.records.store import Run, Store, is_unfinished, read_run, remove_parts
from evaluate.rollouts.experiment import Bench, Cell, Trace, cells, evaluation_seeds
from evaluate.rollouts.progress import show_progress
from evaluate.rollouts.workers import WorkerLost, side_by_side
from evaluate.terminal import launcher
from evaluate.terminal.command_line import UsageError


def execute(plan: Plan, show: Show = print_all) -> int:
    """Run every cell and conclude, the outcome shown so; the exit code.

    Raises UsageError, and KeyboardInterrupt if nothing was kept.
    """
    out, manifest = plan.options.out, plan.manifest
    ending = Ending(show, plan.gates, plan.options.film)
    if plan.options.resume and (run := read_run(out)).complete:
        print(f"{out} holds the whole run: nothing is left to simulate", file=sys.stderr)
        code = conclude(run, out, ending)
        remove_parts(out)
        return code
    if not plan.options.resume and is_unfinished(out):
        print(f"{out} holds an unfinished run, which is replaced now; --resume would carry it on", file=sys.stderr)
    store = Store(out, manifest, resumed=plan.options.resume)
    done, interrupted = _simulate(plan, store)
    code = conclude(Run(manifest, tuple(done)), out, ending) if done else 0
    if not interrupted:
        remove_parts(out)
        return code
    total = len(plan.entrants) * len(plan.scenarios)
    _say_what_is_kept(f"wrote the {len(done)} finished parts of {total}" if done else "kept what was done", out)
    return launcher.INTERRUPTED


def _simulate(plan: Plan, store: Store) -> tuple[list[Cell], bool]:
    """The cells that were finished, in the order of the run, and whether the user interrupted."""
    done: list[Cell] = []
    interrupted = False
    seeds = evaluation_seeds(plan.manifest.seed, plan.manifest.episodes)
    names = [entrant.label for entrant in plan.entrants], [scenario.name for scenario in plan.scenarios]
    try:
        launcher.raise_on_interrupt()
        with show_progress(*names) as progress:
            bench = Bench(
                plan.options.threads,
                progress,
                _at_once(plan),
                store,
                _trace(plan, store),
                plan.manifest.steps,
                side_by_side(plan.options.threads),
                plan.manifest.hardware,
            )
            done.extend(cells(plan.entrants, plan.scenarios, seeds, bench))
    except KeyboardInterrupt:
        if not store.begun:
            raise
        interrupted = True
    except WorkerLost as error:
        raise UsageError(f"{error}; {_then(store)}") from error
    except OSError as error:
        reason = error.strerror or error
        raise UsageError(f"cannot write to {store.folder} ({reason}); make room, then {_then(store)}") from error
    policies, scenarios = names
    done.sort(key=lambda cell: (scenarios.index(cell.scenario.name), policies.index(cell.policy)))
    return done, interrupted


def _at_once(plan: Plan) -> int:
    """Episodes of a job: as many as allowed, but something for every worker."""
    total = plan.manifest.episodes * len(plan.entrants) * len(plan.scenarios)
    return min(plan.options.at_once, -(-total // plan.options.threads))


def _trace(plan: Plan, store: Store) -> Trace | None:
    """What writes the traces, if any are asked for; those of parts that are not kept are removed."""
    if plan.options.trace == "none":
        return None
    folder = plan.options.out / trace.FOLDER
    kept = {
        trace.name_of(entrant.label, scenario.name, int(part.numbers[0]))
        for entrant in plan.entrants
        for scenario in plan.scenarios
        for part in store.kept(entrant.label, scenario)
    }
    trace.keep_only(folder, kept)
    return trace.writer(folder, plan.options.trace)


def _say_what_is_kept(what: str, out: Path) -> None:
    print(f"interrupted: {what} to {out}; go on with: {_go_on(out)}", file=sys.stderr)


def _then(store: Store) -> str:
    """What a user may do after a failure."""
    return f"go on: {_go_on(store.folder)}" if store.begun else "begin again, for nothing was done yet"


def _go_on(out: Path) -> str:
    return f"{PROGRAM} --resume --out {shlex.quote(str(out))}"
