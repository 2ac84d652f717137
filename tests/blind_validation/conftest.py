"""What a diagnosis says and what a rig concealed, by hand; cases scored from both."""

import json

import pytest
from slapshot.blind_validation.score import score
from slapshot.diagnosis.pucks.verdict import (
    Errors,
    Interval,
    Location,
    Mismatch,
    NamedEffect,
    ParameterValue,
    Unknown,
    Verdict,
)

ERRORS = Errors(
    track_rmse_m=Interval(0.01, 0.009, 0.011),
    rest_rmse_m=Interval(0.02, 0.02, 0.02),
    command_rest_rmse_m=None,
    loglik_per_hit=Interval(1.5, 1.0, 2.0),
    chi2_per_freedom=Interval(1.0, 1.0, 1.0),
    camera_chi2=Interval(1.0, 1.0, 1.0),
    encoder_chi2=None,
)


def effect(name, members=None, **parameters):
    reported = tuple(ParameterValue(n, "1", *values, meaning=n) for n, values in parameters.items())
    return NamedEffect(name, "slide", "place", members or {name: 1.0}, 9.0, 0.01, reported, name)


def verdict(*effects, unknown=False, phase="slide", variable="place"):
    missing = bool(effects) or unknown
    return Verdict(
        headline="found" if effects else "found_not_named" if unknown else "nothing_found",
        rig="stand-in",
        kind="full",
        stand_in=True,
        hits=200,
        used=200,
        cannot_tell=None,
        mismatch=Mismatch(missing, "tests" if missing else None, 0.0005, 50.0, 0.01),
        effects=effects,
        unknown=Unknown(unknown, phase, variable, 9.0, 0.01, 0.5),
        location=Location(phase, variable, "some"),
        fit=dict.fromkeys(("nominal", "refitted", "augmented", "noise_floor"), ERRORS),
    )


def concealed(kind, displacement=0.8, phase="slide", catalogued=True, like="same", **parameters):
    return {
        "kind": kind,
        "displacement": displacement,
        "phase": phase,
        "catalogued": catalogued,
        "parameters_are": like,
        "parameters": parameters,
    }


@pytest.fixture
def scored(tmp_path):
    def run(condition, truths, answer, case="c1"):
        (tmp_path / "truth").mkdir(exist_ok=True)
        (tmp_path / "truth" / "truth.json").write_text(json.dumps({"concealed": truths}))
        return score(case, condition, tmp_path, answer)

    return run
