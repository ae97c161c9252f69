"""A plan carried out: every cell simulated and kept, then everything shown and written, even after Ctrl-C."""

import shlex
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

# Everything that is needed to the end, so that no interrupt can come in the middle of an import.
import quad_env.envs.vector_env  # noqa: F401
from evaluate.cells import PolicyScenarioResult, evaluation_seeds
from evaluate.commands.looks import interim_analysis
from evaluate.commands.options import PROGRAM
from evaluate.commands.outputs import Show, write_results
from evaluate.commands.plan import Plan
from evaluate.records.manifest import Manifest
from evaluate.records.store import ChunkStore, Run, is_unfinished, read_run, remove_chunks
from evaluate.report.table import print_results
from evaluate.rollouts import diagnosis
from evaluate.rollouts.run import RunSettings, StoreError, run_cells
from evaluate.rollouts.workers import WorkerDiedError, process_pool
from evaluate.statistics.sequential import looks
from quad_env.cli import launcher
from quad_env.cli.command_line import UsageError
from quad_env.cli.interrupt import Interrupt
from quad_env.cli.program import format_os_error
from quad_env.cli.progress import show_progress, show_waiting
from quad_env.files.writing import exclusive_lock
from quad_env.physics.simulators import MUJOCO, RELATIVE_STEP_TIME


def execute(plan: Plan, show: Show = print_results) -> int:
    """Run every cell and conclude, the outcome shown so; the exit code.

    Raises UsageError, FolderInUse, and after Ctrl-C a KeyboardInterrupt that says what is kept.
    """
    with exclusive_lock(plan.options.out):
        return _execute(plan, show)


def _execute(plan: Plan, show: Show) -> int:
    out, manifest = plan.options.out, plan.manifest
    output_args = plan.options.baseline, show
    if plan.options.resume and (run := read_run(out)).complete:
        print(f"{out} holds the whole run: nothing is left to simulate", file=sys.stderr)
        write_results(run, out, *output_args)
        remove_chunks(out)
        return 0
    if not plan.options.resume:  # else it was done as the run began
        if is_unfinished(out):
            print(f"{out} holds an unfinished run, which is replaced now; --resume would carry it on", file=sys.stderr)
        for each in plan.policies:
            with show_waiting(f"trying whether {each.label} stands and walks"):
                words = diagnosis.warning(each.policy, manifest.hardware.robot)
            for line in (*diagnosis.remarks(each.policy), *([words] if words else ())):
                print(f"warning: {each.label}: {line}", file=sys.stderr)
    if (slower := RELATIVE_STEP_TIME[manifest.hardware.simulator]) > 1:
        print(f"{manifest.hardware.simulator} takes about {slower:g} times as long as {MUJOCO}", file=sys.stderr)
    store = ChunkStore(out, manifest, resumed=plan.options.resume)
    run, interrupted = _simulate(plan, store)
    try:
        if run.cells:
            write_results(run, out, *output_args)
    except Exception as error:
        if not launcher.is_out_of_memory(error):
            raise
        raise UsageError(f"{launcher.OUT_OF_MEMORY}; {_resume_hint(store)}") from error
    if not interrupted:
        remove_chunks(out)
        return 0
    parts = f"{len(run.cells)} finished parts of {len(manifest.cells)}"
    parts += f", of {run.manifest.episodes} episodes each," * run.manifest.is_unsettled
    kept = f"wrote the {parts}" if run.cells else "kept what was done"
    raise KeyboardInterrupt(f"{kept} to {out}; go on with: {_resume_command(out)}")


def _simulate(plan: Plan, store: ChunkStore) -> tuple[Run, bool]:
    """What was finished, in the order of the run, and whether the user interrupted. Raises UsageError."""
    run, done, interrupted = Run(store.manifest, ()), list[PolicyScenarioResult](), False
    try:
        launcher.raise_on_interrupt()
        launcher.preallocate_blas_buffers()
        with Interrupt() as interrupt:
            while not run.complete:
                if run.cells:
                    more = min(each for each in looks(run.manifest.limit) if each > run.manifest.episodes)
                    store.manifest, done = replace(run.manifest, episodes=more), []
                done.extend(_cells(plan, store, interrupt))
                run = _after_interim_analysis(_run(store.manifest, done), store.folder)
    except KeyboardInterrupt:
        if not store.begun:
            raise
        interrupted = True
    except Exception as error:
        if (words := _error_message(error, store)) is None:
            raise
        raise UsageError(words) from error
    return run if run.cells else _run(store.manifest, done), interrupted


def _cells(plan: Plan, store: ChunkStore, interrupt: Interrupt) -> Iterator[PolicyScenarioResult]:
    """Every cell with the episodes of the store's manifest, as it is finished; progress is shown."""
    made_with = store.manifest
    with show_progress(len(made_with.cells)) as progress:

        def report(policy: str, scenario: str, share: float) -> None:
            interrupt.check()
            progress(policy, scenario, share)

        threads, seeds = plan.options.threads, evaluation_seeds(made_with.seed, made_with.episodes)
        pool = process_pool(threads, interrupt.check)
        # Chunks as large as allowed, but something for every worker.
        size = min(plan.options.at_once, -(-plan.manifest.episodes * len(plan.manifest.cells) // threads))
        settings = RunSettings(threads, report, size, store, made_with.steps, pool, made_with.hardware)
        yield from run_cells(plan.policies, plan.scenarios, seeds, settings)


def _run(manifest: Manifest, done: Sequence[PolicyScenarioResult]) -> Run:
    """What is done, in the order of the run."""
    return Run(manifest, tuple(sorted(done, key=lambda cell: manifest.cells.index((cell.scenario, cell.policy)))))


def _after_interim_analysis(run: Run, folder: Path) -> Run:
    """The run after a look, if it is one until settled, at its ranking: printed on stderr and kept in its manifest."""
    if not run.manifest.is_unsettled:
        return run
    line, ended = interim_analysis(run.cells, run.manifest.limit)
    print(line, file=sys.stderr, flush=True)
    run = replace(run, manifest=replace(run.manifest, ended=ended))
    run.manifest.write(folder)
    return run


def _error_message(error: Exception, store: ChunkStore) -> str | None:
    """A line for a user: why not everything was simulated, and what may be done; None for a fault of the program."""
    if launcher.is_out_of_memory(error):
        return f"{launcher.OUT_OF_MEMORY}; {_resume_hint(store)}"
    if isinstance(error, StoreError):
        return f"cannot write to {store.folder} ({error.strerror}); make room, then {_resume_hint(store)}"
    if isinstance(error, WorkerDiedError | OSError):
        return f"{format_os_error(error)}; {_resume_hint(store)}"
    return None


def _resume_hint(store: ChunkStore) -> str:
    """What a user may do after a failure."""
    return f"go on: {_resume_command(store.folder)}" if store.begun else "begin again, for nothing was done yet"


def _resume_command(out: Path) -> str:
    return f"{PROGRAM} --resume --out {shlex.quote(str(out))}"
