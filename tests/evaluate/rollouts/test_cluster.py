"""Tasks on a Ray cluster of two nodes give the bytes of local workers, whatever becomes of the Ray workers."""

import contextlib
import os
import platform
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest

from evaluate.__main__ import main
from evaluate.records.software import software_versions
from evaluate.rollouts import cluster
from evaluate.rollouts.cluster import ClusterError, VersionCheck
from evaluate.rollouts.task_files import Unpacked
from evaluate.rollouts.workers import WorkerDiedError
from tests.ray_nodes import MISSING, REASON, busy_workers, descendants, killed_workers, two_nodes
from tests.seams import short_episodes, without_report
from tests.waiting import until

pytestmark = [
    pytest.mark.skipif(MISSING, reason=REASON),
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc"),
    pytest.mark.filterwarnings("default"),  # warnings of Ray
]
RUN = ("--policies", "stand", "trot", "--scenarios", "flat", "push", "--episodes", "6", "--threads", "2")


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    with two_nodes() as found:
        yield found


def episodes(folder: Path) -> bytes:
    return (folder / "episodes.parquet").read_bytes()


def test_an_evaluation_has_the_bytes_of_local_workers_though_ray_workers_are_killed(
    address: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    short_episodes(monkeypatch, 400)
    without_report(monkeypatch)
    with killed_workers(5, 1.5) as killed:
        assert main([*RUN, "--at-once", "2", "--ray", address, "--out", str(tmp_path / "ray")]) == 0
    assert len(killed) == 5
    assert capfd.readouterr().err.count("its task starts again") >= 1
    assert main([*RUN, "--out", str(tmp_path / "local")]) == 0
    assert episodes(tmp_path / "ray") == episodes(tmp_path / "local")


def fail_on_seven(unpacked: Unpacked, report: cluster.Report) -> int:
    """Report, and raise an exception for the number 7."""
    report("started")
    if unpacked.value == 7:
        raise ZeroDivisionError("seven")
    return unpacked.value**2


def kill_itself(unpacked: Unpacked, report: cluster.Report) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def sleep(unpacked: Unpacked, report: cluster.Report) -> None:
    report("started")
    time.sleep(600.0)


def run(
    address: str | None,
    work: cluster.Work,
    values: list[int],
    expected: dict[str, str] | None = None,
    receive: Callable[[int, object], None] = lambda *_: None,
    check: Callable[[], None] = lambda: None,
) -> dict[int, object]:
    """Run a task for each value on the cluster."""
    versions = VersionCheck(expected or {}, software_versions)
    with cluster.connect(address, 1, versions) as connection:
        return dict(connection.run(work, [partial(int, value) for value in values], receive, check))


def test_messages_results_and_exceptions_come_from_the_task(address: str) -> None:
    told: list[tuple[int, object]] = []
    assert run(address, fail_on_seven, [2, 3], receive=lambda *message: told.append(message)) == {0: 4, 1: 9}
    assert sorted(told) == [(0, "started"), (1, "started")]
    with pytest.raises(ZeroDivisionError, match="seven"):
        run(address, fail_on_seven, [7])


def test_a_worker_with_another_version_is_refused_by_name(address: str) -> None:
    versions = software_versions()
    assert {"numpy", "mujoco", "code", "processor"} <= set(versions)
    assert run(address, fail_on_seven, [2], versions) == {0: 4}
    name = f"worker on {platform.node()}: needs numpy 0.1, got {versions['numpy']}; valid"
    with pytest.raises(ClusterError, match=name):
        run(address, fail_on_seven, [2], versions | {"numpy": "0.1"})


def test_a_task_that_kills_every_worker_ends_the_run(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "MAX_ATTEMPTS", 2)
    with pytest.raises(WorkerDiedError, match="has died 2 times in the same task"):
        run(address, kill_itself, [1])


def test_ctrl_c_ends_its_own_tasks_and_nothing_else_on_the_cluster(address: str) -> None:
    started: list[object] = []

    def check() -> None:
        if started:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(address, sleep, [1, 2], receive=lambda *message: started.append(message), check=check)
    until(lambda: not busy_workers(), "a task is left")
    assert run(address, fail_on_seven, [2]) == {0: 4}


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["127.0.0.1:1"], "--ray: no cluster answers at 127.0.0.1:1 (Connection refused)"),
        (["ray://head:10001"], "--ray: no address of a cluster, got ray://head:10001; valid: HOST:PORT"),
        (["a:1", "b:2"], "--ray: more than one address, got a:1 b:2; valid: none or HOST:PORT"),
    ],
)
def test_an_address_that_is_no_cluster_is_one_line(
    words: list[str], line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["stand", "--scenarios", "flat", "--episodes", "1", "--out", str(tmp_path), "--ray", *words]) == 2
    assert capsys.readouterr().err.splitlines()[-1].startswith(f"error: {line}")


def test_ctrl_c_ends_the_cluster_that_was_started_and_local_workers_resume(
    repository: Path, tmp_path: Path, running: Callable[..., contextlib.AbstractContextManager[subprocess.Popen[str]]]
) -> None:
    words = ["--policies", "stand", "document@flat", "--scenarios", "flat", "push", "--episodes", "16"]
    command = [sys.executable, "-m", "evaluate", *words, "--at-once", "1", "--threads", "1", "--ray"]
    command += ["--out", str(tmp_path / "ray")]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("RAY_")}
    with running(command, longest=600.0, cwd=repository, start_new_session=True, env=environment) as process:
        while not list((tmp_path / "ray/parts").glob("*")):
            assert process.poll() is None, process.communicate()
            time.sleep(0.1)
        members = descendants(process.pid)
        sockets = listening(members)
        (folder,) = temporary_folders(members)
        assert folder.is_dir()
        os.killpg(process.pid, signal.SIGINT)
        _, errors = process.communicate()
    assert process.returncode == 130, errors
    assert "Traceback" not in errors
    assert "--resume" in errors.splitlines()[-1]
    assert sockets
    assert sockets <= {"0100007F", "00000000000000000000000001000000", "0000000000000000FFFF00000100007F"}
    until(lambda: not any(map(runs, members)), "processes are left")
    assert not folder.exists()
    assert main(["--resume", "--out", str(tmp_path / "ray")]) == 0
    assert main([*words, "--out", str(tmp_path / "local")]) == 0
    assert episodes(tmp_path / "ray") == episodes(tmp_path / "local")


def runs(process: int) -> bool:
    """Return True if a process exists and is not a zombie."""
    try:
        return Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


def temporary_folders(members: set[int]) -> set[Path]:
    """Return the temporary folders of clusters that the command lines of these processes name."""
    lines = [Path(f"/proc/{member}/cmdline").read_text(encoding="utf-8", errors="replace") for member in members]
    return {Path(name) for line in lines for name in re.findall(rf"/tmp/{cluster.FOLDER_PREFIX}\w+", line)}


def listening(members: set[int]) -> set[str]:
    """Return the addresses, as Linux writes them, at which these processes accept TCP connections."""
    inodes = set()
    for member in members:
        for link in Path(f"/proc/{member}/fd").glob("*"):
            with contextlib.suppress(OSError):
                inodes.add(os.readlink(link))
    tables = [Path(f"/proc/net/{name}").read_text(encoding="utf-8") for name in ("tcp", "tcp6")]
    lines = [line.split() for table in tables for line in table.splitlines()[1:]]
    return {line[1].partition(":")[0] for line in lines if line[3] == "0A" and f"socket:[{line[9]}]" in inodes}


def test_ray_is_imported_only_on_request(repository: Path) -> None:
    modules = "evaluate.commands.execution, train.commands.run, train.search.trot, train.commands.seeds"
    code = f"import sys, {modules}; print('ray' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], cwd=repository, capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"
