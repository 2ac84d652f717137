"""No sentence, number or arrow of a report contradicts another."""

import json
import shutil

import pandas as pd
import pytest

from .report_rules import contradictions

HEADLINES = {
    "tilt": "found",
    "nothing": "nothing_found",
    "not named": "found_not_named",
    "cannot tell": "cannot_tell",
    "no fit": "cannot_tell",
    "few carry it": "cannot_tell",
}


@pytest.mark.parametrize("name", HEADLINES)
def test_reports_do_not_contradict_themselves(reports, name):
    verdict = json.loads((reports[name].folder / "verdict.json").read_text())
    assert verdict["headline"] == HEADLINES[name]
    assert contradictions(reports[name].folder) == []


def test_hits_are_named_that_are_to_blame_where_a_fit_cannot_be_trusted(reports):
    verdict = reports["no fit"].verdict
    assert verdict.hits_to_blame
    assert set(verdict.hits_to_blame) <= set(range(30))
    for text in (verdict.cannot_tell, reports["no fit"].text):
        assert all(str(hit) in text for hit in verdict.hits_to_blame)


def test_what_a_check_found_is_used_and_shown(reports):
    verdict = reports["no fit"].verdict
    assert any("friction differs from hit to hit" in finding for finding in verdict.findings)
    assert "What a check of the recording found odd" in reports["no fit"].text


def edited(file, change):
    values = json.loads(file.read_text())
    change(values)
    file.write_text(json.dumps(values))


def limits(verdict):
    verdict["limits"] = [{"effect": "tilt", "parameter": "slope_x", "unit": "m/m", "at_most": 0.001}]


def floor(verdict):
    verdict["fit"]["refitted"]["chi2_per_freedom"] = {"value": 6.2, "low": 5.1, "high": 7.4}


def evidence(verdict):
    verdict["mismatch"] |= {"p_value": 0.08, "log_evidence": 98.1, "shift_m": 0.0388}


def worse(verdict):
    verdict["fit"]["augmented"]["rest_rmse_m"] = {"value": 0.074, "low": 0.06, "high": 0.09}


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("nothing", floor, "held-out chi-squared"),
        ("nothing", evidence, "evidence of 98 nats"),
        ("nothing", lambda v: v["mismatch"].update(found=True), "mismatch.found"),
        ("tilt", limits, "limits"),
        ("tilt", worse, "makes rest_rmse_m worse"),
        ("tilt", lambda v: v.update(headline="nothing_found"), "the page begins"),
        ("tilt", lambda v: v.update(effects=[]), "0 effects are named"),
        ("no fit", limits, "limits"),
        ("no fit", lambda v: v.update(noise_sd_m=0.0001), "noise_sd_m is"),
    ],
)
def test_contradictions_are_seen(reports, tmp_path, name, change, said):
    folder = shutil.copytree(reports[name].folder, tmp_path / "report")
    edited(folder / "verdict.json", change)
    assert any(said in line for line in contradictions(folder))


def test_arrows_that_speak_against_the_headline_are_seen(reports, tmp_path):
    folder = shutil.copytree(reports["nothing"].folder, tmp_path / "report")
    table = pd.read_csv(folder / "D1-location.csv")
    table.loc[table.index[:9], "significant"] = True
    table.to_csv(folder / "D1-location.csv", index=False)
    assert any("marks 9 places" in line for line in contradictions(folder))
