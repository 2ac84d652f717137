"""C5 on fabricated errors on recordings."""

import numpy as np
import pandas as pd
import pytest
from slapshot.claims import c5
from slapshot.claims.comparison import samples_needed, samples_to_reach

from .conftest import Curve, decay, error_rows, times

SAMPLES, RIGS = 32, 10
FAST, SLOW = decay(0.5, 0.1, 4.0), decay(0.5, 0.1, 8.0)
AS_CLAIMED = {
    "kalman": FAST,
    "lstm": SLOW,
    "maml_1": decay(0.5, 0.42, 1.0),  # ahead at first, then far behind
    "maml_4": decay(0.9, 0.1, 4.5),
    "maml_8": lambda n: np.where(n < 8, 0.55, 0.15),
}
AHEAD = "Kalman is ahead of LSTM with few samples"


def table(
    curve: Curve, seed: int, samples: int = SAMPLES, rigs: int = RIGS, red: float = 1.0, noise: float = 0.02
):
    parts = []
    for number, name in enumerate(("red", "blue")):
        keys = pd.DataFrame([(rig, r) for rig in range(rigs) for r in (0, 1)], columns=["rig", "repeat"])
        factor = red if name == "red" else 1.0
        own = error_rows(times(factor, curve), samples, keys.assign(object=name), 100 * number + seed, noise)
        parts.append(own.assign(stand_in=True))
    return pd.concat(parts, ignore_index=True)


@pytest.fixture
def evaluate(write):
    def run(tables: dict[str, pd.DataFrame]) -> dict[str, str]:
        statements = c5.evaluate(write(tables))
        assert len({s.text for s in statements}) == len(statements)
        return {s.text: s.verdict for s in statements}

    return run


def tables_of(curves: dict[str, Curve], **settings) -> dict[str, pd.DataFrame]:
    return {f"{method}/lab": table(curve, i, **settings) for i, (method, curve) in enumerate(curves.items())}


@pytest.mark.parametrize(
    ("curve", "error", "samples"),
    [
        ([5, 4, 3, 2, 1], 3, 2),
        ([5, 4, 3, 2, 1], 2.5, 2.5),
        ([5, 4, 3, 2, 1], 4.75, 0.25),
        ([5, 4, 3, 2, 1], 5, 0),
        ([5, 4, 3, 2, 1], 9, 0),
        ([5, 4, 3, 2, 1], 1, 4),
        ([5, 4, 3, 2, 1], 0.9, np.inf),
        ([5, 1, 3, 0, 0], 2, 0.75),  # the first time counts
        ([5, 5, 3], 4, 1.5),
        ([2], 3, 0),
        ([2], 1, np.inf),
    ],
)
def test_samples_to_reach_an_error(curve, error, samples):
    assert samples_to_reach(np.array(curve, float), error) == pytest.approx(samples)


def test_samples_needed_with_gaps_between_numbers_that_were_tried():
    """The mean falls from 9 to 5 over 4 samples and to 1 over the next 8: 6 after 3, 3 after 8."""
    curves = np.array([[[8.0, 4.0, 0.0], [10.0, 6.0, 2.0]]])
    samples = np.array([0.0, 4.0, 12.0])
    assert samples_needed(curves, np.array([5.0, 7.0]), samples) == pytest.approx(3)
    assert samples_needed(curves, np.array([[3.0]]), samples) == pytest.approx(8)
    assert samples_needed(curves, np.array([0.5]), samples) == 12


def test_what_is_as_claimed_holds(evaluate):
    verdicts = evaluate(tables_of(AS_CLAIMED))
    assert len(verdicts) == 2 + 2 + 6 + 1 + 2
    assert set(verdicts.values()) == {"holds"}


def test_lstm_half_as_fast_needs_twice_the_samples(write):
    """FAST after 8 is SLOW after 16, exactly; the curves are averaged over 3 models, 20 tasks and 2 pucks."""
    found = c5.evaluate(write(tables_of({"kalman": FAST, "lstm": SLOW})))[0]
    assert found.interval.value == pytest.approx(2, abs=0.05)
    assert found.interval.low < 2 < found.interval.high


def simulated(curve: Curve, seed: int) -> pd.DataFrame:
    """On test conditions: a number of them that is not that of the rigs."""
    keys = pd.DataFrame({"condition": range(3 * RIGS), "name": "", "noise_variance": 0.0})
    return error_rows(curve, SAMPLES, keys, seed=1000 + seed)


@pytest.mark.parametrize(
    ("on_rigs", "in_simulation", "verdict"),
    [(1.2, 1.05, "holds"), (1.05, 1.2, "does not hold"), (1.1, 1.1, "undecided")],
)
def test_the_lead_on_rigs_is_held_against_that_in_simulation(write, on_rigs, in_simulation, verdict):
    tables = tables_of({"kalman": FAST, "lstm": times(on_rigs, FAST)})
    for i, factor in enumerate((1.0, in_simulation)):
        curve = times(factor, decay(0.2, 0.04))  # everything is nearer in simulation
        tables[("kalman", "lstm")[i]] = simulated(curve, i)
    text = "With few samples Kalman's lead over LSTM is larger on recorded rigs than in simulation"
    (found,) = (s for s in c5.evaluate(write(tables)) if s.text == text)
    assert found.verdict == verdict
    assert found.interval.value == pytest.approx(on_rigs / in_simulation, rel=0.01)
    assert f"over {RIGS} rigs, a stand-in each, and " in found.note
    assert f"over {3 * RIGS} simulated conditions" in found.note


def test_a_method_that_never_gets_there_counts_as_needing_all_samples(write):
    found = c5.evaluate(write(tables_of({"kalman": FAST, "lstm": decay(0.5, 0.4)})))[0]
    assert (found.interval.value, found.interval.low) == (SAMPLES / 8, SAMPLES / 8)


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        (
            {"lstm": decay(0.5, 0.1, 2.0)},
            "LSTM needs more samples than Kalman for the error that Kalman has after 8",
        ),
        ({"lstm": decay(0.5, 0.1, 2.0)}, AHEAD),
        ({"lstm": decay(0.5, 0.1, 2.0)}, "Kalman is ahead of LSTM with few samples on the blue puck"),
        ({"maml_4": decay(0.3, 0.05, 2.0)}, "With few samples LSTM is ahead of MAML with 4 an update"),
        ({"maml_4": decay(0.6, 0.2)}, "MAML with 4 an update matches Kalman after about 20 samples"),
        ({"maml_1": decay(0.7, 0.65)}, "MAML with 1 an update is the better one at first"),
        ({"maml_1": decay(0.5, 0.1)}, "MAML with 1 an update converges to the larger error"),
    ],
)
def test_what_is_otherwise_does_not_hold(evaluate, changed, text):
    assert evaluate(tables_of({**AS_CLAIMED, **changed}))[text] == "does not hold"


def test_one_puck_alone_can_be_the_exception(evaluate):
    tables = tables_of({"kalman": FAST, "lstm": SLOW})
    tables["kalman/lab"] = table(FAST, 0, red=3.0)
    verdicts = evaluate(tables)
    assert verdicts["Kalman is ahead of LSTM with few samples on the red puck"] == "does not hold"
    assert verdicts["Kalman is ahead of LSTM with few samples on the blue puck"] == "holds"


def test_equal_methods_are_undecided(evaluate):
    verdicts = evaluate(tables_of({"kalman": FAST, "lstm": FAST}, noise=0.3))
    assert verdicts[AHEAD] == "undecided"


def test_rigs_of_two_recordings_count_apart_and_to_the_shorter_end(write):
    tables = tables_of(AS_CLAIMED)
    for i, (method, curve) in enumerate(AS_CLAIMED.items()):
        tables[f"{method}/mine"] = table(curve, 50 + i, samples=24, rigs=1).assign(stand_in=False)
    statements = c5.evaluate(write(tables))
    assert all(np.isfinite(s.interval.low) for s in statements)
    assert {s.verdict for s in statements} == {"holds"}
    assert all(f"over {RIGS + 1} rigs, of which some are real" in s.note for s in statements)
    assert any("after 24 samples" in s.measure for s in statements)


def test_few_recorded_samples_are_judged_as_far_as_they_go(write):
    statements = c5.evaluate(
        write(tables_of({"kalman": FAST, "lstm": SLOW, "maml_4": AS_CLAIMED["maml_4"]}, samples=5))
    )
    assert "after 5" in statements[0].text
    # FAST after 5 samples is beyond what SLOW reaches in 5.
    assert statements[0].interval.value == 1
    assert all(np.isfinite(s.interval.value) for s in statements)


def test_methods_that_are_not_there_are_not_judged(evaluate):
    assert evaluate(tables_of({"kalman": FAST})) == {}
    assert set(evaluate(tables_of({"lstm": SLOW, "maml_1": AS_CLAIMED["maml_1"]}))) == {
        "With few samples LSTM is ahead of MAML with 1 an update"
    }
