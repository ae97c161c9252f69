"""Execution of an evaluation plan: simulation and storage of all episodes, and output of the results.

After Ctrl-C, the results of the finished pairs of policy and scenario are printed and written as well.
"""

import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

# All modules that the run needs are imported here, because Ctrl-C must not interrupt an import later.
import quad_env.envs.vector_env  # noqa: F401
from evaluate.cells import PolicyScenarioResult, evaluation_seeds
from evaluate.commands.interim_analysis import EarlyRanking, after_round, interim_analysis
from evaluate.commands.options import PROGRAM
from evaluate.commands.outputs import Show, write_results
from evaluate.commands.plan import Plan
from evaluate.records.extension import extend_run
from evaluate.records.manifest import Manifest
from evaluate.records.parts import read_part, write_part
from evaluate.records.shares import Share
from evaluate.records.software import software_versions
from evaluate.records.store import ChunkStore, Run, is_unfinished, read_run, remove_chunks
from evaluate.report.table import print_results
from evaluate.rollouts import diagnosis
from evaluate.rollouts.cluster import VersionCheck, connect
from evaluate.rollouts.cluster_tasks import cluster_executor
from evaluate.rollouts.run import Executor, RunSettings, StoreError, run_cells
from evaluate.rollouts.time_limit import RoundPlanner
from evaluate.rollouts.workers import WorkerDiedError, process_pool
from evaluate.statistics.sequential import looks
from quad_env.cli import launcher
from quad_env.cli.command_line import UsageError
from quad_env.cli.format import with_count
from quad_env.cli.interrupt import Interrupt
from quad_env.cli.program import format_os_error
from quad_env.cli.progress import show_progress, show_waiting
from quad_env.cli.ray_option import parse_ray
from quad_env.files.writing import exclusive_lock
from quad_env.physics.simulators import MUJOCO, RELATIVE_STEP_TIME

GROUPS_PER_WORKER = 4
"""Minimum number of batches per worker process in a run, so that all processes end at about the same time."""
GROUPS_PER_WORKER_IN_ROUND = 2
"""Like GROUPS_PER_WORKER, for a round of a run with a time limit.

A round has few episodes, and the time of a small batch depends little on its number of episodes."""


def execute(plan: Plan, show: Show = print_results) -> int:
    """Simulate all episodes of a plan, then print and write the results.

    FolderInUseError is raised if another run uses the results folder. UsageError is raised if memory or disk are not
    sufficient, or an output cannot be written. KeyboardInterrupt is raised after Ctrl-C; its message names the part of
    the run that is saved.

    Args:
        plan: Checked options, policies and scenarios of the run.
        show: Function that receives the results and a console, and prints the results.

    Returns:
        The exit code.
    """
    with exclusive_lock(plan.options.out):
        return _execute(plan, show)


def _execute(plan: Plan, show: Show) -> int:
    """Simulate, print and write a `plan` in a folder that the caller has locked; return the exit code.

    `show` prints the results. After Ctrl-C, KeyboardInterrupt is raised; its message names the part of the run that is
    saved. UsageError is raised if the memory is not sufficient for the results.
    """
    if plan.manifest.share is not None:
        return _execute_part(plan, plan.manifest.share)
    out = plan.options.out
    if plan.extends:
        plan = _extend(plan)
    if plan.options.resume and (run := read_run(out)).complete:
        print(f"{out} holds the whole run: nothing is left to simulate", file=sys.stderr)
        write_results(run, out, plan.options.baseline, show)
        remove_chunks(out)
        return 0
    if not plan.options.resume:
        _print_warnings(plan)
    simulator = plan.manifest.hardware.simulator
    if (slower := RELATIVE_STEP_TIME[simulator]) > 1:
        print(f"{simulator} takes about {slower:g} times as long as {MUJOCO}", file=sys.stderr)
    store = ChunkStore(out, plan.manifest, resumed=plan.options.resume)
    run, interrupted = _simulate(plan, store)
    try:
        if run.cells:
            write_results(run, out, plan.options.baseline, show)
    except Exception as error:
        if not launcher.is_out_of_memory(error):
            raise
        raise UsageError(f"{launcher.OUT_OF_MEMORY}; {_resume_hint(store)}") from error
    if interrupted:
        raise KeyboardInterrupt(_interrupt_message(plan, run))
    remove_chunks(out)
    return 0


def _extend(plan: Plan) -> Plan:
    """Prepare the extension of a finished run, and print the number of its episodes, which are not simulated again.

    Args:
        plan: Plan of the extended run.

    Returns:
        The plan, which continues the prepared run.
    """
    _print_warnings(plan)
    kept = extend_run(plan.options.out, plan.manifest)
    missing = len(plan.manifest.cells) * plan.manifest.episodes - kept
    print(f"{plan.options.out}: {kept} episodes are kept, {missing} are simulated", file=sys.stderr)
    return replace(plan, options=replace(plan.options, resume=True))


def _execute_part(plan: Plan, share: Share) -> int:
    """Simulate one part of a run, and write its episodes in a folder that the caller has locked; return the exit code.

    Args:
        plan: Checked options, policies and scenarios of the run.
        share: Episodes of the part.

    Returns:
        The exit code.

    Raises:
        KeyboardInterrupt: The user pressed Ctrl-C; the message has the command that continues the part.
    """
    out = plan.options.out
    if plan.options.resume and not is_unfinished(out):
        read_part(out)
        print(f"{out} holds the whole part: nothing is left to simulate", file=sys.stderr)
        return 0
    if not plan.options.resume:
        _print_warnings(plan)
    store = ChunkStore(out, plan.manifest, resumed=plan.options.resume)
    run, interrupted = _simulate(plan, store)
    if interrupted:
        raise KeyboardInterrupt(f"kept what was done to {out}; go on with: {_resume_command(out)}")
    with _explained_errors(store):
        write_part(run, out)
    remove_chunks(out)
    count = with_count(run.manifest.episode_count, "episode")
    print(f"part {share.part}: {count} in {out}; put all parts together: {PROGRAM} merge FOLDERS")
    return 0


def _print_warnings(plan: Plan) -> None:
    """Print warnings about an unfinished run in the results folder, and about policies that do not walk.

    Each external policy (trained elsewhere) is tested on short walks before the run starts.
    """
    out = plan.options.out
    if is_unfinished(out):
        print(f"{out} holds an unfinished run, which is replaced now; --resume would carry it on", file=sys.stderr)
    for labelled in plan.policies:
        with show_waiting(f"trying whether {labelled.label} stands and walks"):
            warning = diagnosis.warning(labelled.policy, plan.manifest.hardware.robot)
        lines = list(diagnosis.remarks(labelled.policy))
        if warning:
            lines.append(warning)
        for line in lines:
            print(f"warning: {labelled.label}: {line}", file=sys.stderr)


def _interrupt_message(plan: Plan, run: Run) -> str:
    """Return the message after Ctrl-C: saved part of the `run`, and the command that continues the run."""
    saved = "kept what was done"
    if run.cells:
        saved = f"wrote the {len(run.cells)} finished parts of {len(plan.manifest.cells)}"
        if run.manifest.is_unsettled:
            saved += f", of {run.manifest.episodes} episodes each,"
    return f"{saved} to {plan.options.out}; go on with: {_resume_command(plan.options.out)}"


def _simulate(plan: Plan, store: ChunkStore) -> tuple[Run, bool]:
    """Simulate every pair of policy and scenario, and store the results as they are finished.

    Args:
        plan: Checked options, policies and scenarios of the run.
        store: Store of finished chunks (subsets of episodes that are simulated together).

    Returns:
        run: Run with the finished results, in the order of the manifest.
        interrupted: True if the user pressed Ctrl-C.

    Raises:
        KeyboardInterrupt: The user pressed Ctrl-C before the first chunk was saved.
    """
    state = _RoundState(Run(store.manifest, ()))
    interrupted = False
    try:
        with _explained_errors(store):
            launcher.raise_on_interrupt()
            launcher.preallocate_blas_buffers()
            with Interrupt() as interrupt, _engine(plan, interrupt.check) as engine:
                _simulate_rounds(plan, store, interrupt, engine, state)
    except KeyboardInterrupt:
        if not store.begun:
            raise
        interrupted = True
    return state.run if state.run.cells else _run(store.manifest, state.finished), interrupted


@dataclass
class _RoundState:
    """Results of the rounds of a run so far. A run with a fixed number of episodes has one round."""

    run: Run
    """Results after the latest finished round; without results before the end of the first round."""
    finished: list[PolicyScenarioResult] = field(default_factory=list)
    """Finished results of the present round."""


def _simulate_rounds(
    plan: Plan, store: ChunkStore, interrupt: Interrupt, engine: "_Engine", state: _RoundState
) -> None:
    """Simulate one round after the other until the run ends, and store the results.

    Args:
        plan: Checked options, policies and scenarios of the run.
        store: Store of finished chunks (subsets of episodes that are simulated together).
        interrupt: Handler of Ctrl-C.
        engine: Processes that simulate.
        state: Results so far, which are updated.
    """
    rounds = RoundPlanner(store.manifest.minutes)
    while not state.run.complete:
        if state.run.cells:
            store.manifest = _next_round(state.run.manifest, rounds)
            state.finished = []
        rounds.start_round()
        is_first = not state.run.cells
        kept = 0 if is_first else state.run.manifest.episodes
        early = EarlyRanking(plan.policies) if store.manifest.minutes and is_first else None
        for cell in _cells(plan, store, interrupt, engine, kept):
            state.finished.append(cell)
            if early and (line := early.add(cell)):
                print(line, file=sys.stderr, flush=True)
        # The first round of a resumed run can have stored episodes, so its time says nothing about the next round.
        is_timed = not (is_first and plan.options.resume)
        rounds.finish_round(store.manifest.episodes - kept if is_timed else 0)
        state.run = _after_interim_analysis(_run(store.manifest, state.finished), store.folder, rounds)


def _next_round(manifest: Manifest, rounds: RoundPlanner) -> Manifest:
    """Return the `manifest` with the number of episodes after the next round, at most at the next analysis."""
    episodes = min(look for look in looks(manifest.limit) if look > manifest.episodes)
    if manifest.minutes:
        episodes = min(episodes, manifest.episodes + max(1, rounds.episodes_that_fit()))
    return replace(manifest, episodes=episodes)


@contextmanager
def _explained_errors(store: ChunkStore) -> Iterator[None]:
    """Provide a context that converts failures of memory, disk or a worker process to a UsageError.

    The message of the UsageError has the reason, and the command that continues the run in `store`. Other exceptions
    are raised unchanged.
    """
    try:
        yield
    except Exception as error:
        message = _error_message(error, store)
        if message is None:
            raise
        raise UsageError(message) from error


@dataclass(frozen=True)
class _Engine:
    """Processes that simulate the episodes of a run."""

    workers: int
    """Number of processes that simulate in parallel."""
    make_executor: Callable[[int, int], Executor]
    """Function that returns the executor.

    Its arguments are the maximum number of episodes in a batch of several policies, and the number of batches, the
    first ones, that have only one scenario each."""


@contextmanager
def _engine(plan: Plan, check: Callable[[], None]) -> Iterator[_Engine]:
    """Provide the processes that the options of a run select: workers of this machine, or of a Ray cluster.

    Args:
        plan: Checked options, policies and scenarios of the run.
        check: Function that is called repeatedly during the simulation; it raises an exception to end it.

    Yields:
        The engine.

    ClusterError is raised if the Ray cluster cannot be used.
    """
    threads = plan.options.threads
    if plan.options.ray is None:
        yield _Engine(threads, partial(process_pool, threads, check))
        return
    check_versions = VersionCheck(software_versions(), software_versions)
    with connect(parse_ray(plan.options.ray), threads, check_versions) as cluster:
        yield _Engine(cluster.cores, partial(cluster_executor, cluster, check))


def _cells(
    plan: Plan, store: ChunkStore, interrupt: Interrupt, engine: _Engine, kept: int
) -> Iterator[PolicyScenarioResult]:
    """Simulate all pairs of policy and scenario in the manifest of the store, and show the progress.

    Args:
        plan: Checked options, policies and scenarios of the run.
        store: Store of finished chunks (subsets of episodes that are simulated together).
        interrupt: Handler of Ctrl-C; the function checks it during the simulation.
        engine: Processes that simulate.
        kept: Number of episodes of each pair that earlier rounds have simulated.

    Yields:
        The result of each pair as soon as all of its episodes are finished.
    """
    manifest = store.manifest
    with show_progress(len(manifest.cells)) as progress:

        def report(policy: str, scenario: str, fraction: float) -> None:
            interrupt.check()
            progress(policy, scenario, fraction)

        # A run with a time limit shows a first ranking early.
        num_small = engine.workers if manifest.minutes and not kept else 0
        # The chunks (subsets of the episodes of a pair) are as large as the options allow, but small enough that every
        # worker process gets at least one chunk.
        missing = manifest.episode_count - kept * len(manifest.cells)
        episodes_per_worker = max(1, -(-missing // engine.workers))
        settings = RunSettings(
            nthread=engine.workers,
            progress=report,
            chunk_size=min(plan.options.at_once, episodes_per_worker),
            store=store,
            steps=manifest.steps,
            executor=engine.make_executor(_group_size(plan, engine.workers, missing), num_small),
            hardware=manifest.hardware,
            episode_indices={scenario.name: manifest.episode_indices(scenario.name) for scenario in plan.scenarios},
        )
        seeds = evaluation_seeds(manifest.seed, manifest.episodes)
        scenarios = [scenario for scenario in plan.scenarios if len(settings.episode_indices[scenario.name])]
        yield from run_cells(plan.policies, scenarios, seeds, settings)


def _group_size(plan: Plan, workers: int, missing: int) -> int:
    """Return the maximum number of episodes of several policies that are simulated in one batch.

    A large batch is fast. With several worker processes, batches are small enough that the processes end at about the
    same time.

    Args:
        plan: Checked options, policies and scenarios of the run.
        workers: Number of worker processes.
        missing: Number of episodes that the present round simulates.

    Returns:
        The number of episodes.
    """
    if workers == 1:
        return plan.options.at_once
    num_groups = workers * (GROUPS_PER_WORKER_IN_ROUND if plan.manifest.minutes else GROUPS_PER_WORKER)
    return min(plan.options.at_once, max(1, -(-missing // num_groups)))


def _run(manifest: Manifest, cells: Sequence[PolicyScenarioResult]) -> Run:
    """Return a run with the `manifest` and the finished results `cells`, in the order of the manifest."""
    return Run(manifest, tuple(sorted(cells, key=lambda cell: manifest.cells.index((cell.scenario, cell.policy)))))


def _after_interim_analysis(run: Run, folder: Path, rounds: RoundPlanner) -> Run:
    """Analyse a run with `--until settled` or a time limit, and decide if it ends; return any other run as is.

    This run adds episodes until adjacent policies of the ranking are distinguished. The function prints the tests of
    these policies, and stores the decision in the manifest.

    Args:
        run: Run in which every pair of policy and scenario has all episodes so far.
        folder: Results folder.
        rounds: Plan of the rounds of a run with a time limit.

    Returns:
        The run. If it has ended, its manifest contains the reason.
    """
    if not run.manifest.is_unsettled:
        return run
    manifest = run.manifest
    out_of_time = False
    if manifest.minutes:
        out_of_time = manifest.episodes < manifest.limit and rounds.episodes_that_fit() == 0
        line, ended = after_round(run.cells, manifest.limit, manifest.minutes, out_of_time=out_of_time)
    else:
        line, ended = interim_analysis(run.cells, manifest.limit)
    print(line, file=sys.stderr, flush=True)
    run = replace(run, manifest=replace(manifest, ended=ended, out_of_time=out_of_time))
    run.manifest.write(folder)
    return run


def _error_message(error: Exception, store: ChunkStore) -> str | None:
    """Return the message for the user about an error that ended a run.

    Args:
        error: Error that ended the run.
        store: Store of the run's finished episodes.

    Returns:
        Reason and remedy in one line; None for any other error, which is a programming error.
    """
    if launcher.is_out_of_memory(error):
        return f"{launcher.OUT_OF_MEMORY}; {_resume_hint(store)}"
    if isinstance(error, StoreError):
        return f"cannot write to {store.folder} ({error.strerror}); make room, then {_resume_hint(store)}"
    if isinstance(error, WorkerDiedError | OSError):
        return f"{format_os_error(error)}; {_resume_hint(store)}"
    return None


def _resume_hint(store: ChunkStore) -> str:
    """Return the remedy after a failed run: the command that continues it, or advice to start again.

    The advice to start again is returned if the `store` has no finished episodes yet.
    """
    return f"go on: {_resume_command(store.folder)}" if store.begun else "begin again, for nothing was done yet"


def _resume_command(out: Path) -> str:
    """Return the shell command that continues the run in the results folder `out`."""
    return f"{PROGRAM} --resume --out {shlex.quote(str(out))}"
