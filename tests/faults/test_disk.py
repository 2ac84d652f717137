"""A disk that is full or read-only: one line that says what and where, nothing half-made, and on it goes."""

import shutil

import pytest
from workspace import few, snakemake_command

pytestmark = pytest.mark.workflow

# Runs a command on a store that has `free` bytes left, again once there is room, and keeps the store.
FULL = """
set -e
cp -a data/store saved
mount -t tmpfs tmpfs data/store
cp -a saved/. data/store
rm -r saved
used=$(df --output=used -B1 data/store | tail -1)
mount -o remount,size=$((used + $1)) data/store
shift
code=0; "$@" || code=$?
cp -a data/store after-failure
echo "FAILED WITH $code"
mount -o remount,size=1G data/store
"$@"
cp -a data/store after-success
"""

# Runs a command while a folder is read-only.
READ_ONLY = """
set -e
mount --bind "$1" "$1"
mount -o remount,bind,ro "$1"
shift
exec "$@"
"""


@pytest.fixture
def copy(workspace, tmp_path):
    """A copy of all that has been made, which a test may break."""
    return workspace.clone(tmp_path / "copy")


def command_of(copy) -> tuple[str, ...]:
    return snakemake_command("figures", config=copy.config)


def lines(output: str, *words: str) -> list[str]:
    return [line for line in output.splitlines() if all(word in line for word in words)]


def test_a_full_disk_stops_with_one_line_and_the_run_goes_on_when_there_is_room(copy, workspace, namespace):
    versions, before = copy.plan(), copy.whole()
    lost = {versions[label] for label in few(versions, before)}
    for version in lost:
        shutil.rmtree(copy.folder(version))
    kept = copy.whole()
    done = copy.run(*namespace, "bash", "-c", FULL, "bash", "4096", *command_of(copy))
    assert done.returncode == 0, done.stdout
    first, second = done.stdout.split("FAILED WITH 1\n")
    said = lines(first, "could not be written: No space left on device", "free some space")
    assert any(f"data/store/{version.stage}/{version.id}" in line for line in said for version in lost)
    assert all(line.endswith("then run the same command again") for line in said)
    assert "Traceback" not in done.stdout

    for name, wanted in (("after-failure", set(kept)), ("after-success", set(before))):
        shutil.rmtree(copy.root / "data/store")
        (copy.root / name).rename(copy.root / "data/store")
        assert set(copy.whole()) == wanted
        assert not list((copy.root / "data/store").glob("*/.*"))
    assert all(copy.content(version) == workspace.content(version) for version in lost)
    assert not lines(second, "could not be written")
    assert copy.manifest() == workspace.manifest()


def test_a_finished_store_may_be_read_only(copy, namespace):
    """Published again from it, too."""
    shutil.rmtree(copy.published)
    done = copy.run(*namespace, "bash", "-c", READ_ONLY, "bash", "data/store", *command_of(copy))
    assert done.returncode == 0, done.stdout
    assert copy.manifest()


def test_a_lost_version_in_a_read_only_store_is_named_in_one_line(copy, namespace):
    versions, before = copy.plan(), copy.whole()
    lost = {versions[label] for label in few(versions, before)}
    for version in lost:
        shutil.rmtree(copy.folder(version))
    kept = copy.whole()
    done = copy.run(*namespace, "bash", "-c", READ_ONLY, "bash", "data/store", *command_of(copy))
    assert done.returncode == 1
    said = lines(done.stdout, "could not be written: Read-only file system", "make that file system writable")
    assert said
    assert all(any(f"data/store/{v.stage}/{v.id} could" in line for v in lost) for line in said)
    assert "Traceback" not in done.stdout
    assert copy.whole() == kept


def test_a_new_version_in_a_read_only_store_is_refused_and_harms_nothing(copy, namespace):
    config = copy.variant("changed", lambda domain: domain.update(seed=2))
    kept = copy.whole()
    command = snakemake_command("figures", config=config)
    done = copy.run(*namespace, "bash", "-c", READ_ONLY, "bash", "data/store", *command)
    assert done.returncode == 1
    said = lines(done.stdout, "could not be written: Read-only file system", "make that file system writable")
    assert said
    assert all("] data/store/" in line for line in said)
    assert "Traceback" not in done.stdout
    assert "no backup found" not in done.stdout
    assert copy.whole() == kept


def test_a_stage_by_hand_on_a_read_only_store_says_so_in_one_line(copy, namespace):
    version = next(v for v in copy.plan().values() if v.stage == "scene")
    shutil.rmtree(copy.folder(version))
    stage = (
        *snakemake_command(config=copy.config)[:1],
        "-c",
        "from slapshot.cli import main; main()",
        "stage",
        "scene",
        "--config",
        str(copy.config),
    )
    environment = ("env", "MUJOCO_GL=disable")
    done = copy.run(*namespace, "bash", "-c", READ_ONLY, "bash", "data/store", *environment, *stage)
    assert done.returncode == 1
    assert done.stdout.startswith(
        f"[scene hockey] data/store/scene/{version.id} could not be written: Read-only file system "
    )
    assert done.stdout.count("\n") == 1


def test_a_read_only_folder_of_figures_is_named_in_one_line(copy, namespace):
    folder = copy.published.relative_to(copy.root)
    next(copy.published.glob("*.csv")).write_text("old\n")
    before = {path: path.read_bytes() for path in copy.published.rglob("*") if path.is_file()}
    done = copy.run(*namespace, "bash", "-c", READ_ONLY, "bash", str(folder), *command_of(copy))
    assert done.returncode == 1
    assert lines(done.stdout, f"[figures] {folder} could not be written: Read-only file system", "make that")
    assert "Traceback" not in done.stdout
    assert {path: path.read_bytes() for path in copy.published.rglob("*") if path.is_file()} == before
    copy.snakemake("figures")
    assert copy.manifest()
