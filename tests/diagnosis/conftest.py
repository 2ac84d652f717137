"""One diagnosis and its report, for all tests of what a person sees."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from slapshot.diagnosis import report
from slapshot.diagnosis.diagnose import diagnose
from slapshot.diagnosis.judgement import limits
from slapshot.diagnosis.report import write_report
from slapshot.diagnosis.report.outcome import Outcome
from slapshot.diagnosis.report.sentences import VERDICT_TEXT
from slapshot.diagnosis.result import Diagnosis, Setting
from slapshot.diagnosis.verdict import Location, Mismatch, Unknown
from slapshot.effects.catalogue import catalogue
from slapshot.figures import drawing

from .synthetic import CAMERA, RADIUS, recording

SLOPE = 0.02  # m/m, towards +y
VERSIONS = {"scene": "hockey", "code": "abc", "recording": "rig 3"}
EFFECTS = ("tilt", "linear_drag")


class Made(NamedTuple):
    """A diagnosis and its report."""

    diagnosis: Diagnosis
    outcome: Outcome | None
    drawings: dict[str, drawing.Drawing]
    folder: Path

    @property
    def verdict(self):
        return self.diagnosis.verdict

    @property
    def text(self):
        return (self.folder / VERDICT_TEXT).read_text()


@pytest.fixture(scope="session")
def reports(tmp_path_factory):
    """Of a tilted board, of the same one as if nothing had been found, and of too few hits."""
    known = {name: catalogue()[name] for name in EFFECTS}
    setting = Setting(RADIUS, CAMERA, (0.5, 0.5, 0.01))
    tilted = recording(np.random.default_rng(3), 30, {"tilt": {"slope_x": 0.0, "slope_y": SLOPE}})
    tilt = diagnose(tilted, setting, effects=known)
    few = diagnose(recording(np.random.default_rng(2), 6), setting, effects=known)
    made = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(drawing._STYLE, "savefig.dpi", 50)  # pixels take longer than all the rest
        for name, diagnosis in {"tilt": tilt, "nothing": nothing_of(tilt), "cannot tell": few}.items():
            folder, kept = tmp_path_factory.mktemp("report"), {}
            patch.setattr(report, "save", keeping(kept))
            write_report(diagnosis, VERSIONS, folder)
            made[name] = Made(diagnosis, Outcome.of(diagnosis), kept, folder)
    return made


def keeping(kept):
    """`save`, which keeps what it saves."""

    def save(shown, folder):
        drawing.save(shown, folder)
        kept[shown.name] = shown

    return save


def nothing_of(diagnosis):
    """What would have been said had the recording passed."""
    verdict = diagnosis.verdict
    return replace(
        diagnosis,
        verdict=replace(
            verdict,
            mismatch=Mismatch(False, 0.4, 1.2, 0.001),
            location=Location(None, None, "nothing is missing that this recording could show"),
            effects=(),
            unknown=Unknown(False, None, None, 0.3, 0.001),
            limits=limits(diagnosis.search, diagnosis.nominal),
            fit=verdict.fit | {"augmented": verdict.fit["refitted"]},
            next_hits=(),
        ),
        final=diagnosis.nominal,
    )


@pytest.fixture(scope="session")
def tilt(reports):
    return reports["tilt"]


@pytest.fixture(scope="session")
def drawings(tilt):
    return tilt.drawings
