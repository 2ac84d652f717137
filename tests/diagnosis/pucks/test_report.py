"""The verdict as a file and in sentences: what is refused, and that its numbers are told."""

import json
import re
from dataclasses import fields, replace

import numpy as np
import pytest
from slapshot.diagnosis.pucks.report import read_verdict, terminal_text, wording, write_verdict
from slapshot.diagnosis.pucks.report.sentences import SCENES, headline, markdown
from slapshot.diagnosis.pucks.verdict import Location, Mismatch, NextHit, ParameterValue, Unknown, Verdict
from slapshot.diagnosis.pucks.verdict_file import VERDICT_FILE, VerdictFile
from slapshot.effects.catalogue import catalogue
from slapshot.errors import InputError
from slapshot.plotting import STAND_IN

from .conftest import VERSIONS

# --- verdict.json


@pytest.mark.parametrize("name", ["tilt", "nothing", "cannot tell"])
def test_verdicts_are_read_as_they_were_written(reports, name):
    verdict, versions = read_verdict(reports[name].folder)
    assert verdict == reports[name].verdict
    assert versions == VERSIONS


def test_every_key_of_the_verdict_must_be_there_and_no_other():
    schema = VerdictFile.model_json_schema()
    assert set(schema["properties"]) == {f.name for f in fields(Verdict)} | {"versions"}
    for part in [schema, *schema["$defs"].values()]:
        assert part["additionalProperties"] is False
        assert set(part["required"]) == set(part["properties"])


def changed(values, **changes):
    """Of the one named effect."""
    return values | {"effects": [values["effects"][0] | changes]}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            lambda v: v | {"opinion": "wind"},
            "opinion: unknown key 'opinion'; remove it",
        ),
        (lambda v: {k: x for k, x in v.items() if k != "notes"}, "top level: key 'notes' is missing; add it"),
        (
            lambda v: v | {"mismatch": v["mismatch"] | {"p_value": 1.5}},
            "mismatch.p_value: 1.5 is out of range; it must be <= 1",
        ),
        (
            lambda v: v | {"location": v["location"] | {"phase": "flight"}},
            "location.phase: 'flight' is not allowed; use one of: swing, contact, slide, across hits, camera",
        ),
        (lambda v: changed(v, members={}), "effects.0.members: is empty; add at least 1"),
        (
            lambda v: changed(v, members={"tilt": 2.0}),
            "effects.0.members.tilt: 2.0 is out of range; it must be <= 1",
        ),
        (
            lambda v: changed(v, shift_m=-1.0),
            "effects.0.shift_m: -1.0 is out of range; it must be >= 0",
        ),
        (lambda v: changed(v, colour="red"), "effects.0.colour: unknown key 'colour'"),
        (lambda v: changed(v, phase=None), "effects.0.phase: None is not allowed"),
        (
            lambda v: v | {"cannot_tell": "too few hits"},
            "top level: where cannot_tell is a text, mismatch must be null",
        ),
        (
            lambda v: v | {"mismatch": None},
            "top level: where cannot_tell is null, mismatch must hold what was found",
        ),
        (lambda v: v | {"versions": {"code": 3}}, "versions.code: 3 is not a text; write a text"),
        (lambda v: v | {"hits": 3.0}, "hits: 3.0 is not a whole number"),
        (lambda v: v | {"hits": True}, "hits: True is not a whole number"),
        (lambda v: v | {"stand_in": 1}, "stand_in: 1 is not a true or false"),
        (lambda v: v | {"fit": 3}, "fit: 3 is not a mapping"),
        (lambda v: v | {"rig": "a\x1b[31mb"}, "rig: 'a\\x1b[31mb' has an unprintable character"),
        (lambda v: [v], "top level: [{"),
    ],
)
def test_what_is_no_verdict_is_refused_in_one_line(tilt, tmp_path, change, said):
    file = tmp_path / VERDICT_FILE
    file.write_text(json.dumps(change(json.loads((tilt.folder / VERDICT_FILE).read_text()))))
    with pytest.raises(InputError) as error:
        read_verdict(tmp_path)
    assert str(error.value).startswith(f"{file}: {said}")
    assert str(error.value).endswith("; or diagnose the recording again")
    assert "\n" not in str(error.value)


def test_text_that_is_no_json_is_refused(tilt, tmp_path):
    text = (tilt.folder / VERDICT_FILE).read_text()
    for broken in (text[:-5], text.replace('"hits": ', '"hits": NaN, "hits": ', 1), ""):
        (tmp_path / VERDICT_FILE).write_text(broken)
        with pytest.raises(InputError, match=f"{VERDICT_FILE}: is not valid JSON"):
            read_verdict(tmp_path)


def test_what_could_not_be_read_again_is_not_written(tilt, tmp_path):
    with pytest.raises(ValueError, match=r"verdict: mismatch\.p_value: 1\.5 is out of range"):
        write_verdict(
            replace(tilt.verdict, mismatch=Mismatch(True, "tests", 1.5, 3.0, 0.1)), VERSIONS, tmp_path
        )
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("number", [float("nan"), float("inf")])
def test_numbers_that_are_none_are_not_written(tilt, tmp_path, number):
    with pytest.raises(ValueError, match="JSON"):
        write_verdict(replace(tilt.verdict, noise_sd_m=number), VERSIONS, tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_missing_verdict_is_said_in_one_line(tmp_path):
    with pytest.raises(InputError, match="diagnose the recording first"):
        read_verdict(tmp_path)


# --- Sentences


def rows_of(text, heading):
    """Cells of the table under a heading of Markdown."""
    part = text.split(f"## {heading}\n")[1].split("\n## ")[0]
    lines = [line for line in part.splitlines() if line.startswith("|")][2:]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines]


def numbers_in(cell):
    return [float(n) for n in cell.replace("(", " ").replace(")", " ").replace(" to ", " ").split()]


def test_verdict_md_says_what_is_missing_with_its_numbers(tilt):
    text, mismatch = tilt.text, tilt.verdict.mismatch
    assert text.startswith("# Something is missing: the board is tilted\n")
    assert f"p = {mismatch.p_value:.2g}" in text
    assert f"evidence {mismatch.log_evidence:.1f} nats" in text
    assert tilt.verdict.location.size in text
    assert STAND_IN in text
    for label, version in VERSIONS.items():
        assert f"| {label} | `{version}` |" in text


def test_parameters_are_given_in_mm_per_m(tilt):
    (effect,) = tilt.verdict.effects
    cells = rows_of(tilt.text, "What?")
    for row, parameter in zip(cells, effect.parameters, strict=True):
        assert row[0].startswith(wording.title(parameter.name))
        value, rest = row[1].split(" mm/m (")
        shown = [float(value), *(float(n) for n in rest.split(")")[0].split(" to "))]
        width = 1e3 * (parameter.high - parameter.low)
        wanted = [1e3 * parameter.value, 1e3 * parameter.low, 1e3 * parameter.high]
        np.testing.assert_allclose(shown, wanted, atol=0.05 * width)


@pytest.mark.parametrize("name", ["tilt", "nothing"])
def test_the_table_of_errors_is_that_of_the_verdict(reports, name):
    verdict = reports[name].verdict
    cells = rows_of(reports[name].text, "How much better?")
    by_scene = {row[0]: row[1:] for row in cells}
    shown = [s for s in SCENES if name == "tilt" or s != "augmented"]
    assert list(by_scene) == [SCENES[s] for s in shown]
    for scene in shown:
        errors = verdict.fit[scene]
        for cell, error in zip(
            by_scene[SCENES[scene]], (errors.track_rmse_m, errors.rest_rmse_m), strict=False
        ):
            wanted = [1e3 * error.value, 1e3 * error.low, 1e3 * error.high]
            np.testing.assert_allclose(numbers_in(cell), wanted, atol=0.0501)


def test_nothing_found_gives_limits(reports):
    made = reports["nothing"]
    assert made.text.startswith(
        "# Nothing found: the nominal scene predicts held-out hits to the noise floor\n"
    )
    cells = rows_of(made.text, "What it could still be")
    assert len(cells) == len(made.verdict.limits) > 0
    slopes = [limit.at_most for limit in made.verdict.limits if limit.effect == "tilt"]
    shown = [float(row[2].removesuffix(" mm/m")) for row in cells if row[0] == "tilt"]
    np.testing.assert_allclose(shown, np.multiply(1e3, slopes), rtol=6e-3)


def test_cannot_tell_says_why_and_what_to_record(reports):
    made = reports["cannot tell"]
    assert made.text.startswith("# Cannot tell\n")
    assert made.verdict.cannot_tell[1:] in made.text
    assert STAND_IN in made.text


def test_a_class_names_its_members_their_probabilities_and_the_reason(tilt):
    (effect,) = tilt.verdict.effects
    drag = replace(
        effect,
        name="linear_drag",
        variable="speed",
        members={"linear_drag": 0.61, "quadratic_drag": 0.36, "tilt": 0.03},
    )
    hits = (NextHit(np.pi / 2, 3.0, ("linear_drag", "quadratic_drag"), 5.6, None),)
    verdict = replace(tilt.verdict, effects=(drag,), next_hits=hits)
    assert headline(verdict) == (
        "Something is missing: most likely a drag in proportion to speed slows the object (61 %), else "
        "quadratic drag (36 %) or tilt (3 %)"
    )
    text = markdown(verdict)
    assert "cannot tell 3 effects apart: they follow different variables" in text
    assert "| quadratic drag | 36 % | the speed of the object |" in text
    assert rows_of(text, "What to record next") == [["+90", "3.0", "5.6"]]
    alike = replace(drag, members={"linear_drag": 0.6, "quadratic_drag": 0.4})
    assert "all of them follow the speed of the object" in markdown(replace(verdict, effects=(alike,)))


def test_what_the_catalogue_does_not_know_is_said(tilt):
    unknown = Unknown(True, "slide", "place", 31.0, 0.012, 0.48)
    verdict = replace(
        tilt.verdict,
        headline="found_not_named",
        effects=(),
        unknown=unknown,
        location=Location("slide", "place", "12 mm"),
        next_hits=(),
    )
    assert headline(verdict) == (
        "Something is missing that the catalogue does not know: it acts in the slide of the object and "
        "follows the place on the board"
    )
    assert "**Not in the catalogue** (probability 48 %): something acts" in markdown(verdict)
    assert "and something that the catalogue does not know" in headline(
        replace(tilt.verdict, unknown=unknown)
    )
    nowhere = replace(tilt.verdict, unknown=replace(unknown, phase=None, variable=None))
    assert "and something that the catalogue does not know" in headline(nowhere)
    left = nowhere.fit["augmented"].chi2_per_freedom.value
    assert f"something is left. With them held-out hits have a chi-squared of {left:.2f}" in markdown(nowhere)


def test_real_recordings_are_not_called_stand_ins(tilt):
    assert "stand-in" not in markdown(replace(tilt.verdict, stand_in=False))


@pytest.mark.parametrize("name", ["tilt", "nothing", "cannot tell"])
def test_the_terminal_gets_about_ten_lines(reports, name):
    lines = terminal_text(reports[name].verdict).splitlines()
    assert lines[0] == headline(reports[name].verdict)
    assert len(lines) <= 12
    assert STAND_IN in lines[1]


@pytest.mark.parametrize(
    ("name", "unit", "values", "text"),
    [
        ("slope_y", "m/m", (0.012, 0.011, 0.013), "12.0 mm/m (11.0 to 13.0), 0.69 degrees"),
        ("angle", "rad", (0.02, 0.015, 0.025), "1.15 degrees (0.86 to 1.43)"),
        ("delay", "s", (0.004, -0.001, 0.009), "4.0 ms (-1.0 to 9.0)"),
        ("log_scale", "1", (0.1, 0.0, 0.2), "+11 % (+0 to +22)"),
        ("log_speed", "log m/s", (-0.9, -1.2, -0.6), "0.41 m/s (0.30 to 0.55)"),
        ("rate", "1/s", (0.2, 0.1, 0.3), "0.20 1/s (0.10 to 0.30)"),
    ],
)
def test_units_are_those_that_a_person_uses(name, unit, values, text):
    assert wording.parameter_text(name, unit, *values) == text


def test_every_effect_of_the_catalogue_has_a_phrase_and_readable_parameters():
    for name, effect in catalogue().items():
        assert name in wording.PHRASES
        assert effect.follows in wording.VARIABLES
        assert effect.phase in wording.PHASES
        for p in effect.parameters:
            assert "log" not in wording.parameter_label(p.name, p.meaning).split(":")[0]


def test_a_bump_of_a_field_is_told_by_its_place(tilt):
    bump = ParameterValue("height_32", "m", 0.012, -0.002, 0.026, "height of one bump")
    effect = replace(tilt.verdict.effects[0], name="uneven_board", parameters=(bump,))
    text = markdown(replace(tilt.verdict, effects=(effect,)))
    assert "height around x 0.7 m, y 0.0 m | 12 mm (-2 to 26)" in text
    assert "strongest bumps of a field" in text


# --- What rigs, objects and effects are called

NASTY = "<script>alert(1)</script>\n# Nothing found\x1b[31m | [a](http://b) `c` **d**"


def test_names_from_outside_are_shown_and_do_nothing(tilt):
    effect = replace(tilt.verdict.effects[0], name=NASTY, members={NASTY: 0.6, "tilt": 0.4}, physics=NASTY)
    verdict = replace(tilt.verdict, rig=NASTY, effects=(effect,), notes=(NASTY,), findings=(NASTY,))
    text = markdown(verdict)
    assert "<script" not in text
    assert "\x1b" not in text
    assert not re.search(r"(?<!\\)\]\(http", text)
    assert [line for line in text.splitlines() if line.startswith("# ")] == [text.splitlines()[0]]
    for line in text.splitlines():
        if line.startswith("|"):
            assert len(re.split(r"(?<!\\)\|", line)) in {4, 5, 6}, line
    shown = terminal_text(verdict)
    assert "\x1b" not in shown
    assert len(shown.splitlines()) < 20
    untold = replace(verdict, headline="cannot_tell", cannot_tell=NASTY, mismatch=None)
    assert "<script" not in markdown(untold)
    assert "\x1b" not in terminal_text(untold)
