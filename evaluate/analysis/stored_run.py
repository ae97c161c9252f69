"""Analysis of a run that is stored in a results folder."""

from evaluate.analysis.results import Results, analyse
from evaluate.records.store import Run


def analyse_run(run: Run, baseline: str | None = None) -> Results:
    """Analyse the finished episodes of a run.

    Args:
        run: Finished or unfinished run.
        baseline: Name of the policy that all other policies are compared with; None for the default baseline.

    Returns:
        Results of the run, from which tables and files are made.
    """
    return analyse(
        run.cells,
        seed=run.manifest.seed,
        episodes=run.manifest.episodes,
        complete=run.complete,
        provenance=run.manifest.provenance(),
        baseline=baseline,
    )
