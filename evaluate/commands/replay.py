"""`python -m evaluate replay RESULTS EPISODE`: one episode of a results folder again, compared with what is stored."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

import policies
from evaluate.causes.story import story
from evaluate.commands.options import Flag
from evaluate.film import files
from evaluate.film.page import write_page
from evaluate.film.shooting import Look, Progress, Take, film
from evaluate.measures.episodes import Episodes
from evaluate.records import manifest as manifests
from evaluate.records.episode_table import by_cause_rule, by_energy_rule, by_success_rule, table
from evaluate.records.manifest import Manifest
from evaluate.records.store import Run, read_run
from evaluate.rollouts import rollout
from evaluate.rollouts.experiment import Cell, LabelledPolicy, labelled, measured
from evaluate.rollouts.hardware import check
from quad_env.cli.command_line import UsageError, make_folder_of
from quad_env.cli.progress import bar
from quad_env.scenarios.height_file import check_unchanged
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import HeightField

Write = Callable[[Take, Path, Progress], None]
DIFFERS = 1
"""Exit code where the episode did not come out as stored."""


@dataclass(frozen=True)
class Options:
    """Which episode, and whether to film it."""

    results: Annotated[Path, tyro.conf.Positional]
    """Folder of an evaluation, finished or not."""
    episode: Annotated[int, tyro.conf.Positional]
    """Row of episodes.parquet, counted from 0; with --policy or --scenario, the number in its column `episode`."""
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
class Found:
    """An episode of a cell."""

    cell: Cell
    number: int

    @property
    def seed(self) -> int:
        """Seed that starts it again."""
        return int(self.cell.seeds[self.number])

    @property
    def title(self) -> str:
        """How to call it."""
        return f"episode {self.number} of {self.cell.policy} on {self.cell.scenario.name}"

    @property
    def headline(self) -> str:
        """The same with its seed."""
        return f"{self.title}, seed {self.seed}"


def main(options: Options) -> int:
    """Run the command; the exit code: 0, or 1 if the episode is not the stored one. Raises UsageError."""
    run = read_run(options.results)
    found = find(run, options)
    check_here(run.manifest, found.cell.scenario)
    policy = policy_of(found.cell.policy, run.manifest, options.trust)
    written = _outputs(options)
    take = take_of(found, run.manifest, policy, *_against(options, run.manifest, found.cell.scenario))
    again, episodes = simulated_again(run.manifest, found, policy)
    differing = differences(run.manifest, found, again)
    causes = _causes(run.manifest, found, options.trust) if differing else []
    if not differing:
        print(f"{found.headline}: identical to the bit")
    else:
        print(f"{found.headline}, is not as stored:", *differing, sep="\n  ")
        print(f"because {'; '.join(causes) or 'of something that leaves no trace'}")
    print(*story(episodes, again.measures), sep="\n")
    for option, path, write in written:
        with bar("filming") as progress:
            try:
                write(take, path, progress)
            except OSError as error:
                raise UsageError(f"{option}: cannot write {path} ({error.strerror or error})") from error
        print(path)
    return DIFFERS if differing else 0


def _outputs(options: Options) -> list[tuple[str, Path, Write]]:
    """What is to be filmed: the option, the file and how it is written. Raises UsageError where it cannot be."""
    found = list[tuple[str, Path, Write]]()
    if options.video is not None:
        files.check(options.video)
        found.append(("--video", options.video, lambda take, *where: film(take, Look(), *where)))
    if options.page is not None:
        if options.page.suffix.lower() != ".html":
            raise UsageError(f"--page must end in .html, not {options.page.name!r}")
        make_folder_of(options.page, "--page")
        found.append(("--page", options.page, write_page))
    if options.against is not None and not found:
        raise UsageError("--against is shown by --page FILE.html or --video FILE: name one of them too")
    return found


def _against(options: Options, manifest: Manifest, scenario: Scenario) -> list[LabelledPolicy]:
    """The other policy, if there is one. Raises UsageError."""
    try:
        return [labelled(options.against, manifest.hardware, (scenario,), options.trust)] if options.against else []
    except policies.PolicyError as error:
        raise UsageError(f"--against: {error}") from error


def find(run: Run, options: Options) -> Found:
    """The episode that the options mean. Raises UsageError."""
    cells = run.cells
    if not cells:
        raise UsageError(f"{options.results} holds no finished part of a comparison yet")
    for name, wanted, names in (
        ("policy", options.policy, {cell.policy: None for cell in cells}),
        ("scenario", options.scenario, {cell.scenario.name: None for cell in cells}),
    ):
        if wanted is not None and wanted not in names:
            raise UsageError(f"--{name}: no {wanted} among the finished ones: {', '.join(names)}")
    if options.policy is None and options.scenario is None:
        return _row(cells, options.episode)
    chosen = [
        cell
        for cell in cells
        if options.policy in (None, cell.policy) and options.scenario in (None, cell.scenario.name)
    ]
    if len(chosen) != 1:
        missing = "--policy" if options.policy is None else "--scenario"
        raise UsageError(f"episode {options.episode} is in {len(chosen)} cells: name its {missing} too")
    if not 0 <= options.episode < chosen[0].episodes:
        raise UsageError(f"there are episodes 0 to {chosen[0].episodes - 1}, not {options.episode}")
    return Found(chosen[0], options.episode)


def _row(cells: tuple[Cell, ...], row: int) -> Found:
    """By the row of episodes.parquet, in which the cells follow each other."""
    left = row
    for cell in cells:
        if 0 <= left < cell.episodes:
            return Found(cell, left)
        left -= cell.episodes
    raise UsageError(f"there are rows 0 to {sum(cell.episodes for cell in cells) - 1}, not {row}")


def simulated_again(manifest: Manifest, found: Found, policy: LabelledPolicy) -> tuple[Cell, Episodes]:
    """The episode once more: what it measured, and its record."""
    scenario, seeds, hardware = found.cell.scenario, found.cell.seeds[[found.number]], manifest.hardware
    with bar("simulating") as progress:
        where = policy.on(scenario), scenario, seeds
        episodes = rollout.run(*where, steps=manifest.steps, progress=progress, hardware=hardware)
    return measured(policy.label, scenario, episodes), episodes


def differences(manifest: Manifest, found: Found, again: Cell) -> list[str]:
    """`velocity_error: 0.31 then, 0.32 now` for each column in which the episode is not the stored one."""
    numbers = np.array([found.number])
    rows = by_energy_rule(by_success_rule(table(found.cell), manifest.success_rule), manifest.energy_rule)
    rows = by_cause_rule(rows, manifest.versions.get("cause_rule"))
    then = rows.slice(found.number, 1).to_pylist()[0]
    now = table(again, numbers).to_pylist()[0]
    # Not ==, for which 0.0 and -0.0 are the same.
    return [f"{name}: {then[name]} then, {now[name]} now" for name in then if repr(then[name]) != repr(now[name])]


def _causes(then: Manifest, found: Found, trust: bool) -> list[str]:
    """What is known to be different now; of a policy that has not walked yet."""
    policies_now, scenarios = [policy_of(found.cell.policy, then, trust)], [found.cell.scenario]
    numbers = {"seed": then.seed, "episodes": then.episodes, "threads": 1}
    now = manifests.manifest(policies_now, scenarios, then.options, **numbers, hardware=then.hardware)
    return manifests.differences(then, replace(now, steps=then.steps))


def policy_of(label: str, manifest: Manifest, trust: bool) -> LabelledPolicy:
    """That policy of the run. Raises UsageError where it is not here."""
    try:
        return labelled(label, manifest.hardware, manifest.scenarios, trust, manifest.only_on.get(label, ()))
    except policies.PolicyError as error:
        raise UsageError(f"the policy of that episode is not here: {error}") from error


def check_here(manifest: Manifest, scenario: Scenario) -> None:
    """Raise UsageError where the simulator or the terrain is not here."""
    try:
        check(manifest.hardware, scenario)
        if isinstance(scenario.terrain, HeightField):
            check_unchanged(scenario.terrain.file, scenario.terrain.sha256)
    except ValueError as error:
        raise UsageError(f"that episode cannot be simulated here: {error}") from error


def take_of(found: Found, manifest: Manifest, *shown: LabelledPolicy) -> Take:
    """The episode as these policies have it, to be filmed."""
    return Take(shown, found.cell.scenario, found.seed, manifest.steps, found.headline, manifest.hardware)
