"""`slapshot diagnose` for joints: files in, a folder out, one line for every mistake."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from slapshot import cli
from slapshot.diagnosis.verdict import read_verdict
from slapshot.recordings.signals import write_signals

from .mechanisms import PENDULUM, control_channel, joint, recording, simulate

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module", name="folder")
def _folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model, a rig file, and recordings: one that moves, one too short to hold anything out."""
    folder = tmp_path_factory.mktemp("joints")
    (folder / "rod.xml").write_text(PENDULUM)
    (folder / "rig.yaml").write_text("model: rod.xml\nname: rod\n")
    rng = np.random.default_rng(1)
    damped = PENDULUM.replace('damping="0.05"', 'damping="0.4"')
    for name, episodes, seconds in (("moving", 5, 1.0), ("short", 1, 0.6)):
        t = np.arange(round(100 * seconds)) * 0.01
        u = [2 * np.sin(2 * np.pi * rng.uniform(0.5, 1.5) * t)[:, None] for _ in range(episodes)]
        angles = [simulate(damped, t, p, [rng.uniform(-1, 1)], [0.0])[0][:, 0] for p in u]
        noisy = [angle + 1e-3 * rng.standard_normal(len(t)) for angle in angles]
        channels = {
            "angle": (joint("swing"), noisy),
            "drive": (control_channel(actuator="drive"), [p[:, 0] for p in u]),
        }
        write_signals(recording([t] * episodes, channels), folder / name)
    t = np.arange(100) * 0.01
    wrapped = (9 * t + np.pi) % (2 * np.pi) - np.pi
    channels = {"angle": (joint("swing"), wrapped), "drive": (control_channel(actuator="drive"), 0 * t)}
    write_signals(recording(t, channels), folder / "wrapped")
    (folder / "hits").mkdir()
    (folder / "hits/recording.json").write_text('{"format_version": 1}')
    return folder


@pytest.fixture(name="slapshot")
def _slapshot(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs the command; returns exit code, output and errors."""

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["slapshot", *map(str, arguments)])
        with pytest.raises(SystemExit) as caught:
            cli.main()
        captured = capsys.readouterr()
        return int(caught.value.code or 0), captured.out, captured.err

    return run


def test_it_diagnoses_a_recording_with_a_model(slapshot: Run, folder: Path, tmp_path: Path):
    out = tmp_path / "out"
    code, said, _ = slapshot("diagnose", folder / "moving", "--model", folder / "rod.xml", "--out", out)
    assert code == 0
    verdict = read_verdict(out)
    assert verdict.headline in ("found", "found_not_named")
    assert verdict.mismatch is not None
    assert verdict.mismatch.found
    assert verdict.held_out_episodes == [2]
    assert set(verdict.versions) == {"slapshot", "code", "model", "recording"}
    assert verdict.rig in said
    assert (out / "verdict.md").is_file()
    assert bool(verdict.effects) == (out / "augmented").is_dir()
    assert {p.name for p in tmp_path.iterdir()} == {"out"}


def test_with_a_rig_file_too_little_data_is_a_verdict(slapshot: Run, folder: Path, tmp_path: Path):
    out = tmp_path / "out"
    code, _, _ = slapshot("diagnose", folder / "short", "--rig", folder / "rig.yaml", "--out", out)
    assert code == 0
    verdict = read_verdict(out)
    assert verdict.headline == "cannot_tell"
    assert "record longer" in (verdict.cannot_tell or "")


def test_of_an_angle_that_wraps_nothing_is_told(slapshot: Run, folder: Path, tmp_path: Path):
    out = tmp_path / "out"
    code, _, _ = slapshot("diagnose", folder / "wrapped", "--rig", folder / "rig.yaml", "--out", out)
    assert code == 0
    verdict = read_verdict(out)
    assert verdict.headline == "cannot_tell"
    assert "angle jumps by a whole turn, 1 times: the angle wraps" in (verdict.cannot_tell or "")


@pytest.mark.parametrize(
    ("name", "arguments", "words"),
    [
        ("moving", (), "give --model"),
        ("moving", ("--rig", "rig.yaml", "--model", "rod.xml"), "--rig and --model were both given"),
        ("moving", ("--model", "none.xml"), "none.xml: model is missing"),
        ("moving", ("--rig", "none.yaml"), "none.yaml"),
        ("hits", ("--model", "rod.xml"), "--model is of joints and bodies"),
        ("typo", ("--model", "rod.xml"), "typo: folder is missing"),
        ("typo", ("--rig", "rig.yaml"), "typo: folder is missing"),
    ],
)
def test_refusals(
    slapshot: Run, folder: Path, tmp_path: Path, name: str, arguments: tuple[str, ...], words: str
):
    given = [folder / a if "." in a else a for a in arguments]
    code, said, errors = slapshot("diagnose", folder / name, *given, "--out", tmp_path / "out")
    assert code != 0
    assert said == ""
    assert words in errors
    assert len(errors.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_what_is_there_already_is_left_as_it_is(slapshot: Run, folder: Path, tmp_path: Path):
    (tmp_path / "kept").write_text("mine")
    code, _, errors = slapshot(
        "diagnose", folder / "moving", "--model", folder / "rod.xml", "--out", tmp_path
    )
    assert code != 0
    assert "exists already" in errors
    assert [p.name for p in tmp_path.iterdir()] == ["kept"]
