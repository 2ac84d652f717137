"""verdict.json: what is written is read, and what contradicts itself is refused."""

import json
from pathlib import Path

import pytest
from pydantic import ValidationError
from slapshot.diagnosis.verdict import (
    VERDICT_FILE,
    Errors,
    Fits,
    Interval,
    Mismatch,
    Unknown,
    Verdict,
    read_verdict,
    versioned,
    write_verdict,
)
from slapshot.errors import InputError

_ERRORS = Errors(
    rms={"joint position": Interval(value=0.1, low=0.05, high=0.2, unit="rad")}, log_likelihood=-3.5
)
NOTHING = Verdict(
    headline="nothing_found",
    reason="no test says that anything is missing",
    rig="größer | 7",
    stand_in=True,
    episodes=6,
    seconds=12.25,
    held_out_episodes=[2],
    cannot_tell=None,
    findings=["odd"],
    mismatch=Mismatch(found=False, p_value=0.4, strongest="wind"),
    location=None,
    effects=[],
    nominal_parameters=[],
    unknown=Unknown(flagged=False, p_value=0.4, description=""),
    fit=Fits(nominal=_ERRORS, refitted=_ERRORS, augmented=_ERRORS, noise_floor=_ERRORS),
    noise={},
    limits=[],
    converged=True,
    cpu_s=1.0 / 3.0,
    versions={},
)
_EFFECT = {
    "name": "viscous_friction",
    "part": "swing",
    "variant": "",
    "phrase": "viscous friction at swing",
    "gain_nats": 9.0,
    "rivals": {},
    "parameters": [
        {"name": "damping", "value": 0.1, "low": 0.1, "high": 0.2, "unit": "N m s/rad", "state": "moved"}
    ],
}
_FOUND = {"mismatch": {"found": True, "p_value": 0.001, "strongest": "wind"}}


def changed(**of: object) -> dict[str, object]:
    return NOTHING.model_dump(mode="json") | of


def test_what_is_written_is_read(tmp_path: Path):
    told = versioned(NOTHING, {"slapshot": "1"})
    assert (NOTHING.versions, told.versions) == ({}, {"slapshot": "1"})
    write_verdict(told, tmp_path)
    assert read_verdict(tmp_path) == told
    # For other programs: plain JSON in UTF-8.
    assert json.loads((tmp_path / VERDICT_FILE).read_text(encoding="utf-8"))["rig"] == "größer | 7"


@pytest.mark.parametrize(
    "values",
    [
        changed(headline="found", effects=[_EFFECT], **_FOUND),
        changed(headline="found_not_named", **_FOUND),
        changed(headline="cannot_tell", cannot_tell="too short", mismatch=None, unknown=None, fit=None),
    ],
)
def test_every_headline_is_read(tmp_path: Path, values: dict[str, object]):
    (tmp_path / VERDICT_FILE).write_text(json.dumps(values))
    assert read_verdict(tmp_path).headline == values["headline"]


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (changed(headline="cannot_tell"), "cannot_tell"),
        (changed(cannot_tell="too short"), "cannot_tell"),
        (changed(mismatch=None), "mismatch"),
        (changed(unknown=None), "unknown"),
        (changed(fit=None), "fit"),
        (changed(headline="found", **_FOUND), "effects"),
        (changed(effects=[_EFFECT]), "effects"),
        (changed(headline="found_not_named"), "mismatch"),
        (changed(**_FOUND), "mismatch"),
        (changed(headline="perhaps"), "headline"),
        (changed(extra=1), "extra"),
    ],
)
def test_contradictions_are_refused(tmp_path: Path, values: dict[str, object], words: str):
    (tmp_path / VERDICT_FILE).write_text(json.dumps(values))
    with pytest.raises(InputError) as caught:
        read_verdict(tmp_path)
    said = str(caught.value)
    assert words in said
    assert VERDICT_FILE in said
    assert "\n" not in said


def test_a_value_outside_its_interval_is_refused():
    for low, high in ((0.2, 0.3), (0.0, 0.05), (0.3, 0.0)):
        with pytest.raises(ValidationError, match="outside its interval"):
            Interval(value=0.1, low=low, high=high, unit="rad")


def test_a_verdict_that_is_not_there_is_asked_for(tmp_path: Path):
    with pytest.raises(InputError, match="diagnose the recording first"):
        read_verdict(tmp_path)
