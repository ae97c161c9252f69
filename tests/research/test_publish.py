"""The policy of seed 0 is published, its card shows the other seeds, and the card's command repeats the run."""

import dataclasses
import json
import re
import shlex
import shutil
from pathlib import Path

import pytest

import policies
from evaluate.analysis.comparison import Comparison
from evaluate.analysis.results import analyse
from evaluate.analysis.score import Score
from evaluate.records.store import ChunkStore
from policies.shipped import MODELS
from quad_env.cli.command_line import UsageError
from research.__main__ import main
from research.training.card_tables import format_difference, scores_table
from research.training.model_card import describe_correction, model_card, training_section
from research.training.publish import select_shipped
from research.training.trained_run import TrainedRun, migrate_settings, settings_of_card
from research.training.trained_run import load_trained_run as trained_run_of
from tests.robot_models import NEEDS_MODELS
from train.__main__ import main as train
from train.commands import distil
from train.commands.run import parse
from train.config import DEFAULTS
from train.run_record import differences, from_dict, to_dict, training_command

OPTIONS = (
    "--threads 1 --mixture flat 1.0 --validation.episodes 1 --validation.scenarios flat --steps 64 "
    "--ppo.envs 8 --ppo.rollout-steps 4 --ppo.minibatch 32 --ppo.epochs 1 --ppo.actor 8 --ppo.critic 8"
)


CARDS = [
    pytest.param(
        file,
        id=file.parent.relative_to(MODELS).as_posix(),
        marks=[NEEDS_MODELS] if file.parent.parent != MODELS else [],
    )
    for file in sorted(MODELS.rglob("MODEL.md"))
]
"""Cards of all published policies; those for other robots are in a folder of the robot."""


def publish(words):
    return main(["publish", *words])


def trained_run(kind="residual", **changes):
    return TrainedRun(f"runs/{changes}", dataclasses.replace(DEFAULTS[kind], **changes), 1.0, "revision", Path("best"))


def test_seed_0_ships_whatever_the_order_and_company_and_each_seed_is_one_run():
    runs = [trained_run(seed=2), trained_run("end-to-end", seed=0), trained_run(seed=0)]
    assert select_shipped(runs, "residual") is runs[2]
    for others, complaint in (
        ([trained_run(seed=1)], "seed 0 of residual"),
        ([trained_run(seed=0), trained_run(seed=0, threads=1)], "no seed twice"),
        ([trained_run(seed=0), trained_run(seed=1, steps=5)], "--steps"),
    ):
        with pytest.raises(UsageError, match=complaint):
            select_shipped(others, "residual")


@pytest.mark.parametrize("file", sorted(MODELS.rglob("policy.json")), ids=lambda file: file.parent.name)
def test_the_settings_of_every_shipped_policy_can_be_read(file):
    """Older policies have removed settings, with the only remaining value."""
    settings = json.loads(file.read_text(encoding="utf-8"))["training"]
    if "teacher" in settings:
        assert settings_of_card(settings, "").labels == settings["labels"]
        return
    assert from_dict(migrate_settings(settings)).steps == settings["steps"]
    kept = settings | {
        "ppo": settings["ppo"] | {"symmetry": "actor"},
        "rewards": settings["rewards"] | {"foot_slip": -1.0},
    }
    migrated = migrate_settings(kept)
    assert (migrated["ppo"]["symmetry"], migrated["rewards"]["foot_slip"]) == ("actor", -1.0)
    assert migrate_settings(settings | {"timestep": 0.0025})["timestep"] == 0.0025
    with pytest.raises(ValueError, match="space was removed"):
        migrate_settings(settings | {"space": "feet"})


def test_the_command_of_the_card_repeats_the_run():
    for kind, default in DEFAULTS.items():
        ppo = dataclasses.replace(default.ppo, actor=(32, 16), gamma=0.91)
        config = dataclasses.replace(default, seed=3, mixture=(("flat", 0.5), ("push", 0.5)), ppo=ppo)
        words = training_command(config).split()
        assert words[:3] == ["python", "-m", "train"]
        assert to_dict(parse(words[3:])) == to_dict(config), kind
    assert training_command(DEFAULTS["residual"]) == "python -m train --seed 0"
    walking = dataclasses.replace(DEFAULTS["residual"], base="trot", servo="150/5", hip_authority=0.2)
    assert training_command(walking) == "python -m train --base trot --hip-authority 0.2 --servo 150/5 --seed 0"


@pytest.mark.parametrize("file", CARDS)
def test_the_command_of_a_shipped_card_has_the_settings_of_its_bundle_and_the_card_names_the_revision(file):
    """If defaults of training options change, the command of an older card would train another policy."""
    text, bundle = file.read_text(encoding="utf-8"), json.loads((file.parent / "policy.json").read_text("utf-8"))
    (printed,) = re.findall(r"^    (python -m train .*)$", text, re.MULTILINE)
    settings = settings_of_card(bundle["training"], text)
    words = shlex.split(printed)[3:]
    assert differences(settings, distil.parse(words) if distil.is_requested(words) else parse(words)) == []
    assert f"source {bundle['git_revision']}." in text
    assert f"trained at revision {bundle['git_revision'][:8]}" in text
    assert training_section(trained_run_of(file.parent)) in text


def test_steps_of_a_card_are_those_of_its_run_unless_a_schedule_depends_on_them():
    bundle = to_dict(dataclasses.replace(DEFAULTS["residual"], steps=40_000_000, effort_ramp=0.125))
    found = settings_of_card(bundle, "x\n\n25,600,000 steps of 2048 robots")
    assert (found.steps, found.effort_ramp * found.steps) == (25_600_000, 0.125 * 40_000_000)
    assert settings_of_card(bundle, "40,000,000 steps of 2048 robots").effort_ramp == 0.125
    for ppo in ({"learning_rate_schedule": "linear"}, {"log_std_final": -3.0}):
        with pytest.raises(ValueError, match="schedules"):
            settings_of_card({**bundle, "ppo": bundle["ppo"] | ppo}, "25,600,000 steps of 2048 robots")
    with pytest.raises(ValueError, match="no number of steps"):
        settings_of_card(bundle, "many steps")


def test_the_card_says_how_the_policy_corrects_its_base_and_names_motors_and_sensors_that_are_not_ideal():
    plain, sensing = trained_run(), trained_run(sensors="typical")
    config = plain.config
    assert (
        describe_correction(config)
        == "corrects `trot_reference` at 50 Hz by at most 1 rad a joint, 0.6 rad at the hips"
    )
    held = dataclasses.replace(config, ppo=dataclasses.replace(config.ppo, hold=1))
    assert describe_correction(held).startswith("corrects `trot_reference` at 100 Hz")
    nothing = analyse([], seed=0, episodes=1, complete=True, baseline="trot")
    card = model_card("residual", [sensing], sensing, nothing)
    assert "source revision. Motors: ideal; sensors: typical. The shipped" in card
    assert "source revision. The shipped" in model_card("residual", [plain], plain, nothing)
    timed = dataclasses.replace(plain, cpu_minutes=2.5)
    assert "2.5 min of processor time in 1.0 min, source revision." in training_section(timed)


def test_an_end_to_end_policy_is_compared_with_the_trot_and_a_residual_with_its_base():
    learned, residual = trained_run("end-to-end"), trained_run(base="trot_integral")
    assert (learned.kind, learned.references) == ("end-to-end", ("trot",))
    assert (residual.kind, residual.references) == ("residual", ("trot_integral",))


def test_the_card_scores_each_seed_against_the_base():
    runs = [trained_run(seed=0, base="trot_integral"), trained_run(seed=1, base="trot_integral")]
    nothing = analyse([], seed=0, episodes=1, complete=True, baseline="trot_integral")
    assert scores_table({"residual": "mine"}, runs, runs[0], nothing) == ""
    worth = {runs[0].label: 0.9, "trot_integral": 0.5, runs[1].label: 0.25}
    found = tuple(Score(name, of, (of, of), {}, of - 0.5, (of - 0.5,) * 2, 0.01) for name, of in worth.items())
    rows = scores_table({"residual": "mine"}, runs, runs[0], dataclasses.replace(nothing, scores=found)).splitlines()[
        4:
    ]
    assert [row.split(" | ")[0] for row in rows] == ["| mine 0 (shipped)", "| `trot_integral`", "| mine 1"]
    assert [row.split(" | ")[1].split()[0] for row in rows] == ["90.0", "50.0", "25.0"]
    assert [row.split(" | ")[2].split()[0] for row in rows] == ["40.0", "–", "−25.0"]


def test_the_cards_p_values_are_corrected_for_their_number():
    found = Comparison("flat", "runs/0", "trot", "velocity_error", -0.1, (-0.2, 0.0), 0.01, "", 0.04)
    assert format_difference(found).replace("\u00a0", " ") == "−0.100 (p = 0.040)"


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    for seed in ("0", "1"):
        assert train([*OPTIONS.split(), "--seed", seed, "--out", str(folder / seed)]) == 0
    return folder


def test_a_policy_is_published_stopped_or_not_and_evaluated_again(runs, tmp_path, monkeypatch, capsys):
    to, rest = tmp_path / "models" / "walker", ["--scenarios", "flat", "--episodes", "2", "--threads", "1"]
    words = [str(runs / "1"), str(runs / "0"), "--to", str(to), "--out", str(tmp_path / "out"), *rest]
    save, saved = ChunkStore.save, []

    def interrupted(store, chunk):
        save(store, chunk)
        saved.append(chunk.cell.policy)
        if len(saved) == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(ChunkStore, "save", interrupted)
    assert publish(words) == 130
    assert not (to / "MODEL.md").exists()
    assert publish([*words, "--resume"]) == 0
    assert len(set(saved)) == len(saved) == 3

    assert sorted(path.name for path in to.iterdir()) == ["MODEL.md", "policy.json", "policy.safetensors"]
    assert (to / "policy.safetensors").read_bytes() == (runs / "0" / "best" / "policy.safetensors").read_bytes()
    assert policies.load(to).name == "residual"
    card = (to / "MODEL.md").read_text(encoding="utf-8")
    (row,) = [line for line in card.splitlines() if line.startswith("| flat |")]
    assert card.startswith("# walker\n")
    assert "| success, walker 0 (shipped) | seeds 1 | median |" in card
    assert "Success is by the rule `success/2`; every step after a fall" in card
    assert row.count("p\u00a0") == 4
    assert "- Succeeds in less than half of the episodes: " in card
    assert card.count("minus `trot_reference`") == 1
    assert str(tmp_path) not in card
    assert str(runs) not in card

    (to / "MODEL.md").write_text(card.replace("| flat |", "| gone |"), encoding="utf-8")
    description = (to / "policy.json").read_bytes()
    assert publish([str(to), "--to", str(to), "--out", str(tmp_path / "again"), *rest]) == 0
    again = (to / "MODEL.md").read_text(encoding="utf-8")
    assert again.split("## Results")[0] == card.split("## Results")[0]
    assert "| flat |" in again
    assert (to / "policy.json").read_bytes() == description
    (to / "MODEL.md").write_text("by hand", encoding="utf-8")
    assert publish([str(to), "--to", str(to), "--out", str(tmp_path / "third"), *rest]) == 2
    assert "holds no shipped policy with its MODEL.md" in capsys.readouterr().err


def test_a_run_over_other_parameters_of_its_base_is_not_published(runs, tmp_path, monkeypatch, refused):
    base = policies.make(parse([]).base, servo="own")
    other = type(base)(parameters=dataclasses.replace(base.parameters, frequency=5.0))
    monkeypatch.setattr(policies, "make", lambda name, **_: other)
    assert "other parameters" in refused(main, "publish", runs / "0", "--to", tmp_path / "model")
    assert not (tmp_path / "model").exists()


@pytest.mark.parametrize(
    ("file", "change", "complaint"),
    [
        ("best/policy.json", lambda text: text.replace('"git_revision"', '"revision"'), "lacks git_revision"),
        ("best/policy.safetensors", lambda _: "", "SHA-256"),
        ("checkpoints/000000000064.json", lambda text: text.replace('"seconds"', '"secs"'), "secs"),
        ("config.json", lambda text: text.replace('"residual"', '"waltz"'), "'waltz'"),
        ("config.json", lambda text: text.replace('"steps": 64', '"steps": 6400'), "unfinished"),
    ],
)
def test_a_damaged_or_unfinished_run_is_not_published(file, change, complaint, runs, tmp_path, refused):
    folder = tmp_path / "run"
    shutil.copytree(runs / "0", folder)
    # Otherwise the run would resume from this checkpoint.
    (folder / "checkpoints" / "000000000000.json").unlink(missing_ok=True)
    before = (folder / file).read_bytes()
    (folder / file).write_text(change(before.decode(errors="replace")), encoding="utf-8")
    assert (folder / file).read_bytes() != before
    assert complaint in refused(main, "publish", folder, "--to", tmp_path / "model")
    assert not (tmp_path / "model").exists()
