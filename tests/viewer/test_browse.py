"""`slapshot browse` as people call it, and the gallery that it serves."""

import json
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from http.client import HTTPConnection, HTTPResponse
from pathlib import Path
from urllib.parse import urlsplit

import pytest
import rerun as rr
from rerun.chunk import RrdReader
from slapshot import cli
from slapshot.benchmark import gallery as benchmark
from slapshot.config.files import load_config
from slapshot.dag import make_plan
from slapshot.errors import InputError
from slapshot.store.folder import Store
from slapshot.viewer import browse
from slapshot.viewer.gallery import serve
from slapshot.viewer.hit_recording import INDEX_FILE, SCENE_FILE
from waiting import HANG_S, started

from .conftest import Made

ROOT = Path(__file__).parents[2]
ENTRIES = "/rerun.cloud.v1alpha1.RerunCloudService/FindEntries"  # that a viewer asks for first
HITS = 300


@pytest.fixture(autouse=True)
def working_copy(tmp_path, monkeypatch) -> Path:
    """Configurations and an empty store, no display; the current folder."""
    shutil.copytree(ROOT / "config", tmp_path / "config")
    shutil.copytree(ROOT / "workflow/schemas", tmp_path / "workflow/schemas")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    return tmp_path


@pytest.fixture
def slapshot(monkeypatch, capsys):
    def run(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["slapshot", *arguments])
        with pytest.raises(SystemExit) as caught:
            cli.main()
        captured = capsys.readouterr()
        return caught.value.code or 0, captured.out, captured.err

    return run


def put_into_store(made: Made, copies: int = 1) -> None:
    """Make `made` the version that the tiny configuration asks for, each hit `copies` times."""
    recipe = make_plan(load_config(Path("config/tiny.yaml"))).recipes["viewer/hockey"]
    with Store(Path("data/store")).new_version(recipe) as out:
        shutil.copytree(made.folder, out, dirs_exist_ok=True)
        if copies > 1:
            _copy_hits(out, copies)


def _copy_hits(folder: Path, copies: int) -> None:
    """Fill a version with copies of its hits under other ids."""
    index = json.loads((folder / INDEX_FILE).read_text())
    hits = []
    for hit in index["hits"]:
        chunks = RrdReader(folder / hit["file"]).stream().collect()
        for copy in range(copies):
            name = f"{hit['recording_id']}-{copy}"
            file = f"hits/{name}.rrd"
            chunks.write_rrd(folder / file, application_id="slapshot", recording_id=name)
            hits.append(hit | {"file": file, "recording_id": name})
    (folder / INDEX_FILE).write_text(json.dumps(index | {"hits": hits}))


def addresses_of(port: int) -> set[str]:
    """Local addresses on which something listens at a port (Linux: as the kernel has them, hex)."""
    lines = [
        line.split()
        for table in ("tcp", "tcp6")
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]
    ]
    ends = [fields[1].split(":") for fields in lines if fields[3] == "0A"]
    return {address for address, number in ends if int(number, 16) == port}


def test_the_gallery_has_all_hits_the_scene_and_both_layouts(made):
    with serve({"hockey": made.folder}, 0) as address:
        dataset = rr.catalog.CatalogClient(address.partition("/entry")[0]).get_dataset("hockey")
        assert address.endswith(str(dataset.id))
        ids = [hit["recording_id"] for hit in made.hits]
        assert sorted(dataset.segment_ids()) == sorted(ids)
        assert all(dataset.assets_for_segment(i) for i in ids)
        assert dataset.default_blueprint()
        assert dataset.default_segment_table_blueprint()
        table = dataset.segment_table().to_pandas().set_index("rerun_segment_id")
        for hit in made.hits:
            row = table.loc[hit["recording_id"]]
            assert row["property:RecordingInfo:name"][0] == hit["title"]
            assert row["property:hit:error_after_cm"][0] == pytest.approx(
                100 * hit["error_after_m"], abs=0.05
            )
        schema = dataset.segment_store(ids[0]).schema()
        assert "/scene/link7/blade" in {c.entity_path for c in schema.component_columns()}


@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="needs Linux's /proc")
def test_nobody_else_on_the_network_can_connect(made):
    with serve({"hockey": made.folder}, 0) as address:
        assert urlsplit(address).hostname == "127.0.0.1"
        assert addresses_of(urlsplit(address).port) == {"0100007F"}


def answer(port: int, host: str, origin: str) -> HTTPResponse:
    """Of the gallery to the question for its entries, as a browser asks for a page of that address."""
    connection = HTTPConnection("127.0.0.1", port)
    head = {"Host": host, "Origin": origin, "Content-Type": "application/grpc-web+proto"}
    connection.request("POST", ENTRIES, body=bytes(5), headers=head)
    return connection.getresponse()


def test_other_sites_may_not_read_the_gallery_whose_server_does_not_ask_by_what_name_it_is_called(made):
    """Rerun's server, which the README says: it has no check of Host that could be turned on."""
    with serve({"hockey": made.folder}, 0) as address:
        port = urlsplit(address).port
        foreign = answer(port, f"127.0.0.1:{port}", "http://other.example")
        assert foreign.getheader("access-control-allow-origin") is None
        local = answer(port, f"127.0.0.1:{port}", "http://127.0.0.1:9090")
        assert local.getheader("access-control-allow-origin") == "http://127.0.0.1:9090"
        assert answer(port, f"other.example:{port}", f"http://other.example:{port}").status == 200


def test_a_port_that_is_taken(made):
    with serve({"a": made.folder}, 0) as address:
        port = urlsplit(address).port
        with pytest.raises(InputError, match=f"{port}.*--port"), serve({"b": made.folder}, port):
            pass


def test_browse_opens_a_gallery_of_300_hits_and_ends_with_ctrl_c(made, tmp_path):
    """As a process of its own."""
    put_into_store(made, copies=-(-HITS // len(made.hits)))
    # A shell starts what runs in the background with Ctrl-C ignored.
    code = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    code += "from slapshot.cli import main; main()"
    command = [sys.executable, "-c", code, "browse", "--config", "config/tiny.yaml", "--port", "0"]
    with started(*command, output=tmp_path / "browse.txt") as running:
        running.wait_until(lambda: "\n" in running.said(), "the address of the gallery")
        server = running.said().splitlines()[0].removeprefix("gallery: ").partition("/entry")[0]
        assert len(rr.catalog.CatalogClient(server).get_dataset("hockey").segment_ids()) >= HITS
        running.process.send_signal(signal.SIGINT)  # Ctrl-C
        assert running.wait() == 0


def test_ctrl_c_right_after_the_address_ends_the_gallery_well(made, slapshot, monkeypatch):
    def interrupted() -> bool:
        raise KeyboardInterrupt

    put_into_store(made)
    monkeypatch.setattr(browse, "has_display", interrupted)
    assert slapshot("browse", "--config", "config/tiny.yaml", "--port", "0")[0] == 0


def test_the_benchmark_measures_what_the_number_of_hits_costs(made, monkeypatch):
    opened = []

    def seconds(work: Callable[[], list[str]]) -> float:
        opened.append(len(work()))
        return float(opened[-1])

    monkeypatch.setattr(benchmark, "seconds", seconds)
    monkeypatch.setattr(benchmark, "SHARE", len(made.hits) // 2)
    measured = {row.measure: row.value for row in benchmark.gallery_measures("hockey", made.folder)}
    assert opened == benchmark.ROUNDS * [len(made.hits), 2]
    assert measured == {
        "hockey_gallery_seconds": len(made.hits),
        "hockey_gallery_seconds_ratio_to_a_tenth_of_the_hits": len(made.hits) / 2,
    }


def test_without_hits_the_message_says_what_to_run(slapshot):
    code, _, error = slapshot("browse", "--config", "config/tiny.yaml")
    assert code == 1
    assert "run `snakemake recordings --configfile config/tiny.yaml` first" in error
    assert error.count("\n") == 1
    assert "run `snakemake recordings` first" in slapshot("browse")[2]


def test_one_hit_is_shown_with_scene_and_layout(made, slapshot):
    put_into_store(made)
    name = made.hits[0]["recording_id"]
    code, out, _ = slapshot("browse", "--config", "config/tiny.yaml", "--hit", name)
    assert code == 0
    command = out.splitlines()[-1].split()
    assert command[:2] == ["rerun", "--asset"]
    assert [Path(c).name for c in command[2:]] == [SCENE_FILE, "layout.rbl", f"{name}.rrd"]
    assert all(Path(c).is_file() for c in command[2:])
    assert slapshot("browse", "--hit", command[-1])[1].splitlines()[-1].split() == command


def test_a_hit_that_is_not_clear(made, slapshot):
    put_into_store(made)
    assert (
        "no hit is called 'nothing'"
        in slapshot("browse", "--config", "config/tiny.yaml", "--hit", "nothing")[2]
    )
    error = slapshot("browse", "--config", "config/tiny.yaml", "--hit", "simulated")[2]
    assert "3 hits are called 'simulated'" in error


def test_a_lone_file_is_shown_alone(made, tmp_path, slapshot):
    shutil.copy(made.folder / made.hits[0]["file"], tmp_path / "one.rrd")
    assert slapshot("browse", "--hit", "one.rrd")[1].splitlines()[-1] == "rerun one.rrd"


def test_with_a_display_the_viewer_gets_the_address_and_listens_here_only(made, slapshot, monkeypatch):
    put_into_store(made)
    calls = []
    monkeypatch.setenv("DISPLAY", ":7")
    monkeypatch.setattr(
        browse.subprocess, "run", lambda c, check: calls.append(c) or subprocess.CompletedProcess(c, 0)
    )
    code, out, _ = slapshot("browse", "--config", "config/tiny.yaml", "--port", "0")
    assert code == 0
    (command,) = calls
    assert command[-1] == out.split()[1]
    assert command[command.index("--bind") + 1] == "127.0.0.1"


def test_the_viewer_is_not_needed_for_anything_else():
    """A machine without Rerun can do all but browse."""
    code = (
        "import sys; sys.modules['rerun'] = None; sys.modules['rerun.blueprint'] = None\n"
        "from slapshot.cli import main\n"
        "sys.argv = ['slapshot', *sys.argv[1:]]; main()"
    )

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-c", code, *arguments]
        return subprocess.run(command, capture_output=True, text=True, timeout=HANG_S, check=False)

    assert run("versions", "list").returncode == 0
    done = run("browse")
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "run `make setup`" in done.stderr
