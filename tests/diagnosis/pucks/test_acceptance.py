"""`slapshot diagnose` as a user types it, report and all, on whole recordings of stand-in rigs.

Recordings are made by the lab, one conceals each effect of the catalogue; all share one pool of commands, and
so one file of signatures, which the first diagnosis makes.
"""

import json
import sys
from pathlib import Path

import pytest
from slapshot import cli, plotting
from slapshot.command import Run
from slapshot.config.files import load_config
from slapshot.config.lab import ConcealedEffect, StandIns
from slapshot.config.trajectories import DemonstrationsSettings
from slapshot.effects.catalogue import catalogue
from slapshot.lab.__main__ import record
from slapshot.lab.commands import Pool
from slapshot.trajectories import demonstrations
from slapshot.validation import values_of

from .report_rules import contradictions

ROOT = Path(__file__).parents[3]
HITS = 25
PLAIN = 1.5  # displacement over the hit-to-hit scatter
KEEPS = ("tracks only", "rest points only")
EFFECTS = {name: [(name, PLAIN)] for name in catalogue()}
CASES = EFFECTS | {
    "nothing": [],
    "nothing_either": [],
    "two": [("tilt", PLAIN), ("compliant_blade", PLAIN)],
    "uncatalogued": [("tether", PLAIN)],
    "tracks_only": [("curl", PLAIN)],
    "rests_only": [("blade_yaw", PLAIN)],
}
# Nothing, what the catalogue lacks, and less than a whole recording; the rest takes minutes.
QUICK = {"nothing", "uncatalogued", "tracks_only", "rests_only"}


@pytest.fixture(scope="session")
def make_recording(scene, tmp_path_factory):
    """Makes a recording: seed, concealed, hits, what is kept, folder -> its path."""
    folder = tmp_path_factory.mktemp("pool")
    (folder / "scene").mkdir()
    scene.save(folder / "scene")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        config = load_config()
    pool, lab = config.cases.pool, config.lab_of_cases
    name, truth = next(iter(lab.objects.items()))

    def make(seed, conceals, hits, keep, out):
        aside = folder / f"pool-{hits}"
        if not aside.exists():
            aside.mkdir()
            told = DemonstrationsSettings.from_parts(
                pool, domain="hockey", seed=config.cases.seed, count=hits
            )
            demonstrations.produce(Run(values_of(told), {"scene": folder / "scene"}, aside, 2))
        file = aside / "demonstrations.parquet"
        source = Pool.load(file, hits, pool.duration_s, len(scene.info.joints))
        settings = StandIns.from_parts(
            lab,
            objects={name: truth},
            hits=hits,
            commands="pool",
            concealed=[ConcealedEffect(kind=kind, displacement=size) for kind, size in conceals],
            keep=keep,
        )
        record(scene, source, settings, [seed, 0], out, cores=2)
        return out / "recording"

    return make


@pytest.fixture(scope="session")
def signatures(tmp_path_factory):
    return tmp_path_factory.mktemp("signatures") / "pool.safetensors"


@pytest.fixture
def slapshot(monkeypatch, capsys):
    """Runs the command in the repository; returns exit code and output."""

    def run(*arguments):
        monkeypatch.chdir(ROOT)
        monkeypatch.setitem(plotting._STYLE, "savefig.dpi", 50)  # pixels take longer than all the rest
        monkeypatch.setattr(sys, "argv", ["slapshot", *map(str, arguments)])
        with pytest.raises(SystemExit) as caught:
            cli.main()
        return caught.value.code or 0, capsys.readouterr()

    return run


def check_report(out, code, said):
    """What holds of every report."""
    assert code == 0, said.err
    assert contradictions(out) == []
    verdict = json.loads((out / "verdict.json").read_text())
    assert not [note for note in verdict["notes"] if "could not be drawn" in note]
    if verdict["headline"] != "cannot_tell":
        drawn = {file.stem for file in out.glob("*.png")}
        location = "D1-rests" if verdict["kind"] == "rest points only" else "D1-location"
        assert {location, "D2-ranking", "D4-errors"} <= drawn
        assert (out / "diagnosis.rrd").exists() == (verdict["kind"] != "rest points only")
    assert not [file for file in out.rglob("*") if file.name.startswith(".")]
    return verdict


@pytest.mark.parametrize(
    "case", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in CASES]
)
def test_the_command_reports_on_a_recording(case, make_recording, signatures, slapshot, tmp_path):
    keep = case.replace("rests", "rest points").replace("_", " ")
    seed = 100 + list(CASES).index(case)
    recording = make_recording(seed, CASES[case], HITS, keep if keep in KEEPS else "full", tmp_path / "rig")
    out = tmp_path / "verdict"
    code, said = slapshot("diagnose", recording, "--signatures", signatures, "--out", out)
    verdict = check_report(out, code, said)
    assert verdict["hits"] == HITS
    if case.startswith("nothing"):
        assert verdict["headline"] in {"nothing_found", "cannot_tell"}
    assert {path.name for path in tmp_path.iterdir()} == {"rig", "verdict"}


@pytest.mark.slow
def test_two_hundred_hits_are_reported_on(make_recording, slapshot, tmp_path):
    recording = make_recording(7, [("tilt", PLAIN)], 200, "full", tmp_path / "rig")
    code, said = slapshot("diagnose", recording, "--out", tmp_path / "verdict")
    verdict = check_report(tmp_path / "verdict", code, said)
    assert verdict["headline"] == "found"
    assert verdict["effects"][0]["name"] == "tilt"
