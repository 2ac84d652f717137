"""What a diagnosis says and what a rig concealed, by hand; cases scored from both."""

import json

import pytest
from slapshot.blind_validation.score import score

ERRORS = {
    "track_rmse_m": {"value": 0.01, "low": 0.009, "high": 0.011},
    "rest_rmse_m": {"value": 0.02, "low": 0.02, "high": 0.02},
    "command_rest_rmse_m": None,
    "loglik_per_hit": {"value": 1.5, "low": 1.0, "high": 2.0},
    "chi2_per_freedom": {"value": 1.0, "low": 1.0, "high": 1.0},
}


def effect(name, members=None, **parameters):
    reported = [{"name": n, "value": v, "low": low, "high": high} for n, (v, low, high) in parameters.items()]
    return {"name": name, "members": members or {name: 1.0}, "parameters": reported}


def verdict(*effects, unknown=False, phase="slide", variable="place"):
    return {
        "cannot_tell": None,
        "hits": 200,
        "mismatch": {"found": bool(effects) or unknown, "p_value": 0.0005},
        "effects": list(effects),
        "unknown": {"flagged": unknown},
        "location": {"phase": phase, "variable": variable},
        "fit": dict.fromkeys(("nominal", "refitted", "augmented", "noise_floor"), ERRORS),
    }


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
