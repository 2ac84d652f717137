"""Disturbance torques on a real double pendulum, concealed from the diagnosis, against the pushes it names.

The experimenters added two smooth pulses to each joint in two trials of 10 s, and one in a third of 5 s. The
diagnosis is given neither these torques nor the motors' currents, which hold a part of them. It takes about
twelve minutes of CPU.
"""

import json
import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

ROOT = Path(__file__).parents[2]
PENDULUMS = Path(os.environ.get("SLAPSHOT_PENDULUMS", ROOT.parent / "shared/data/pendulums"))
TRIALS = [f"perturbed_acrobot_0{trial}.csv" for trial in (1, 2, 3)]
EDGE = 0.05  # of the peak, where a pulse begins and ends


@dataclass(frozen=True)
class Push:
    """A torque (N m) at a joint, from one time to another (s) in an episode."""

    joint: int
    episode: int
    begin: float
    end: float
    torque: float

    @property
    def centre(self) -> float:
        return (self.begin + self.end) / 2

    def overlaps(self, other: "Push") -> bool:
        same = (self.joint, self.episode) == (other.joint, other.episode)
        return same and self.begin < other.end and other.begin < self.end


def concealed_pushes(folder: Path) -> list[Push]:
    """Pulses of the columns that the diagnosis does not see."""
    found = []
    for episode, name in enumerate(TRIALS):
        trial = pd.read_csv(folder / name)
        time = trial["time"].to_numpy()
        for joint in (1, 2):
            torque = trial[f"tau_pert{joint}"].to_numpy()
            acts = (np.abs(torque) > EDGE * np.abs(torque).max()).astype(int)
            steps = np.diff(acts, prepend=0, append=0)
            for first, end in zip(np.flatnonzero(steps == 1), np.flatnonzero(steps == -1), strict=True):
                part = torque[first:end]
                peak = float(part[np.abs(part).argmax()])
                found.append(Push(joint, episode, time[first], time[min(end, len(time) - 1)], peak))
    return found


def named_pushes(notes: str) -> list[Push]:
    """Pushes in the notes beside the augmented model, with their largest torques."""
    number = r"(-?[\d.e-]+)"
    values = r"(-?[\d.e-]+(?:, -?[\d.e-]+)*)"
    found = []
    for joint, text in re.findall(r"^- Apply as qfrc_applied at joint Joint(\d): (.*)$", notes, re.MULTILINE):
        for groups in re.findall(rf"{values} from {number} to {number} s of episode (\d+)", text):
            torque = max(map(float, groups[0].split(", ")), key=abs)
            begin, end = map(float, groups[1:3])
            found.append(Push(int(joint), int(groups[3]), begin, end, torque))
    return found


def held_out_pushes(findings: list[str]) -> list[Push]:
    """Pushes that are told of held-out data."""
    found = []
    for text in findings:
        told = re.search(
            r"held-out data, about (\S+) N m push Joint(\d) from (\S+) to (\S+) s of episode (\d+)", text
        )
        if told:
            torque, joint, begin, end, episode = told.groups()
            found.append(Push(int(joint), int(episode), float(begin), float(end), float(torque)))
    return found


def slapshot(*arguments: str | Path) -> None:
    command = Path(sys.executable).with_name("slapshot")
    subprocess.run([str(command), *map(str, arguments)], cwd=ROOT, check=True)


@pytest.mark.slow
@pytest.mark.skipif(not (PENDULUMS / "double").is_dir(), reason="SLAPSHOT_PENDULUMS names the recordings")
def test_concealed_disturbances_are_found_at_the_right_joint_and_time(tmp_path):
    """Measured: 9 of 10, one of them in held-out data, all with the right sign, and 1 that nobody added.

    The ninth is 0.14 s off, of which only the beginning is named: the last limit but one is missed.
    """
    recording, out = tmp_path / "acrobot", tmp_path / "verdict"
    folder = PENDULUMS / "double"
    mapping, trials = "config/recordings/pendulum-double-acrobot.yaml", folder / "perturbed_acrobot_*.csv"
    rig = "config/rigs/pendulum-double-c-friction.yaml"
    slapshot("import", mapping, trials, recording)
    slapshot("diagnose", recording, "--rig", rig, "--out", out)
    named = named_pushes((out / "augmented/NOTES.md").read_text())
    named += held_out_pushes(json.loads((out / "verdict.json").read_text())["findings"])
    concealed = concealed_pushes(folder)
    pairs = [(push, truth) for truth in concealed for push in named if push.overlaps(truth)]
    assert len({truth for _, truth in pairs}) >= 8
    assert all(np.sign(push.torque) == np.sign(truth.torque) for push, truth in pairs)
    off = [abs(push.centre - truth.centre) for push, truth in pairs]
    assert np.median(off) <= 0.05
    assert max(off) <= 0.1
    assert len([push for push in named if not any(push.overlaps(truth) for truth in concealed)]) <= 4
