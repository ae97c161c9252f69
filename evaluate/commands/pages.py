"""HTML pages with films of failed episodes, to which a report links; made by `report --pages`."""

from collections.abc import Sized
from pathlib import Path

from evaluate.analysis.failures import PAGES_FOLDER, select_failures
from evaluate.analysis.stored_run import analyse_run
from evaluate.commands.replay import ReplayTarget, check_available, load_policy
from evaluate.film.page import partial_progress, write_page
from evaluate.records.store import Run
from quad_env.cli.command_line import UsageError, make_folder_of
from quad_env.cli.progress import show_bar


def make_pages(run: Run, folder: Path, trust: bool) -> None:
    """Simulate and film the failed episodes that the report lists, if they have no page yet.

    Args:
        run: Finished run.
        folder: Results folder of the run.
        trust: True to load policies from files that can hide code.

    Raises:
        UsageError: The run is not finished, a policy or a scenario cannot be loaded, or a page cannot be written. Only
            the last error can occur after the simulation has started.
        KeyboardInterrupt: The user pressed Ctrl-C; the message has the number of written pages.
    """
    if not run.complete:
        raise UsageError(f"--pages: {folder} holds an unfinished run; carry it on with --resume")
    cells = {(cell.policy, cell.scenario.name): cell for cell in run.cells}
    targets = {
        folder / PAGES_FOLDER / failure.page: ReplayTarget(cells[failure.policy, failure.scenario], failure.number)
        for _, failure in select_failures(analyse_run(run))
    }
    missing = {path: target for path, target in targets.items() if not path.is_file()}
    labels = [target.cell.policy for target in missing.values()]
    policies = {label: load_policy(label, run.manifest, trust) for label in labels}
    for path, target in missing.items():
        check_available(run.manifest, target.cell.scenario)
        make_folder_of(path, "--pages")
    done = len(targets) - len(missing)
    try:
        with show_bar("pages") as progress:
            for path, target in missing.items():
                spec = target.film_spec(run.manifest, policies[target.cell.policy])
                write_page(spec, path, partial_progress(progress, done, len(targets)))
                done += 1
    except OSError as error:
        raise UsageError(f"--pages: cannot write {path} ({error.strerror or error}); {_kept(done, targets)}") from error
    except KeyboardInterrupt:
        raise KeyboardInterrupt(_kept(done, targets)) from None


def _kept(done: int, targets: Sized) -> str:
    """Return the message after Ctrl-C: `done` pages of all requested pages, `targets`, are finished."""
    return f"{done} of {len(targets)} pages are there, and the same command goes on"
