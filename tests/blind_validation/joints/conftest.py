"""Verdicts on joints and sealed truths by hand, and cases scored from both."""

import json

import pytest
from slapshot.blind_validation.joints.score import score
from slapshot.diagnosis.verdict import Verdict

REFITTED = (0.004, 0.0036, 0.0044)  # rad, with the interval


def effect(name, part="joint2", *rivals):
    return {
        "name": name,
        "part": part,
        "variant": "",
        "phrase": f"{name} at {part}",
        "gain_nats": 9.0,
        "rivals": dict.fromkeys(rivals, 0.5),
        "parameters": [],
    }


def _errors(value, low=None, high=None):
    interval = {"value": value, "low": low or value, "high": high or value, "unit": "rad"}
    return {"rms": {"joint position": interval}, "log_likelihood": None}


def verdict(*effects, headline=None, p=0.3, unknown=False, error=0.001, cpu_s=12.0):
    """With a noise floor of 1 mrad; `error` is that of the augmented model."""
    headline = headline or ("found" if effects else "nothing_found")
    untold, missing = headline == "cannot_tell", headline != "nothing_found"
    values = {
        "headline": headline,
        "reason": "so it is",
        "rig": "stand-in",
        "stand_in": True,
        "episodes": 20,
        "seconds": 60.0,
        "held_out_episodes": [2],
        "cannot_tell": "no joint moves" if untold else None,
        "findings": [],
        "mismatch": None if untold else {"found": missing, "p_value": p, "strongest": "wind"},
        "location": None,
        "effects": list(effects),
        "nominal_parameters": [],
        "unknown": None if untold else {"flagged": unknown, "p_value": p, "description": ""},
        "fit": None
        if untold
        else {
            "nominal": _errors(0.005),
            "refitted": _errors(*REFITTED),
            "augmented": _errors(error),
            "noise_floor": _errors(0.001),
        },
        "noise": {},
        "limits": [],
        "converged": True,
        "cpu_s": cpu_s,
        "versions": {},
    }
    return Verdict.model_validate(values)


def concealed(kind, joint="joint2", body=None, catalogued=True):
    return {
        "kind": kind,
        "catalogued": catalogued,
        "joint": None if body else joint,
        "body": body,
        "amplitude": 0.25,
        "amplitude_unit": "N m",
    }


@pytest.fixture
def scored(tmp_path):
    def run(condition, truths, answer, case="j0001", rig="pendulum"):
        (tmp_path / "sealed").mkdir(exist_ok=True)
        truth = {"rig": rig, "size": 3.0, "concealed": truths}
        (tmp_path / "sealed" / "truth.json").write_text(json.dumps(truth))
        return score(case, condition, tmp_path, answer)

    return run
