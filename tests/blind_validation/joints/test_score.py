"""Scores and measures of verdicts whose answer is known."""

import numpy as np
import pandas as pd
import pytest
from slapshot.blind_validation.joints.page import measures_of
from slapshot.blind_validation.joints.score import ANSWERS, COLUMNS

from .conftest import REFITTED, concealed, effect, verdict

SPRING = [concealed("spring")]


def table(*rows):
    return pd.DataFrame(rows).reindex(columns=list(COLUMNS))


def measured(*rows):
    return {(m.measure, m.condition): m for m in measures_of(table(*rows))}


def answers(row):
    return {answer: row[answer] for answer in ANSWERS if row.get(answer) is not None}


def test_a_row_holds_what_the_table_has(scored):
    rows = [
        scored("null", [], verdict()),
        scored("single", SPRING, verdict(effect("spring"))),
        scored("pair", [*SPRING, concealed("payload", body="lower")], verdict(effect("spring"))),
        scored("uncatalogued", [concealed("magnet", body="lower", catalogued=False)], verdict()),
    ]
    assert {key for row in rows for key in row} == set(COLUMNS)


def test_a_right_name_at_the_right_joint(scored):
    row = scored("single", SPRING, verdict(effect("spring"), p=0.001))
    assert answers(row) == {
        "cannot_tell": False,
        "detected": True,
        "named_first": True,
        "in_class": True,
        "joint_right": True,
        "false_unknown": False,
        "made_worse": False,
    }
    assert row["concealed"] == "spring@joint2 0.25 N m"
    assert row["named"] == "spring@joint2"
    assert (row["headline"], row["p_value"], row["size"]) == ("found", 0.001, 3.0)


@pytest.mark.parametrize(
    ("effects", "first", "in_class", "joint"),
    [
        ([effect("spring", "joint1")], True, True, False),
        ([effect("armature")], False, False, True),
        ([effect("armature", "joint2", "spring@joint2")], False, True, True),
        ([effect("armature", "joint1", "torque_ripple@joint1 from order 9.5")], False, False, False),
        # Named second, or a rival of what is named second, is no answer.
        ([effect("armature"), effect("spring")], False, False, True),
        ([effect("armature"), effect("payload", "lower", "spring@joint2")], False, False, True),
        ([], False, False, False),
    ],
)
def test_what_is_named_first_counts(scored, effects, first, in_class, joint):
    row = scored("single", SPRING, verdict(*effects))
    assert (row["named_first"], row["in_class"], row["joint_right"]) == (first, in_class, joint)


def test_an_alias_counts_on_its_rig_and_at_its_part_alone(scored):
    offset = [concealed("joint_offset", "joint1")]
    tilt = verdict(effect("gravity_tilt", ""))
    found = {}
    for rig in ("pendulum", "arm"):
        row = scored("single", offset, tilt, rig=rig)
        found[rig] = (row["named_first"], row["in_class"], row["joint_right"])
    assert found == {"pendulum": (True, True, True), "arm": (False, False, False)}
    # Tilt is more general: what leans across the axes is no offset.
    assert not scored("single", [concealed("gravity_tilt", None)], verdict(effect("joint_offset", "joint1")))[
        "named_first"
    ]
    rotor = [concealed("armature", "joint1")]
    reported = {
        part: scored("single", rotor, verdict(effect("link_mass", part)), rig="arm")["named_first"]
        for part in ("turret", "upper")
    }
    assert reported == {"turret": True, "upper": False}
    # Another effect without a part does not sit where the offset does.
    assert not scored("single", offset, verdict(effect("encoder_delay", "")))["joint_right"]


def test_a_rival_may_be_the_alias(scored):
    answer = verdict(effect("spring", "joint1", "gravity_tilt"))
    assert scored("single", [concealed("joint_offset", "joint1")], answer)["in_class"]


def test_effects_of_the_whole_rig_have_no_part(scored):
    tilt = [concealed("gravity_tilt", None)]
    assert scored("single", tilt, verdict(effect("gravity_tilt", "")))["joint_right"]
    assert not scored("single", tilt, verdict(effect("spring", "joint1")))["joint_right"]
    compliance = [concealed("base_compliance", body="base")]
    assert scored("single", compliance, verdict(effect("base_compliance", "")))["joint_right"]


@pytest.mark.parametrize(
    ("effects", "both"),
    [
        ([effect("payload", "lower"), effect("spring")], True),
        ([effect("armature"), effect("spring"), effect("payload", "lower")], True),
        ([effect("spring"), effect("spring", "joint1")], False),
        ([effect("spring", "joint2", "payload@lower")], False),
        ([], False),
    ],
)
def test_both_of_a_pair_must_be_named(scored, effects, both):
    row = scored("pair", [*SPRING, concealed("payload", body="lower")], verdict(*effects))
    assert row["both_named"] is both
    assert "named_first" not in row
    assert "false_unknown" not in row


def test_one_name_does_not_stand_for_two_kinds(scored):
    both = [concealed("joint_offset", "joint1"), concealed("gravity_tilt", None)]
    assert not scored("pair", both, verdict(effect("gravity_tilt", "")))["both_named"]
    answer = verdict(effect("gravity_tilt", ""), effect("joint_offset", "joint1"))
    assert scored("pair", both, answer)["both_named"]


@pytest.mark.parametrize(
    ("headline", "p", "below", "alarm"),
    [
        ("nothing_found", 0.3, False, False),
        ("nothing_found", 0.04, True, False),
        ("found_not_named", 0.001, True, True),
        ("cannot_tell", 0.5, False, False),
    ],
)
def test_nulls(scored, headline, p, below, alarm):
    row = scored("null", [], verdict(headline=headline, p=p))
    assert (row["p_below_05"], row["false_alarm"]) == (below, alarm)
    assert row["concealed"] == ""
    assert "detected" not in row


def test_a_name_for_nothing_is_a_false_alarm(scored):
    assert scored("null", [], verdict(effect("spring"), p=0.001))["false_alarm"]


@pytest.mark.parametrize(
    ("answer", "flagged"),
    [
        (verdict(headline="found_not_named", unknown=True), True),
        (verdict(effect("spring"), unknown=True), True),
        (verdict(effect("spring")), False),
        (verdict(), False),
        (verdict(headline="cannot_tell"), False),
    ],
)
def test_what_is_in_no_catalogue_is_to_be_called_unknown(scored, answer, flagged):
    magnet = [concealed("magnet", body="lower", catalogued=False)]
    row = scored("uncatalogued", magnet, answer)
    assert row["unknown_flagged"] is flagged
    assert "named_first" not in row
    assert "false_unknown" not in row
    assert scored("single", SPRING, answer)["false_unknown"] is flagged


def test_what_cannot_be_told_is_a_miss(scored):
    row = scored("single", SPRING, verdict(headline="cannot_tell"))
    assert answers(row) == {
        "cannot_tell": True,
        "detected": False,
        "named_first": False,
        "in_class": False,
        "joint_right": False,
        "false_unknown": False,
        "made_worse": False,
    }
    assert row["reason"] == "no joint moves"
    assert "held_out_over_floor" not in row
    pair = scored("pair", [*SPRING, concealed("payload", body="lower")], verdict(headline="cannot_tell"))
    assert pair["both_named"] is False
    found = measured(
        scored("single", SPRING, verdict(effect("spring"))),
        row | {"case": "j0002"},
        scored("null", [], verdict()),
    )
    assert found["named_first", "single"].value == 0.5
    assert found["named_first", "single"].n == 2
    assert found["cannot_tell", "single"].value == 0.5
    assert found["held_out_over_floor", "single"].n == 1


def test_worse_than_refitted_is_worse_than_its_interval(scored):
    for error, worse in ((REFITTED[0], False), (0.99 * REFITTED[2], False), (1.01 * REFITTED[2], True)):
        row = scored("single", SPRING, verdict(effect("spring"), error=error))
        assert row["made_worse"] is worse
        assert row["held_out_over_floor"] == pytest.approx(error / 0.001)


def test_measures_are_shares_of_their_condition(scored):
    right, wrong = verdict(effect("spring")), verdict(effect("armature", "joint1"))
    rows = [scored("single", SPRING, right)] * 3 + [scored("single", SPRING, wrong)]
    rows += [scored("single, cluttered", SPRING, wrong)]
    rows += [scored("null", [], verdict())] * 9 + [scored("null", [], verdict(effect("spring"), p=0.01))]
    found = measured(*rows)
    assert (found["named_first", "single"].value, found["named_first", "single"].n) == (0.75, 4)
    # Wilson's interval for 3 of 4, worked out by hand: (p + z2/2n -+ z sqrt(pq/n + z2/4n2)) / (1 + z2/n).
    assert found["named_first", "single"].low == pytest.approx(0.3006, abs=1e-4)
    assert found["named_first", "single"].high == pytest.approx(0.9544, abs=1e-4)
    assert found["named_first", "single, cluttered"].value == 0
    assert found["false_alarm", "null"].value == 0.1
    assert found["p_below_05", "null"].value == 0.1
    assert found["made_worse", "all"].n == 15
    assert ("named_first", "null") not in found
    assert ("false_alarm", "single") not in found


def test_times_and_errors_are_medians_by_what_was_concealed(scored):
    elastic = [concealed("joint_elasticity")]
    base = [concealed("base_compliance", body="base")]
    magnet = [concealed("magnet", body="lower", catalogued=False)]
    rows = [scored("null", [], verdict(cpu_s=seconds)) for seconds in (10, 20, 90)]
    rows += [
        scored("single", SPRING, verdict(effect("spring"), cpu_s=50, error=0.0011)),
        scored("single", elastic, verdict(effect("joint_elasticity"), cpu_s=100, error=0.0015)),
        scored("single", base, verdict(effect("base_compliance", ""), cpu_s=300, error=0.0013)),
        scored("uncatalogued", magnet, verdict(cpu_s=70)),
    ]
    found = measured(*rows)
    assert {key[1]: m.value for key, m in found.items() if key[0] == "cpu_s"} == {
        "all, nothing concealed": 20,
        "all, force effect": 50,
        "all, structural effect": 200,
        "all, uncatalogued": 70,
    }
    assert found["held_out_over_floor", "single"].value == pytest.approx(1.2)
    assert found["held_out_over_floor", "single"].n == 2
    assert found["held_out_over_floor", "single, elasticity or backlash"].value == pytest.approx(1.5)
    assert np.isfinite([m.value for m in found.values()]).all()
