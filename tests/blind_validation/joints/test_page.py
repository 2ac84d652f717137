"""The page: aims, what they come to, and every case that went wrong."""

import pandas as pd
import pytest
from slapshot.blind_validation.joints.page import AIMS, aim_outcome, is_wrong, measures_of, write_page
from slapshot.blind_validation.joints.score import COLUMNS

from .conftest import concealed, effect, verdict

SPRING = [concealed("spring")]


@pytest.fixture
def page(tmp_path):
    def run(*rows):
        cases = pd.DataFrame(rows).reindex(columns=list(COLUMNS))
        write_page(tmp_path / "page.md", cases, pd.DataFrame(measures_of(cases)))
        return (tmp_path / "page.md").read_text()

    return run


def row(value, low, high, measure="named_first", n=20):
    return {"measure": measure, "value": value, "low": low, "high": high, "n": n}


@pytest.mark.parametrize(
    ("measured", "aim", "answer"),
    [
        (row(0.95, 0.91, 0.98), (0.9, None), "reached"),
        (row(0.95, 0.85, 0.98), (0.9, None), "undecided"),
        (row(0.85, 0.75, 0.92), (0.9, None), "undecided"),
        (row(0.80, 0.72, 0.89), (0.9, None), "**missed**"),
        (row(0.01, 0.0, 0.02), (None, 0.02), "reached"),
        (row(0.0, 0.0, 0.03), (None, 0.02), "undecided"),
        (row(0.08, 0.03, 0.15), (None, 0.02), "**missed**"),
        (row(0.0, 0.0, 0.01), (None, 0.0), "reached"),
        (row(0.01, 0.001, 0.02), (None, 0.0), "**missed**"),
        (row(12.0, 11.0, 13.0, "cpu_s", 6), (None, 30), "reached"),
        (row(12.0, 11.0, 13.0, "cpu_s", 5), (None, 30), "undecided"),
    ],
)
def test_an_aim_is_reached_or_missed_where_the_whole_interval_says_so(measured, aim, answer):
    assert aim_outcome(measured, *aim) == answer


def test_the_page_tells_aims_and_that_the_lab_is_a_stand_in(scored, page):
    rows = [scored("null", [], verdict(), f"j{i}") for i in range(3)]
    text = page(*rows, scored("single", SPRING, verdict(effect("spring")), "j9"))
    assert "stand-in" in text
    assert "no real robot" in text
    assert "4 cases: 3 null, 1 single." in text
    assert "| false_alarm | null | at most 2 % | 0 % (0 to 56) | 3 | undecided |" in text
    assert "| named_first | single | at least 90 % | 100 % (21 to 100) | 1 | undecided |" in text
    assert "| held_out_over_floor | single | at most 1.10 | 1.00 (1.00 to 1.00) | 1 | undecided |" in text
    assert "| made_worse | all | none | 0 % (0 to 49) | 4 | reached |" in text
    assert "| cpu_s | all, nothing concealed | at most 30 s | 12 s (12 to 12) | 3 | undecided |" in text
    assert "pair" not in text.partition("## Aims")[2].partition("\n\n")[0]
    assert text.endswith("## What it got wrong\n\nNothing.\n")


def test_every_wrong_case_has_a_line(scored, page):
    magnet = [concealed("magnet", body="lower", catalogued=False)]
    rows = [
        scored("null", [], verdict(), "a1"),
        scored("null", [], verdict(headline="found_not_named", unknown=True, p=0.0004), "a2"),
        scored("single", SPRING, verdict(effect("spring")), "b1"),
        scored("single", SPRING, verdict(effect("armature", "joint1"), p=0.001), "b2"),
        scored("single", SPRING, verdict(headline="cannot_tell"), "b3"),
        scored("single", SPRING, verdict(effect("spring"), p=0.001, unknown=True, error=0.01), "b4"),
        scored("uncatalogued", magnet, verdict(p=0.6), "c1"),
    ]
    lines = page(*rows).partition("## What it got wrong\n\n")[2].splitlines()
    spring = "spring@joint2 0.25 N m, 3 times the noise"
    assert lines == [
        "- a2 (null, pendulum): nothing: found_not_named; p = 0.0004",
        f"- b2 (single, pendulum): {spring}: found (armature@joint1); p = 0.001",
        f"- b3 (single, pendulum): {spring}: cannot_tell (no joint moves); no p-value",
        f"- b4 (single, pendulum): {spring}: found (spring@joint2), something unknown, "
        "held-out prediction made worse; p = 0.001",
        "- c1 (uncatalogued, pendulum): magnet@lower 0.25 N m, 3 times the noise: nothing_found; p = 0.6",
    ]


def test_a_pair_of_which_one_is_named_is_wrong(scored):
    pair = [*SPRING, concealed("payload", body="lower")]
    assert is_wrong(dict.fromkeys(COLUMNS) | scored("pair", pair, verdict(effect("spring"))))
    both = verdict(effect("spring"), effect("payload", "lower"))
    assert not is_wrong(dict.fromkeys(COLUMNS) | scored("pair", pair, both))


def test_aims_are_of_measures_that_there_are(scored):
    """An aim under a name that nothing has would be left out of the page without a word."""
    pair = [*SPRING, concealed("payload", body="lower")]
    rows = [
        scored("null", [], verdict()),
        scored("null, cluttered", [], verdict()),
        scored("single", SPRING, verdict(effect("spring"))),
        scored("single", [concealed("backlash")], verdict(effect("backlash"))),
        scored("pair", pair, verdict(effect("spring"))),
        scored("uncatalogued", [concealed("magnet", catalogued=False)], verdict()),
    ]
    cases = pd.DataFrame(rows).reindex(columns=list(COLUMNS))
    assert set(AIMS) <= {(m.measure, m.condition) for m in measures_of(cases)}
