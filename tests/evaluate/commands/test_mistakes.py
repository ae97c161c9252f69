"""Invalid arguments of `python -m evaluate` give one line, before anything is simulated or written."""

import shlex
from pathlib import Path

import pytest

from evaluate.__main__ import main
from policies.shipped import MODELS


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("trott", ("no policy 'trott'", "document_repaired", "stand")),
        ("trott@flat", ("--policies: no policy 'trott'",)),
        ("trot stand trot", ("trot", "more than once")),
        (f"{MODELS}/residual {MODELS}/./residual/", ("more than once",)),
        ("trot@push --scenarios flat rough", ("trot@push is not among the scenarios of this run: flat, rough",)),
        ("trot@", ("--policies: name scenarios after the @ of trot@, as in document@flat",)),
        ("own.zip", ("give --trust",)),
        ("trot --scenarios ice", ("unknown scenario 'ice'", "flat, push, rough")),
        ("trot --episodes 0", ("--episodes", "0")),
        ("trot --seed -1", ("--seed",)),
        ("trot --actuator moter", ("actuator", "moter", "ideal, torque_speed, motor")),
        ("trot --nonsense", ("--nonsense", "--help")),
        ("trot --workers 4", ("--workers", "did you mean --threads?")),
        ("trot --num-workers=4", ("--num-workers", "did you mean --threads?")),
        ("trot --episode 4", ("--episode", "did you mean --episodes?")),
        ("axes push --jobs 4", ("--jobs", "did you mean --threads?")),
        ("models/nix trot", ("--policies: there is no file or folder models/nix",)),
        ("nix/net.onnx trot", ("--policies: there is no file nix/net.onnx",)),
        ("trot --robot nix/dog", ("there is no file or folder nix/dog",)),
        ("trot --scenarios nix/hill", ("--scenarios: there is no file or folder nix/hill",)),
        ("trot stand --scenarios flat --baseline gallop", ("--baseline: gallop is not among the policies",)),
        ("repaly", ("did you mean the command replay?",)),
        ("trot --resume", ("leave --resume out",)),
        ("rescore results", ("gone", "report FOLDER --success")),
        ("jump --robots 3", ("`python -m evaluate jump` is now `python -m research jump`",)),
        ("axes ice", ("slippery",)),
        ("report RUN --baseline gallop", ("--baseline: gallop is not among the policies",)),
        ("replay RUN 30", ("rows 0 to 29", "30")),
        ("replay RUN one", ("error: Error parsing EPISODE: 'one' is no whole number",)),
        ("trot --episodes 1.5", ("error: Error parsing --episodes: '1.5' is no whole number",)),
        ("replay RUN 1 --policy trott", ("trott", "document, stand, trot")),
        ("replay RUN 1 --scenario ice", ("ice", "flat, push")),
        ("replay RUN 1 --policy trot", ("--scenario",)),
        ("replay RUN 1 --scenario push", ("--policy",)),
        ("replay RUN 5 --policy trot --scenario push", ("0 to 4",)),
        ("replay RUN 1 --video film.avi", (".mp4", ".webp", "film.avi")),
        ("replay RUN 1 --page page.txt", ("--page must end in .html", "page.txt")),
        ("replay RUN 1 --page own.zip/page.html", ("--page: cannot write to the folder own.zip",)),
        ("replay RUN 1 --page page.html --against trott", ("--against: no policy 'trott'", "residual")),
        ("replay RUN 1 --page page.html --against nix/trot", ("--against: there is no file or folder nix/trot",)),
        ("replay RUN 1 --against trot", ("--against", "--page FILE.html or --video FILE")),
        ("compare RUN RUN --policies trott trot", ("trott", "document, stand, trot")),
        ("compare RUN RUN --policies trot", ("--policies",)),
        ("compare RUN RUN --json .", ("--json", "is a folder")),
        ("compare RUN nothing", ("nothing",)),
    ],
)
@pytest.mark.usefixtures("no_simulation")
def test_a_mistake_is_one_line_that_names_the_remedy(words, said, run, tmp_path: Path, monkeypatch, refused) -> None:
    monkeypatch.chdir(tmp_path)
    Path("own.zip").touch()
    line = refused(main, *shlex.split(words.replace("RUN", str(run.folder))))
    assert all(part in line for part in said), line
    assert [path.name for path in tmp_path.iterdir()] == ["own.zip"]


@pytest.mark.usefixtures("no_simulation")
@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--policies document stand trot residual", "it is extended by `python -m evaluate --add residual --out "),
        ("--episodes 9", "Once it is finished, it is extended by `python -m evaluate --episodes 9 --out "),
        (
            "--scenarios flat push rough",
            "A run is not extended by scenarios: leave --resume out and name another --out",
        ),
    ],
)
def test_who_would_extend_a_run_is_told_what_to_do(words, said, run, refused) -> None:
    assert said in refused(main, "--resume", "--out", str(run.folder), *words.split())
