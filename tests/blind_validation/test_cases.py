"""Lists of cases: written, read, drawn and refused."""

from pathlib import Path

import numpy as np
import pytest
from slapshot.blind_validation.cases import Case, read_cases, write_cases
from slapshot.blind_validation.lists import LISTS, TYPICAL_SIZES, WEAK_SIZES, draw_list
from slapshot.config.files import load_config
from slapshot.config.lab import Lab
from slapshot.errors import InputError
from slapshot.lab.hidden_effects.registry import HIDDEN_EFFECTS
from slapshot.validation import values_of

ROOT = Path(__file__).parents[2]
CASES = [
    Case("a", "null", 2**47 + 1),
    Case("b", "pairs", 3, (("tilt", 0.7), ("curl", 1.25)), 100, "tracks only", 0.01, 0.04, 0.1, 0.05),
]


def test_a_list_reads_as_it_was_written(tmp_path):
    write_cases(CASES, tmp_path / "cases.csv")
    assert read_cases(tmp_path / "cases.csv") == CASES


@pytest.mark.parametrize(
    ("old", "new", "reported"),
    [
        ("tracks only", "tracks", ":3: keep: 'tracks' is not allowed; use one of: full"),
        ("tilt:0.7", "tilt", ":3: conceals.0.displacement: '' is not a number; write a number"),
        ("tilt:0.7", "tilt:nan", ":3: conceals.0.displacement: nan is not a finite number; write one"),
        ("tilt:0.7", "tilt:-1", ":3: conceals.0.displacement: -1 is out of range; it must be > 0"),
        ("tilt:0.7", "tilt:1e9", ":3: conceals.0.displacement: 1000000000.0 is out of range; it must be <="),
        ("tilt:0.7", "tilt:0.7:3", ":3: conceals.0.displacement: '0.7:3' is not a number"),
        ("tilt:0.7", "tit:0.7", ":3: conceals.0.kind: 'tit' is not allowed; write tilt"),
        ("tilt:0.7", "curl:0.7", ":3: conceals: curl.curl names a kind twice; name it once"),
        ("b,pairs", "a,pairs", ":3: case a stands twice; give every case a name of its own"),
        ("b,pairs", "-b,pairs", ":3: case: '-b' is not allowed; use letters, digits"),
        ("b,pairs", "b/c,pairs", ":3: case: 'b/c' is not allowed"),
        ("b,pairs", ",pairs", ":3: case: '' is not allowed"),
        ("b,pairs", "b,<script>", ":3: condition: '<script>' is not allowed; use"),
        ("b,pairs", "b,pa|irs", ":3: condition: 'pa.irs' is not allowed"),
        ("condition", "state", ":1: columns are .*; write case, condition, seed"),
        (",3,", ",3.5,", ":3: seed: 3.5 is not a whole number; write a whole number"),
        (",3,", ",,", ":3: seed: '' is not a whole number"),
        (",3,", ",-3,", ":3: seed: -3 is out of range; it must be >= 0"),
        (",3,", f",{10**30},", ":3: seed: the number has more than 18 digits; write a smaller one"),
        (",100,", ",0,", ":3: hits: 0 is out of range; it must be >= 1"),
        (",100,", ",1000000000,", ":3: hits: 1000000000 is out of range; it must be <= 100000"),
        (",100,", ",100,100,", ":3: has 11 values; write 10: case, condition"),
        (",100,", ",", ":3: has 9 values; write 10: case, condition"),
        (",0.01,", ",1.5,", ":3: mistracks: 1.5 is out of range; it must be <= 1"),
        (",0.04", ",inf", ":3: noise_time: inf is not a finite number; write one"),
        (",0.04", ',"0.04', "not valid CSV .*; mend that line"),
        (",0.04", ",0.04\x1b", ":3: noise_time: .* has an unprintable character; remove it"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_a_list_of_cases_is_told_with_its_line(tmp_path, old, new, reported):
    file = tmp_path / "cases.csv"
    write_cases(CASES, file)
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))
    with pytest.raises(InputError, match=f"^{file}.*{reported}") as error:
        read_cases(file)
    assert str(error.value).isprintable()


@pytest.mark.parametrize(
    ("content", "reported"),
    [
        (b"", ":1: columns are ''; write case, condition"),
        (b"\xff\xfe\x00", ":1: not a text in UTF-8; save it as one"),
        ((ROOT / "config/cases/tiny.csv").read_bytes().splitlines()[0], ": holds no case; add a row"),
    ],
)
def test_a_list_of_no_cases_is_told(tmp_path, content, reported):
    file = tmp_path / "cases.csv"
    file.write_bytes(content)
    with pytest.raises(InputError, match=f"^{file}{reported}"):
        read_cases(file)


def test_a_missing_list_is_told(tmp_path):
    with pytest.raises(InputError, match=r"none\.csv"):
        read_cases(tmp_path / "none.csv")


@pytest.fixture
def base(monkeypatch) -> Lab:
    """What all cases of the default configuration share."""
    monkeypatch.chdir(ROOT)
    return load_config().lab_of_cases


def test_settings_of_a_case_lie_over_those_that_all_share(base):
    settings = CASES[1].settings(base, 256)
    assert settings.hits == 50
    assert settings.repeats == base.repeats
    assert settings.keep == "tracks only"
    assert values_of(settings.camera) == values_of(base.camera) | {
        "mistrack_share": 0.01,
        "noise_time_s": 0.04,
        "stamp_jitter_share": 0.1,
        "outlier_share": 0.05,
    }
    assert [(one.kind, one.displacement) for one in settings.concealed] == [("tilt", 0.7), ("curl", 1.25)]
    kept = ("objects", "blade", "board", "friction_field", "scatter", "joints", "scale_sd_kg")
    assert all(getattr(settings, key) == getattr(base, key) for key in kept)


@pytest.mark.parametrize("name", ["hits", "small", "tiny"])
def test_the_pool_has_commands_enough_for_every_case(name, base):
    """As `slapshot.lab.commands.draw_session` counts them; a case of 400 hits repeats some."""
    pool = 256
    for case in read_cases(ROOT / f"config/cases/{name}.csv"):
        settings = case.settings(base, pool)
        repeats = settings.repeats
        single = settings.hits - repeats.hits
        assert single >= 0
        assert repeats.commands + 2 * single <= pool
        assert 2 * settings.hits == case.hits
        assert (repeats.commands > 0) == (case.hits > pool)


@pytest.fixture(scope="module")
def full():
    return draw_list(LISTS["full"], "f")


def test_a_drawn_list_has_every_condition_in_its_number(full):
    counts = {c.name: 0 for c in LISTS["full"]}
    for case in full:
        counts[case.condition] += 1
    assert counts["null"] == 150
    slides = [
        k for k in HIDDEN_EFFECTS.values() if k.catalogued and k.phase in ("slide", "across hits", "camera")
    ]
    plain = next(c for c in LISTS["full"] if c.name == "plain")
    assert counts["plain"] == plain.count * len(slides)
    assert all(counts.values())


def test_drawn_sizes_are_those_of_their_condition(full):
    for case in full:
        low, high = WEAK_SIZES if case.condition == "weak" else TYPICAL_SIZES
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
