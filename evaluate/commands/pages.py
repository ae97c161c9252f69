"""Pages of the failures that a report names, in the folder of its run: each whole or not at all."""

from collections.abc import Sized
from pathlib import Path

from evaluate.analysis.failures import PAGES_FOLDER, select_failures
from evaluate.commands.outputs import analyse_run
from evaluate.commands.replay import ReplayTarget, check_here, policy_of
from evaluate.film.page import partial_progress, write_page
from evaluate.records.store import Run
from quad_env.cli.command_line import UsageError, make_folder_of
from quad_env.cli.progress import show_bar


def make_pages(run: Run, folder: Path, trust: bool) -> None:
    """Simulate and film the failures that have no page yet. Raises UsageError, all but a full disk before anything is
    simulated, and after Ctrl-C a KeyboardInterrupt that says what is kept."""
    if not run.complete:
        raise UsageError(f"--pages: {folder} holds an unfinished run; carry it on with --resume")
    results, cells = analyse_run(run), {(cell.policy, cell.scenario.name): cell for cell in run.cells}
    wanted = {
        folder / PAGES_FOLDER / each.page: ReplayTarget(cells[each.policy, each.scenario], each.number)
        for _, each in select_failures(results)
    }
    left = {path: each for path, each in wanted.items() if not path.is_file()}
    policies = {each.cell.policy: policy_of(each.cell.policy, run.manifest, trust) for each in left.values()}
    for path, each in left.items():
        check_here(run.manifest, each.cell.scenario)
        make_folder_of(path, "--pages")
    done = len(wanted) - len(left)
    try:
        with show_bar("pages") as progress:
            for path, each in left.items():
                take = each.take(run.manifest, policies[each.cell.policy])
                write_page(take, path, partial_progress(progress, done, len(wanted)))
                done += 1
    except OSError as error:
        raise UsageError(f"--pages: cannot write {path} ({error.strerror or error}); {_kept(done, wanted)}") from error
    except KeyboardInterrupt:
        raise KeyboardInterrupt(_kept(done, wanted)) from None


def _kept(done: int, wanted: Sized) -> str:
    return f"{done} of {len(wanted)} pages are there, and the same command goes on"
