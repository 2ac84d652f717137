"""Lists of cases: written, read, drawn and refused."""

from pathlib import Path

import numpy as np
import pytest
from slapshot.errors import InputError
from slapshot.lab.concealed.registry import KINDS
from slapshot.proof.cases import Case, read_cases, write_cases
from slapshot.proof.conditions import LISTS, PLAIN, WEAK, draw_list

CASES = [
    Case("a", "null", 2**47 + 1),
    Case("b", "pairs", 3, (("tilt", 0.7), ("curl", 1.25)), 100, "tracks only", 0.01, 0.04),
]


def test_a_list_reads_as_it_was_written(tmp_path):
    write_cases(CASES, tmp_path / "cases.csv")
    assert read_cases(tmp_path / "cases.csv") == CASES


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("tracks only", "tracks", "keep"),
        ("tilt:0.7", "tilt", "conceals"),
        ("b,pairs", "a,pairs", "case a"),
        ("condition", "state", "columns"),
    ],
)
def test_what_is_wrong_in_a_list_is_told_in_one_line(tmp_path, old, new, told):
    file = tmp_path / "cases.csv"
    write_cases(CASES, file)
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))
    with pytest.raises(InputError, match=told) as error:
        read_cases(file)
    assert str(file) in str(error.value)
    assert "\n" not in str(error.value)


def test_a_missing_list_is_told(tmp_path):
    with pytest.raises(InputError, match=r"none\.csv"):
        read_cases(tmp_path / "none.csv")


def test_settings_of_a_case_lie_over_those_that_all_share():
    base = {
        "camera": {"rate_hz": 50, "mistrack_share": 0},
        "objects": {"red": {}, "blue": {}},
        "hits": 1,
        "repeats": {"commands": 0, "times": 0},
    }
    settings = CASES[1].settings(base, 256)
    assert settings["hits"] == 50
    assert settings["repeats"] == base["repeats"]
    assert settings["keep"] == "tracks only"
    assert settings["camera"] == {"rate_hz": 50, "mistrack_share": 0.01, "noise_time_s": 0.04}
    assert settings["concealed"] == [
        {"kind": "tilt", "displacement": 0.7},
        {"kind": "curl", "displacement": 1.25},
    ]
    assert base["camera"] == {"rate_hz": 50, "mistrack_share": 0}


ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("published", ["published", "small", "tiny"])
def test_the_pool_has_commands_enough_for_every_case(published):
    """As `slapshot.lab.commands.draw_session` counts them; a case of 400 hits repeats some."""
    base = {"camera": {}, "objects": {"red": {}, "blue": {}}, "repeats": {"commands": 0, "times": 0}}
    pool = 256
    for case in read_cases(ROOT / f"config/cases/{published}.csv"):
        settings = case.settings(base, pool)
        repeats = settings["repeats"]
        single = settings["hits"] - repeats["commands"] * repeats["times"]
        assert single >= 0
        assert repeats["commands"] + 2 * single <= pool
        assert 2 * settings["hits"] == case.hits
        assert (repeats["commands"] > 0) == (case.hits > pool)


@pytest.fixture(scope="module")
def full():
    return draw_list(LISTS["full"], "f")


def test_a_drawn_list_has_every_condition_in_its_number(full):
    counts = {c.name: 0 for c in LISTS["full"]}
    for case in full:
        counts[case.condition] += 1
    assert counts["null"] == 200
    slides = [k for k in KINDS.values() if k.catalogued and k.phase in ("slide", "across hits", "camera")]
    plain = next(c for c in LISTS["full"] if c.name == "plain")
    assert counts["plain"] == plain.count * len(slides)
    assert all(counts.values())


def test_drawn_sizes_are_those_of_their_condition(full):
    for case in full:
        low, high = WEAK if case.condition == "weak" else PLAIN
        assert all(low <= size <= high for _, size in case.conceals)
        assert len(case.conceals) == (
            0 if "null" in case.condition else 2 if case.condition == "pairs" else 1
        )


def test_names_and_order_say_nothing_of_conditions(full):
    # In random order the place of nulls is uniform: their mean is within five standard errors of the middle.
    places = np.array([i for i, case in enumerate(full) if case.condition == "null"]) / (len(full) - 1)
    assert abs(places.mean() - 0.5) < 5 * np.sqrt(1 / 12 / len(places))
    assert [case.case for case in full] == [f"f{i:04d}" for i in range(len(full))]


def test_every_draw_has_seeds_of_its_own(full):
    again = draw_list(LISTS["full"], "f")
    seeds = [case.seed for case in full + again]
    assert len(set(seeds)) == len(seeds)
