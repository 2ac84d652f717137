"""One diagnosis and its report, for all tests of what a person sees."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest
from slapshot import plotting
from slapshot.calibration.slide_recordings import CAMERA, RADIUS
from slapshot.calibration.slide_recordings import slide_recording as recording
from slapshot.diagnosis.pucks import report
from slapshot.diagnosis.pucks.diagnose import diagnose
from slapshot.diagnosis.pucks.report import write_report
from slapshot.diagnosis.pucks.report.outcome import Outcome
from slapshot.diagnosis.pucks.report.sentences import VERDICT_TEXT
from slapshot.diagnosis.pucks.result import Diagnosis, Setting
from slapshot.effects.catalogue import catalogue

SLOPE = 0.02  # m/m, towards +y
CURL = 0.3
VERSIONS = {"scene": "hockey", "code": "abc", "recording": "rig 3"}
EFFECTS = ("tilt", "linear_drag")


class Made(NamedTuple):
    """A diagnosis and its report."""

    diagnosis: Diagnosis
    outcome: Outcome | None
    drawings: dict[str, plotting.Drawing]
    folder: Path

    @property
    def verdict(self):
        return self.diagnosis.verdict

    @property
    def text(self):
        return (self.folder / VERDICT_TEXT).read_text()


@pytest.fixture(scope="session")
def reports(tmp_path_factory):
    """Of a tilted board, a flat one, one that acts as no known effect does, of too few hits and of pushes."""
    known = {name: catalogue()[name] for name in EFFECTS}
    setting = Setting(RADIUS, CAMERA, (0.5, 0.5, 0.01))
    recorded = {
        "tilt": recording(np.random.default_rng(3), 30, {"tilt": {"slope_x": 0.0, "slope_y": SLOPE}}),
        "nothing": recording(np.random.default_rng(4), 30),
        "not named": recording(np.random.default_rng(20), 100, {"curl": {"strength": CURL}}),
        "few carry it": recording(np.random.default_rng(21), 30, {"curl": {"strength": CURL}}),
        "cannot tell": recording(np.random.default_rng(2), 6),
        "no fit": scattered(recording(np.random.default_rng(6), 30)),
    }
    made = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(plotting._STYLE, "savefig.dpi", 50)  # pixels take longer than all the rest
        for name, recorded_hits in recorded.items():
            diagnosis = diagnose(recorded_hits, setting, effects=known)
            folder, kept = tmp_path_factory.mktemp("report"), {}
            patch.setattr(report, "save", keeping(kept))
            write_report(diagnosis, VERSIONS, folder)
            made[name] = Made(diagnosis, Outcome.of(diagnosis), kept, folder)
    return made


def keeping(kept):
    """`save`, which keeps what it saves."""

    def save(shown, folder):
        plotting.save(shown, folder)
        kept[shown.name] = shown

    return save


def scattered(made):
    """The same hits, each at a pace of its own: friction seems to differ by far more than is believed."""
    rng = np.random.default_rng(0)
    groups = (rows for _, rows in made.tracks.groupby("hit"))
    tracks = [rows.assign(t=rows["t"] * np.exp(rng.normal(0, 0.3))) for rows in groups]
    return replace(made, tracks=pd.concat(tracks, ignore_index=True))


@pytest.fixture(scope="session")
def tilt(reports):
    return reports["tilt"]


@pytest.fixture(scope="session")
def drawings(tilt):
    return tilt.drawings
