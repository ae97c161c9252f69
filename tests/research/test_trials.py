"""The table of trials says of each run what its own folder says, finished or not."""

import csv
import json

import pytest

from research.__main__ import main
from train.__main__ import main as train
from train.run_folder import CONFIG_FILE, METRICS_FILE, VALIDATIONS_FILE

OPTIONS = "--steps 64 --ppo.envs 8 --ppo.rollout-steps 4 --ppo.minibatch 16 --ppo.epochs 1 --max-episode-steps 8"
VALIDATION = "--validation.interval 0 --validation.episodes 2 --validation.scenarios flat --mixture flat 1 --threads 1"


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """One that was finished, and one that an older program began, with another setting, and left."""
    folder = tmp_path_factory.mktemp("trials")
    assert train([*OPTIONS.split(), *VALIDATION.split(), "--out", str(folder / "whole")]) == 0
    (folder / "old").mkdir()
    settings = json.loads((folder / "whole" / CONFIG_FILE).read_bytes())
    settings["ppo"] |= {"gamma": 0.9, "burn_in": 7}
    del settings["estimator"]
    (folder / "old" / CONFIG_FILE).write_text(json.dumps(settings), encoding="utf-8")
    (folder / "old" / METRICS_FILE).write_text('{"steps": 32, "time/seconds": 90.0}\n', encoding="utf-8")
    return folder


def rows(path):
    with path.open(encoding="utf-8", newline="") as file:
        return {row.pop("trial"): list(row.values())[1:] for row in csv.DictReader(file)}


def test_a_row_has_the_settings_the_effort_and_the_best_validation(runs, tmp_path):
    table = tmp_path / "table.csv"
    assert main(["trials", str(runs / "old"), str(runs / "whole"), "--table", str(table)]) == 0
    found = rows(table)
    settings, steps, _, judged, success, on_flat, error = found["whole"]
    assert settings == (
        "mixture flat 1.0, max-episode-steps 8, ppo.envs 8, ppo.rollout-steps 4, ppo.minibatch 16, ppo.epochs 1"
    )
    assert (steps, judged) == ("64", "flat x 2")
    record = json.loads((runs / "whole" / VALIDATIONS_FILE).read_bytes())["validations"][-1]
    flat = record["scenarios"]["flat"]
    assert [success, on_flat] == [f"{100 * record['success']:.1f}", f"{100 * flat['success_rate']:.0f}"]
    assert error == f"{flat['velocity_error']:.3f}"
    assert list(found) == ["whole", "old"]  # what was stopped comes last, with the names that it had
    settings, *rest = found["old"]
    assert settings.endswith("ppo.gamma 0.9, ppo.burn-in 7")
    assert rest == ["32", "1.5", "stopped", "", "", ""]


def test_the_best_validation_counts_not_the_last(runs, tmp_path):
    folder = tmp_path / "two"
    folder.mkdir()
    for name in (CONFIG_FILE, METRICS_FILE):
        (folder / name).write_bytes((runs / "whole" / name).read_bytes())
    means = {"success_rate": 0.5, "velocity_error": 0.1}
    both = [{"steps": n, "success": share, "scenarios": {"flat": means}} for n, share in ((32, 0.75), (64, 0.25))]
    (folder / VALIDATIONS_FILE).write_text(json.dumps({"best": 32, "validations": both}), encoding="utf-8")
    assert main(["trials", str(folder), "--table", str(tmp_path / "table.csv")]) == 0
    assert rows(tmp_path / "table.csv")["two"][4:] == ["75.0", "50", "0.100"]
