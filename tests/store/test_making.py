"""Making a version: what happens when the disk is full, and when two processes want the same one."""

import errno
import resource
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from slapshot.command import Run, make_version
from slapshot.errors import InputError
from slapshot.store.folder import STORE_MARK
from slapshot.store.lock import held
from slapshot.store.recipe import Recipe
from slapshot.store.version_file import damaged_files
from waiting import HANG_S, join, wait_until

RECIPE = Recipe("rollouts", {"seed": 1}, code="0" * 64)
WAITING = f"waiting for another process that makes rollouts/{RECIPE.id}"

WRITERS = {
    "python": "(out / 'payload').write_text('x' * 100_000)",
    "csv": "pd.DataFrame({'x': np.arange(20_000)}).to_csv(out / 'payload.csv')",
    "parquet": "pq.write_table(pa.table({'x': np.random.rand(20_000)}), out / 'payload.parquet')",
    "safetensors": "save_file({'x': np.zeros(20_000)}, out / 'payload.safetensors')",
    "version file only": "[(out / str(i)).write_text('x') for i in range(500)]",
}
STAGE = """
import numpy as np, pandas as pd, pyarrow as pa, pyarrow.parquet as pq
from safetensors.numpy import save_file
from slapshot.command import stage_command

def produce(run):
    out = run.out
    {writer}

stage_command("rollouts", produce)
"""


def write(run: Run) -> None:
    (run.out / "payload").write_text("whole")


def hidden(store) -> list[str]:
    return sorted(path.name for path in store.root.rglob(".*") if path.name != STORE_MARK)


def stage(writer: str, root: Path, limit: int | None) -> subprocess.CompletedProcess[str]:
    """A stage in another process, whose files cannot grow beyond a limit: a full disk that works anywhere."""

    def at_most() -> None:
        if limit is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    code = STAGE.format(writer=writer)
    return subprocess.run(
        [sys.executable, "-c", code, "--recipe", RECIPE.to_json(), "--store", root],
        preexec_fn=at_most, capture_output=True, text=True, check=False, timeout=HANG_S,
    )  # fmt: skip


@pytest.mark.parametrize("writer", WRITERS.values(), ids=WRITERS)
def test_whatever_writes_a_refused_write_is_one_line_and_leaves_nothing(store, writer):
    done = stage(writer, store.root, limit=10_000)
    assert done.returncode == 1
    folder = store.folder(RECIPE.stage, RECIPE.id)
    assert done.stderr.startswith(f"[rollouts] {folder} could not be written: File too large")
    assert done.stderr.count("\n") == 1
    assert not folder.exists()
    assert hidden(store) == []
    assert stage(writer, store.root, limit=None).returncode == 0
    assert store.is_whole(RECIPE.stage, RECIPE.id)
    assert damaged_files(folder) == []


@pytest.mark.parametrize("resume", [False, True])
def test_what_was_written_before_the_disk_was_full_is_kept_if_the_stage_can_go_on(store, resume):
    def fill(run: Run) -> None:
        (run.out / "part").write_text("done")
        raise OSError(errno.ENOSPC, "No space left on device")

    def go_on(run: Run) -> None:
        assert (run.out / "part").exists() is resume
        write(run)

    with pytest.raises(InputError, match="could not be written: No space left on device; free some space"):
        make_version(store, RECIPE, fill, 1, resume)
    assert not store.is_whole(RECIPE.stage, RECIPE.id)
    assert hidden(store) == ([f".partial-{RECIPE.id}"] if resume else [])
    folder = make_version(store, RECIPE, go_on, 1, resume)
    assert damaged_files(folder) == []
    assert hidden(store) == []


def in_thread(function, *arguments) -> threading.Thread:
    """A lock belongs to an open file, so another thread is refused it like another process."""
    thread = threading.Thread(target=function, args=arguments, daemon=True)
    thread.start()
    return thread


@pytest.mark.parametrize("fails", [False, True])
def test_who_wants_a_version_that_is_being_made_waits_and_makes_it_only_if_that_failed(store, caplog, fails):
    begun, end = threading.Event(), threading.Event()
    made_by = []

    def slow(run: Run) -> None:
        begun.set()
        assert end.wait(HANG_S)
        if fails:
            raise InputError("bad")
        made_by.append("first")
        write(run)

    def second(run: Run) -> None:
        made_by.append("second")
        write(run)

    def first() -> None:
        try:
            make_version(store, RECIPE, slow, 1)
        except InputError:
            assert fails

    caplog.set_level("INFO", "slapshot")
    threads = [in_thread(first)]
    wait_until(begun.is_set, "the first begins", threads[0].is_alive)
    threads.append(in_thread(make_version, store, RECIPE, second, 1))
    wait_until(lambda: WAITING in caplog.messages, "the second waits", threads[1].is_alive)
    assert made_by == []
    end.set()
    for thread in threads:
        join(thread)
    assert made_by == ["second" if fails else "first"]
    assert damaged_files(store.folder(RECIPE.stage, RECIPE.id)) == []
    assert hidden(store) == []


def test_who_waits_goes_on_when_the_other_process_is_killed(store, caplog):
    process = subprocess.Popen(
        [sys.executable, "-c", STAGE.format(writer="print('begun', flush=True); input()"),
         "--recipe", RECIPE.to_json(), "--store", store.root],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
    )  # fmt: skip
    assert process.stdout.readline() == "begun\n"
    caplog.set_level("INFO", "slapshot")
    waiting = in_thread(make_version, store, RECIPE, write, 1)
    wait_until(lambda: WAITING in caplog.messages, "it waits", waiting.is_alive)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    join(waiting)
    assert damaged_files(store.folder(RECIPE.stage, RECIPE.id)) == []
    assert hidden(store) == []


def test_never_do_two_hold_a_lock(tmp_path):
    """Each removes the file while others wait on it or open it anew."""
    inside, most = [], []

    def work() -> None:
        for _ in range(50):
            with held(tmp_path / ".lock", "counts"):
                inside.append(1)
                most.append(len(inside))
                inside.pop()

    threads = [in_thread(work) for _ in range(8)]
    for thread in threads:
        join(thread)
    assert len(most) == 400
    assert set(most) == {1}
    assert not (tmp_path / ".lock").exists()
