"""Test of the README's code block for Stable-Baselines3 (SB3): `python -m research sb3-block`.

The command runs the code block once for each training seed, which replaces the seed in the line `seed = 0`. Then it
evaluates the trained models, and a standing robot for comparison, on the episodes of `python -m evaluate`. Training
does not use these episodes.
"""

import contextlib
import hashlib
import json
import re
import runpy
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import policies
from evaluate.measures.metrics import measure
from evaluate.measures.outcomes import SUCCESS_RULE
from evaluate.records.provenance import versions
from evaluate.rollouts.rollout import run
from evaluate.statistics.intervals import wilson_interval
from quad_env.cli.command_line import UsageError, check_numbers
from quad_env.cli.format import number, share
from quad_env.files.writing import make_writable_folder, write_atomically
from quad_env.scenarios.registry import scenario
from quad_env.seeding import episode_seeds
from research.pages import markdown
from research.pages.blocks import insert_block, read_page

PLACE = "sb3"
"""Name of the part of the README into which the command `sb3-block` writes the results of its models.

The part is between the lines `<!-- sb3 -->` and `<!-- /sb3 -->`.
"""
SEED_LINE = "seed = 0\n"
"""Line of the README's code block that sets the training seed."""
LEARN = re.compile(r"\.learn\(([\d_]+)\)")
"""Pattern of the call `.learn(STEPS)` in the README's code block, with the number of training steps."""
MODEL = "mine.zip"
"""Name of the model file that the README's code block writes."""
SCRIPT = "block.py"
"""Name of the script with the code block of one seed, in the seed's folder."""
TRAINED = "training.json"
"""Name of the file with seed and processor time of a finished training, in the seed's folder."""
STANDING = "stand"
"""Name of the policy for comparison, with which the robot stands."""
SCENARIOS = "flat=1", "flat"
"""Scenarios of the evaluation: the training scenario, and flat ground with commands up to 1.5 m/s."""


@dataclass(frozen=True)
class SB3BlockOptions:
    """Options of the command `sb3-block`: seeds, episodes and files."""

    seeds: tuple[int, ...] = (0, 1, 2, 3, 4)
    """Training seeds; one model is trained with each seed."""
    episodes: int = 96
    """Number of evaluation episodes of 10 s for each policy and scenario."""
    evaluation_seed: int = 1
    """Seed of the evaluation episodes, >= 0, as `--seed` of `python -m evaluate`."""
    purpose: Literal["evaluation", "search"] = "evaluation"
    """Kind of the episodes: evaluation, held out from every choice; search, to choose the settings of the block."""
    page: Path = Path("README.md")
    """Page with the code block; results are written between `<!-- sb3 -->` and `<!-- /sb3 -->`."""
    record: Path = Path("docs/results/sb3_block.json")
    """JSON file for the results; an existing file is replaced."""
    out: Path = Path("results/sb3_block")
    """Folder for the trained models, with one folder for each seed."""


def main(options: SB3BlockOptions) -> int:
    """Run the command `sb3-block`: train and evaluate the models, and write JSON file and page.

    Args:
        options: Options of the command.

    Returns:
        Exit code of the process.

    Raises:
        UsageError: An option is invalid, or the page has no valid code block.
    """
    check_numbers(options, {"episodes": (1, 1_000_000), "evaluation_seed": (0, 2**63 - 1)})
    if len(set(options.seeds)) < max(len(options.seeds), 1) or min(options.seeds) < 0:
        raise UsageError(f"--seeds: whole numbers from 0, none twice, at least one; got {options.seeds}")
    text = read_page(options.page, PLACE)
    block = find_block(text)
    trained = [train(block, seed, options.out / f"seed-{seed}") for seed in options.seeds]
    record = {
        "block_sha256": block_digest(block),
        "steps": training_steps(block),
        "episodes": options.episodes,
        "evaluation_seed": options.evaluation_seed,
        "purpose": options.purpose,
        "success_rule": SUCCESS_RULE,
        "versions": {name: versions()[name] for name in ("python", "mujoco", "numpy", "gymnasium")},
        "standing": evaluate(STANDING, options.purpose, options.evaluation_seed, options.episodes),
        "seeds": trained,
    }
    for entry in trained:
        model = options.out / f"seed-{entry['seed']}" / MODEL
        entry["scenarios"] = evaluate(str(model), options.purpose, options.evaluation_seed, options.episodes)
        print(entry, flush=True)
    write_atomically(options.record, (json.dumps(record, indent=2) + "\n").encode())
    lines = markdown_lines(record)
    write_atomically(options.page, insert_block(text, lines, PLACE).encode())
    print("\n".join(lines))
    return 0


def find_block(text: str) -> str:
    """Find the Python code block of a page that trains with Stable-Baselines3.

    Args:
        text: Text of the page, Markdown.

    Returns:
        Source code of the block.

    Raises:
        UsageError: The page does not have exactly one block of this kind, or the block does not have exactly one line
            with the seed and one call of `learn`.
    """
    python_blocks = re.findall(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    blocks = [block for block in python_blocks if "stable_baselines3" in block]
    if len(blocks) != 1 or blocks[0].count(SEED_LINE) != 1 or len(LEARN.findall(blocks[0])) != 1:
        raise UsageError(
            f"the page needs one block with stable_baselines3, one line {SEED_LINE.strip()!r} and one .learn(STEPS), "
            f"got {len(blocks)} blocks"
        )
    return str(blocks[0])


def training_steps(block: str) -> int:
    """Return the number of training steps in the source code of the README's code block."""
    return int(LEARN.findall(block)[0].replace("_", ""))


def block_digest(block: str) -> str:
    """Return the SHA-256 hash of the code block, hexadecimal.

    The hash is stored with the results, so that a later change of the code block can be detected.
    """
    return hashlib.sha256(block.encode()).hexdigest()


def train(block: str, seed: int, folder: Path) -> dict[str, Any]:
    """Run the README's code block, which trains a model, with a given seed in a given folder.

    A training of the same block and seed that has finished in the folder is not repeated.

    Args:
        block: Source code of the block.
        seed: Training seed, which replaces 0 in the line `seed = 0`.
        folder: Working folder of the code; it is created if it is missing.

    Returns:
        Dictionary: `seed`, training seed; `minutes`, processor time of the training, min.
    """
    make_writable_folder(folder)
    script = folder / SCRIPT
    code = block.replace(SEED_LINE, f"seed = {seed}\n").encode()
    if (finished := _finished_training(folder, code)) is not None:
        print(f"seed {seed}: {folder / MODEL} is of this block and is not trained again", flush=True)
        return finished
    (folder / TRAINED).unlink(missing_ok=True)
    write_atomically(script, code)
    begin = time.process_time()
    with contextlib.chdir(folder):
        runpy.run_path(script.name, run_name="__main__")
    entry = {"seed": seed, "minutes": round((time.process_time() - begin) / 60.0, 2)}
    write_atomically(folder / TRAINED, (json.dumps(entry) + "\n").encode())
    return entry


def _finished_training(folder: Path, code: bytes) -> dict[str, Any] | None:
    """Return seed and processor time of the finished training of the script `code` in `folder`; None without one."""
    files = folder / SCRIPT, folder / MODEL, folder / TRAINED
    if not all(file.is_file() for file in files) or files[0].read_bytes() != code:
        return None
    return dict(json.loads(files[2].read_bytes()))


def evaluate(policy: str, purpose: str, seed: int, episodes: int) -> dict[str, dict[str, float]]:
    """Evaluate a policy on each scenario in SCENARIOS, in episodes that training does not use.

    Args:
        policy: Name of a policy, or path of a model.
        purpose: Purpose of the episodes, evaluation or search, see `quad_env.seeding.PURPOSES`.
        seed: Seed of the episodes.
        episodes: Number of episodes on each scenario.

    Returns:
        Name of a scenario -> dictionary: `successes` and `falls`, numbers of episodes; `velocity_error`, mean velocity
        error, m/s.
    """
    figures = {}
    for name in SCENARIOS:
        seeds = episode_seeds(purpose, seed, episodes)
        measures = measure(run(policies.resolve(policy, servo="own", trust=True), scenario(name), seeds))
        figures[name] = {
            "successes": int(measures.succeeded.sum()),
            "falls": int(measures.fell.sum()),
            "velocity_error": round(float(measures.velocity_error.mean()), 4),
        }
    return figures


def markdown_lines(record: Mapping[str, Any]) -> list[str]:
    """Return the lines of Markdown with the results of all trained models and of the standing robot.

    `record` is the content of the JSON file that the command `sb3-block` writes.
    """
    heads = {"seed": "seed", "minutes": "processor time, min"}
    heads |= {name: f"success, `{name}`" for name in SCENARIOS}
    heads["falls"] = f"falls, `{SCENARIOS[0]}`"
    rows = [
        _row(str(entry["seed"]), number(entry["minutes"], 1), entry["scenarios"], record) for entry in record["seeds"]
    ]
    rows.append(_row("action 0, which stands", "–", record["standing"], record))
    seeds = " ".join(str(entry["seed"]) for entry in record["seeds"])
    versions_used = record["versions"]
    is_search = record.get("purpose") == "search"  # records of earlier versions have evaluation episodes
    kind = "search" if is_search else "held-out"
    purpose = " --purpose search" if is_search else ""
    return [
        f"{record['steps']:,} steps for each seed, then {record['episodes']} {kind} episodes on the usual physics "
        f"({_commands(SCENARIOS[0])}; {_commands(SCENARIOS[1])}):",
        "",
        *markdown.table(heads, rows).splitlines(),
        "",
        f"`python -m research sb3-block --seeds {seeds} --episodes {record['episodes']} "
        f"--evaluation-seed {record['evaluation_seed']}{purpose}`; success by "
        f"`{record['success_rule']}`; MuJoCo {versions_used['mujoco']}, Python {versions_used['python']}.",
    ]


def _row(
    name: str, minutes: str, scenarios: Mapping[str, Mapping[str, float]], record: Mapping[str, Any]
) -> dict[str, str]:
    """Create the row of one policy in the table of results.

    Args:
        name: Text of the first column: the seed, or a description of the policy.
        minutes: Text of the column with the processor time of the training, min.
        scenarios: Results of the policy from `evaluate`.
        record: Content of the JSON file that the command `sb3-block` writes.

    Returns:
        Name of the column -> text of the cell.
    """
    episodes = record["episodes"]
    row = {"seed": name, "minutes": minutes, "falls": str(scenarios[SCENARIOS[0]]["falls"])}
    for scenario_name in SCENARIOS:
        successes = scenarios[scenario_name]["successes"]
        row[scenario_name] = share(successes / episodes, wilson_interval(successes, episodes))
    return row


def _commands(name: str) -> str:
    """Describe in words the ranges of the velocity commands of the scenario `name`, m/s and rad/s."""
    ranges = scenario(name).commands
    low, high = ranges.forward
    return (
        f"`{name}`: {number(low, 2)} … {number(high, 2)} m/s forward, ±{number(ranges.lateral[1], 2)} m/s sideways, "
        f"±{number(ranges.yaw_rate[1], 2)} rad/s"
    )


def read_record(path: Path) -> dict[str, Any]:
    """Read the results from the JSON file `path`, which the command `sb3-block` has written."""
    return dict(json.loads(path.read_bytes()))


def lowest_success(record: Mapping[str, Any], name: str) -> float:
    """Return the lowest success rate of the trained models on the scenario `name`, 0 to 1.

    Args:
        record: Content of the JSON file that the command `sb3-block` writes, with one model for each training seed.
        name: Name of the scenario.

    Returns:
        The lowest success rate of all training seeds.
    """
    entries: Sequence[Mapping[str, Any]] = record["seeds"]
    fewest = min(int(entry["scenarios"][name]["successes"]) for entry in entries)
    return fewest / int(record["episodes"])
