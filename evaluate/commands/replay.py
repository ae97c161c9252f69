"""`python -m evaluate replay RESULTS EPISODE`: one episode of a results folder again, compared with what is stored.

`python -m evaluate replay RESULTS --failed` lists the episodes that failed, with the row to replay and the cause.
"""

import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

import policies
from evaluate.causes.story import in_lines, timeline
from evaluate.cells import LabelledPolicy, PolicyScenarioResult, load_labelled_policy
from evaluate.commands.options import PROGRAM, Flag
from evaluate.film import files
from evaluate.film.page import write_page
from evaluate.film.shooting import FilmSpec, Progress, film
from evaluate.hardware import check_hardware
from evaluate.measures.episodes import Episodes
from evaluate.records import manifest as manifests
from evaluate.records.episode_table import table
from evaluate.records.manifest import Manifest
from evaluate.records.store import Run, read_run
from evaluate.rollouts import rollout
from evaluate.rollouts.run import measure_cell
from quad_env.cli.command_line import UsageError, make_folder_of
from quad_env.cli.format import ABSENT, with_count
from quad_env.cli.format import number as format_number
from quad_env.cli.progress import show_bar
from quad_env.files.text import one_line
from quad_env.scenarios.height_file import check_unchanged
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import HeightField

DIFFERS = 1
"""Exit code where the episode did not come out as stored."""


@dataclass(frozen=True)
class ReplayOptions:
    """Which episode, and whether to film it."""

    results: Annotated[Path, tyro.conf.Positional]
    """Folder of an evaluation, finished or not."""
    episode: Annotated[int | None, tyro.conf.Positional, tyro.conf.arg(metavar="EPISODE")] = None
    """Row of episodes.parquet, counted from 0; with --policy or --scenario, the number in its column `episode`."""
    failed: Flag = False
    """List the failed episodes instead, of a policy or scenario if one is named: row, time, outcome and cause."""
    policy: str | None = None
    """Policy whose episode it is; may be left out where there is only one."""
    scenario: str | None = None
    """Scenario whose episode it is; may be left out where there is only one."""
    trust: Flag = False
    """Load policies from files that can hide code, the .zip files of Stable-Baselines3."""
    video: Path | None = None
    """Film to write, in real time: .mp4 (needs imageio-ffmpeg), .webp, .gif, or .png for a strip of frames."""
    page: Path | None = None
    """Page to write: film and curves of the episode under one cursor, in one .html file that opens offline."""
    against: str | None = None
    """Another policy, by name or path, that the film or the page shows on the same seed next to it."""


@dataclass(frozen=True)
class ReplayTarget:
    """An episode of a cell."""

    cell: PolicyScenarioResult
    number: int

    @property
    def seed(self) -> int:
        """Seed that starts it again."""
        return int(self.cell.seeds[self.number])

    @property
    def title(self) -> str:
        """How to call it."""
        return f"episode {self.number} of {self.cell.policy} on {self.cell.scenario.name}, seed {self.seed}"

    def take(self, manifest: Manifest, *shown: LabelledPolicy) -> FilmSpec:
        """The episode as these policies have it, to be filmed."""
        return FilmSpec(shown, self.cell.scenario, self.seed, manifest.steps, self.title, manifest.hardware)


def main(options: ReplayOptions) -> int:
    """Run the command; the exit code: 0, or 1 if the episode is not the stored one. Raises UsageError."""
    run = read_run(options.results)
    if options.failed:
        return _list_failed(run, options)
    if options.episode is None:
        raise UsageError(f"EPISODE: no row given; `{PROGRAM} replay {options.results} --failed` lists failed episodes")
    found = find(run, options, options.episode)
    check_here(run.manifest, found.cell.scenario)
    policy = policy_of(found.cell.policy, run.manifest, options.trust)
    others = [] if options.against is None else [policy_of(options.against, run.manifest, options.trust, "--against")]
    outputs = _outputs(options)
    again, episodes = resimulate(run.manifest, found, policy)
    differing = differences(run, found, again)
    causes = _causes(run.manifest, found, options.trust) if differing else []
    if not differing:
        print(f"{found.title}: identical to the bit")
    else:
        print(f"{found.title}, is not as stored:", *differing, sep="\n  ")
        print(f"because {'; '.join(causes) or 'of something that leaves no trace'}")
    print(*in_lines(timeline(episodes, again.measures)), sep="\n")
    for option, path, write in outputs:
        with show_bar("filming") as progress:
            try:
                write(found.take(run.manifest, policy, *others), path, progress)
            except OSError as error:
                raise UsageError(f"{option}: cannot write {path} ({error.strerror or error})") from error
        print(path)
    return DIFFERS if differing else 0


def _outputs(options: ReplayOptions) -> list[tuple[str, Path, Callable[[FilmSpec, Path, Progress], None]]]:
    """Option, file and what writes it of all that is to be filmed. Raises UsageError where it cannot be."""
    if options.video is not None:
        files.check_film_path(options.video)
    if options.page is not None:
        if options.page.suffix.lower() != ".html":
            raise UsageError(f"--page must end in .html, not {options.page.name!r}")
        make_folder_of(options.page, "--page")
    if options.against is not None and options.page is None and options.video is None:
        raise UsageError("--against is shown by --page FILE.html or --video FILE: name one of them too")
    found = (("--video", options.video, film), ("--page", options.page, write_page))
    return [(option, path, write) for option, path, write in found if path is not None]


def _list_failed(run: Run, options: ReplayOptions) -> int:
    """Print a line for each failed episode of policy and scenario; return the exit code. Raises UsageError."""
    if options.episode is not None or any((options.video, options.page, options.against)):
        raise UsageError("--failed lists episodes: leave out EPISODE, --video, --page and --against")
    _check_names(run, options)
    rows = list[tuple[str, ...]]()
    first = 0
    for cell in run.cells:
        if options.policy in (None, cell.policy) and options.scenario in (None, cell.scenario.name):
            rows += [
                _failed_row(cell, number, first + number)
                for number in np.flatnonzero(~cell.measures.succeeded).tolist()
            ]
        first += cell.episodes
    heads = ("row", "policy", "scenario", "episode", "time, s", "outcome", "cause")
    widths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)]
    for row in (heads, *rows):
        print("  ".join(word.ljust(width) for word, width in zip(row, widths, strict=True)).rstrip())
    see = ""
    if rows:
        first_failed = rows[0][0]
        replay = f"{PROGRAM} replay {shlex.quote(str(options.results))}"
        see = f"; see one: {replay} {first_failed} --page {first_failed}.html"
    print(f"{with_count(len(rows), 'failed episode')}{see}")
    return 0


def _failed_row(cell: PolicyScenarioResult, number: int, row: int) -> tuple[str, ...]:
    """Return the words on a failed episode; the time is that of its fall or, upright, of its cause."""
    measures = cell.measures
    time = float(measures.fall_time[number] if measures.fell[number] else measures.cause_time[number])
    outcome = str(measures.outcome[number]).replace("_", " ")
    cause = cell.failure[number] or str(measures.cause[number] or ABSENT).replace("_", " ")
    place = str(row), cell.policy, cell.scenario.name, str(number)
    return (*place, format_number(time, 2), outcome, one_line(str(cause)))


def _check_names(run: Run, options: ReplayOptions) -> None:
    """Raise UsageError where the policy or the scenario of the options has no finished episode."""
    if not run.cells:
        raise UsageError(f"{options.results} holds no finished part of a comparison yet")
    for option, wanted, names in (
        ("policy", options.policy, [cell.policy for cell in run.cells]),
        ("scenario", options.scenario, [cell.scenario.name for cell in run.cells]),
    ):
        if wanted not in (None, *names):
            raise UsageError(f"--{option}: no {wanted} among the finished ones: {', '.join(dict.fromkeys(names))}")


def find(run: Run, options: ReplayOptions, episode: int) -> ReplayTarget:
    """Return the episode that the options select. Raises UsageError.

    Args:
        run: Results folder.
        options: Policy and scenario, or None for any.
        episode: Row among the selected episodes, from 0.
    """
    _check_names(run, options)
    policy, scenario = options.policy, options.scenario
    chosen = [cell for cell in run.cells if policy in (None, cell.policy) and scenario in (None, cell.scenario.name)]
    if (named := (policy, scenario) != (None, None)) and len(chosen) != 1:
        missing = "--policy" if policy is None else "--scenario"
        raise UsageError(f"episode {episode} is in {len(chosen)} cells: name its {missing} too")
    episodes = [ReplayTarget(cell, number) for cell in chosen for number in range(cell.episodes)]
    if not 0 <= episode < len(episodes):
        what = "episodes" if named else "rows"
        raise UsageError(f"there are {what} 0 to {len(episodes) - 1}, not {episode}")
    return episodes[episode]


def resimulate(
    manifest: Manifest, found: ReplayTarget, policy: LabelledPolicy
) -> tuple[PolicyScenarioResult, Episodes]:
    """The episode once more: what it measured, and its record."""
    scenario, seeds, hardware = found.cell.scenario, found.cell.seeds[[found.number]], manifest.hardware
    with show_bar("simulating", in_lines=False) as progress:  # takes 1 to 2 s
        where = policy.policy_for(scenario), scenario, seeds
        episodes = rollout.run(*where, steps=manifest.steps, progress=progress, hardware=hardware)
    return measure_cell(policy.label, scenario, episodes), episodes


def differences(run: Run, found: ReplayTarget, again: PolicyScenarioResult) -> list[str]:
    """Return a line such as `velocity_error: 0.31 then, 0.32 now` for each measure of the run that is not as stored.

    Args:
        run: Results folder; measures that it lacks are not compared.
        found: Stored episode.
        again: The episode simulated again.

    Returns:
        Lines in the order of the columns.
    """
    numbers = np.array([found.number])
    then = table(found.cell).slice(found.number, 1).to_pylist()[0]
    now = table(again, numbers).to_pylist()[0]
    # Not ==, for which 0.0 and -0.0 are the same.
    names = [name for name in then if name not in run.missing_measures]
    return [f"{name}: {then[name]} then, {now[name]} now" for name in names if repr(then[name]) != repr(now[name])]


def _causes(then: Manifest, found: ReplayTarget, trust: bool) -> list[str]:
    """What is known to be different now; of a policy that has not walked yet."""
    policies_now, scenarios = [policy_of(found.cell.policy, then, trust)], [found.cell.scenario]
    numbers = {"seed": then.seed, "episodes": then.episodes, "steps": then.steps, "threads": 1}
    now = manifests.manifest(policies_now, scenarios, then.options, **numbers, hardware=then.hardware)
    return manifests.differences(then, now)


def policy_of(
    label: str, manifest: Manifest, trust: bool, complaint: str = "the policy of that episode is not here"
) -> LabelledPolicy:
    """That policy for the scenarios of the run. Raises UsageError where it is not here."""
    try:
        return load_labelled_policy(
            label, manifest.hardware, manifest.scenarios, trust, manifest.only_on.get(label, ())
        )
    except policies.PolicyError as error:
        raise UsageError(f"{complaint}: {error}") from error


def check_here(manifest: Manifest, scenario: Scenario) -> None:
    """Raise UsageError where the simulator or the terrain is not here."""
    try:
        check_hardware(manifest.hardware, scenario)
        if isinstance(scenario.terrain, HeightField):
            check_unchanged(scenario.terrain.file, scenario.terrain.sha256)
    except ValueError as error:
        raise UsageError(f"that episode cannot be simulated here: {error}") from error
