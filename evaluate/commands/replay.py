"""`python -m evaluate replay RESULTS EPISODE`: simulate a stored episode again and compare.

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
"""Exit code of the command `replay` if the repeated simulation differs from the stored episode."""


Output = tuple[str, Path, Callable[[FilmSpec, Path, Progress], None]]
"""Output of the command `replay`, a film or an HTML page: command-line option, file path, and write function.

The write function receives the episode to film, the path, and a progress function.
"""


@dataclass(frozen=True)
class ReplayOptions:
    """Options of the command: the episode to simulate again, and the films or pages to write."""

    results: Annotated[Path, tyro.conf.Positional]
    """Folder of an evaluation, finished or not."""
    episode: Annotated[int | None, tyro.conf.Positional, tyro.conf.arg(metavar="EPISODE")] = None
    """Row of episodes.parquet, counted from 0; with --policy or --scenario, the number in its column `episode`."""
    failed: Flag = False
    """Only list failed episodes, of a policy or scenario if one is named: row, time, outcome and cause."""
    policy: str | None = None
    """Policy of the episode; may be left out if there is only one."""
    scenario: str | None = None
    """Scenario of the episode; may be left out if there is only one."""
    trust: Flag = False
    """Load policies from files that can hide code, the .zip files of Stable-Baselines3."""
    video: Path | None = None
    """Film to write, in real time: .mp4 (needs imageio-ffmpeg), .webp, .gif, or .png for a strip of frames."""
    page: Path | None = None
    """HTML page to write: film and curves of the episode with a common time cursor, in one file that works offline."""
    against: str | None = None
    """Another policy, by name or path; the film or page shows it on the same seed, next to the stored policy."""


@dataclass(frozen=True)
class ReplayTarget:
    """Stored episode to simulate again: result of its policy on its scenario, and index in this result."""

    cell: PolicyScenarioResult
    number: int
    """Index of the episode among the episodes of the policy on the scenario."""

    @property
    def seed(self) -> int:
        """Seed of the episode."""
        return int(self.cell.seeds[self.number])

    @property
    def title(self) -> str:
        """Title of the episode in tables and films: index, policy, scenario and seed."""
        return f"episode {self.number} of {self.cell.policy} on {self.cell.scenario.name}, seed {self.seed}"

    def film_spec(self, manifest: Manifest, *policies: LabelledPolicy) -> FilmSpec:
        """Return the specification of a film of this episode.

        Args:
            manifest: Manifest (inputs) of the run that contains the episode.
            *policies: Policies to show next to each other, each in the same episode.

        Returns:
            Policies, scenario, seed and title of the film.
        """
        return FilmSpec(policies, self.cell.scenario, self.seed, manifest.steps, self.title, manifest.hardware)


def main(options: ReplayOptions) -> int:
    """Simulate the episode in the `options` again, or list failed episodes; return the exit code.

    The exit code is 0, or DIFFERS (1) if the repeated simulation differs from the stored episode.
    """
    run = read_run(options.results)
    if options.failed:
        return _list_failed(run, options)
    if options.episode is None:
        raise UsageError(f"EPISODE: no row given; `{PROGRAM} replay {options.results} --failed` lists failed episodes")
    target = find(run, options, options.episode)
    check_available(run.manifest, target.cell.scenario)
    shown = [load_policy(target.cell.policy, run.manifest, options.trust)]
    if options.against is not None:
        shown.append(load_policy(options.against, run.manifest, options.trust, "--against"))
    outputs = _outputs(options)
    result, episodes = resimulate(run.manifest, target, shown[0])
    changed = differences(run, target, result)
    if changed:
        causes = _causes(run.manifest, target, options.trust)
        print(f"{target.title}, is not as stored:", *changed, sep="\n  ")
        print(f"because {'; '.join(causes) or 'of something that leaves no trace'}")
    else:
        print(f"{target.title}: identical to the bit")
    print(*in_lines(timeline(episodes, result.measures)), sep="\n")
    _write_outputs(outputs, target.film_spec(run.manifest, *shown))
    return DIFFERS if changed else 0


def _write_outputs(outputs: list[Output], spec: FilmSpec) -> None:
    """Film an episode, write each requested film or page, and print the path of each file.

    Args:
        outputs: Films and pages to write.
        spec: Episode to film.

    Raises:
        UsageError: A file cannot be written.
    """
    for option, path, write in outputs:
        with show_bar("filming") as progress:
            try:
                write(spec, path, progress)
            except OSError as error:
                raise UsageError(f"{option}: cannot write {path} ({error.strerror or error})") from error
        print(path)


def _outputs(options: ReplayOptions) -> list[Output]:
    """Return the films and HTML pages that the `options` request; raise UsageError if a path is not valid."""
    if options.video is not None:
        files.check_film_path(options.video)
    if options.page is not None:
        if options.page.suffix.lower() != ".html":
            raise UsageError(f"--page must end in .html, not {options.page.name!r}")
        make_folder_of(options.page, "--page")
    if options.against is not None and options.page is None and options.video is None:
        raise UsageError("--against is shown by --page FILE.html or --video FILE: name one of them too")
    candidates = (("--video", options.video, film), ("--page", options.page, write_page))
    return [(option, path, write) for option, path, write in candidates if path is not None]


def _list_failed(run: Run, options: ReplayOptions) -> int:
    """Print a line for each failed episode of the selected policies and scenarios; return the exit code.

    Args:
        run: Run in the results folder.
        options: Options with the names of the policy and the scenario; all are selected if a name is None.

    Returns:
        The exit code, 0.

    Raises:
        UsageError: The options also select an episode, a film or a page.
    """
    if options.episode is not None or any((options.video, options.page, options.against)):
        raise UsageError("--failed lists episodes: leave out EPISODE, --video, --page and --against")
    _check_names(run, options)
    rows: list[tuple[str, ...]] = []
    first = 0
    for cell in run.cells:
        if options.policy in (None, cell.policy) and options.scenario in (None, cell.scenario.name):
            failed = np.flatnonzero(~cell.measures.succeeded).tolist()
            rows += [_failed_row(cell, number, first + number) for number in failed]
        first += cell.episodes
    heads = ("row", "policy", "scenario", "episode", "time, s", "outcome", "cause")
    widths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)]
    for row in (heads, *rows):
        print("  ".join(word.ljust(width) for word, width in zip(row, widths, strict=True)).rstrip())
    hint = ""
    if rows:
        row_number = rows[0][0]
        replay = f"{PROGRAM} replay {shlex.quote(str(options.results))}"
        hint = f"; see one: {replay} {row_number} --page {row_number}.html"
    print(f"{with_count(len(rows), 'failed episode')}{hint}")
    return 0


def _failed_row(cell: PolicyScenarioResult, number: int, row: int) -> tuple[str, ...]:
    """Return the row of a failed episode in the printed table: a text for each column.

    Args:
        cell: Result of the policy on the scenario that contains the episode.
        number: Index of the episode in this result.
        row: Row index of the episode in episodes.parquet.

    Returns:
        Texts of the columns. The column of the time has the time of the fall. If the robot did not fall, it has the
        time at which the cause of the failure began.
    """
    measures = cell.measures
    time = float(measures.fall_time[number] if measures.fell[number] else measures.cause_time[number])
    outcome = str(measures.outcome[number]).replace("_", " ")
    cause = cell.failure[number] or str(measures.cause[number] or ABSENT).replace("_", " ")
    episode = (str(row), cell.policy, cell.scenario.name, str(number))
    return (*episode, format_number(time, 2), outcome, one_line(str(cause)))


def _check_names(run: Run, options: ReplayOptions) -> None:
    """Raise UsageError if the policy or the scenario in the `options` has no finished episode in the run."""
    if not run.cells:
        raise UsageError(f"{options.results} holds no finished part of a comparison yet")
    for option, name, valid in (
        ("policy", options.policy, [cell.policy for cell in run.cells]),
        ("scenario", options.scenario, [cell.scenario.name for cell in run.cells]),
    ):
        if name not in (None, *valid):
            raise UsageError(f"--{option}: no {name} among the finished ones: {', '.join(dict.fromkeys(valid))}")


def find(run: Run, options: ReplayOptions, episode: int) -> ReplayTarget:
    """Return the stored episode that the options select.

    Args:
        run: Run in the results folder.
        options: Options with the names of the policy and the scenario; a name is None if it is not selected.
        episode: Index among the episodes of the selected policy and scenario. If neither is selected, index among all
            episodes, which is the row in episodes.parquet.

    Returns:
        The selected episode.

    Raises:
        UsageError: The index is out of range, or the options select only a policy or only a scenario and this is
            ambiguous.
    """
    _check_names(run, options)
    policy = options.policy
    scenario = options.scenario
    cells = [cell for cell in run.cells if policy in (None, cell.policy) and scenario in (None, cell.scenario.name)]
    is_named = policy is not None or scenario is not None
    if is_named and len(cells) != 1:
        missing = "--policy" if policy is None else "--scenario"
        raise UsageError(f"episode {episode} is in {len(cells)} cells: name its {missing} too")
    episodes = [ReplayTarget(cell, number) for cell in cells for number in range(cell.episodes)]
    if not 0 <= episode < len(episodes):
        unit = "episodes" if is_named else "rows"
        raise UsageError(f"there are {unit} 0 to {len(episodes) - 1}, not {episode}")
    return episodes[episode]


def resimulate(
    manifest: Manifest, target: ReplayTarget, policy: LabelledPolicy
) -> tuple[PolicyScenarioResult, Episodes]:
    """Simulate a stored episode again.

    Args:
        manifest: Manifest (inputs) of the run that contains the episode.
        target: Stored episode.
        policy: Policy that controls the robot in the episode.

    Returns:
        result: Measures of the repeated episode.
        episodes: Recorded signals of the repeated episode.
    """
    scenario = target.cell.scenario
    # No progress lines are printed, because the simulation takes only 1 to 2 s.
    with show_bar("simulating", in_lines=False) as progress:
        episodes = rollout.run(
            policy.policy_for(scenario),
            scenario,
            target.cell.seeds[[target.number]],
            steps=manifest.steps,
            progress=progress,
            hardware=manifest.hardware,
        )
    return measure_cell(policy.label, scenario, episodes), episodes


def differences(run: Run, target: ReplayTarget, result: PolicyScenarioResult) -> list[str]:
    """Compare the measures of a stored episode with the measures of its repetition.

    Args:
        run: Run in the results folder. A measure is not compared if the file of the run lacks it, or if its extension
            is not installed.
        target: Stored episode.
        result: Measures of the episode that was simulated again.

    Returns:
        A line for each measure that differs, for example `velocity_error: 0.31 then, 0.32 now`.
    """
    then = table(target.cell).slice(target.number, 1).to_pylist()[0]
    now = table(result, np.array([target.number])).to_pylist()[0]
    names = [name for name in then if name in now and name not in run.missing_measures]
    # Texts are compared, because 0.0 == -0.0 would hide a difference in the sign bit.
    return [f"{name}: {then[name]} then, {now[name]} now" for name in names if repr(then[name]) != repr(now[name])]


def _causes(then: Manifest, target: ReplayTarget, trust: bool) -> list[str]:
    """Describe the inputs of a stored episode that have changed since its run, for example the code.

    Args:
        then: Manifest (inputs) of the stored run.
        target: Stored episode.
        trust: True to load policies from files that can contain hidden code.

    Returns:
        A text for each changed input.
    """
    now = manifests.manifest(
        [load_policy(target.cell.policy, then, trust)],
        [target.cell.scenario],
        then.options,
        seed=then.seed,
        episodes=then.episodes,
        steps=then.steps,
        threads=1,
        hardware=then.hardware,
    )
    return manifests.differences(then, now)


def load_policy(
    label: str, manifest: Manifest, trust: bool, complaint: str = "the policy of that episode is not here"
) -> LabelledPolicy:
    """Load a policy for the scenarios of a stored run.

    Args:
        label: Name or path of the policy.
        manifest: Manifest (inputs) of the run, which contains hardware and scenarios.
        trust: True to load policies from files that can contain hidden code.
        complaint: First words of the error message.

    Returns:
        The policy with its label.

    Raises:
        UsageError: The policy cannot be loaded.
    """
    try:
        return load_labelled_policy(
            label, manifest.hardware, manifest.scenarios, trust, manifest.only_on.get(label, ())
        )
    except policies.PolicyError as error:
        raise UsageError(f"{complaint}: {error}") from error


def check_available(manifest: Manifest, scenario: Scenario) -> None:
    """Check that a stored episode can be simulated on this machine.

    Args:
        manifest: Manifest (inputs) of the run that contains the episode, with the hardware of the robots.
        scenario: Scenario of the episode.

    Raises:
        UsageError: The hardware or the terrain file of the scenario is missing or has changed.
    """
    try:
        check_hardware(manifest.hardware, scenario)
        if isinstance(scenario.terrain, HeightField):
            check_unchanged(scenario.terrain.file, scenario.terrain.sha256)
    except ValueError as error:
        raise UsageError(f"that episode cannot be simulated here: {error}") from error
