"""C1 on tables of a known filter: with drift its variance comes to rest, without it goes as 1 / n."""

import numpy as np
import pandas as pd
from slapshot.claims import c1

COUNTS = (0, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)  # of adaptation/regression.py
MODELS, TASKS, DRIFT = 3, 40, 1e-3
MEASURED = 0.1  # variance of one measurement


def variance(samples: int, drift: float, narrowing: float) -> float:
    """Of a scalar filter that starts at 1: p' = (p + q) r / (p + q + r)."""
    p = 1.0
    for _ in range(samples):
        p = (p + drift) * MEASURED / (p + drift + MEASURED)
    return p**narrowing


def contraction(drift: float = DRIFT, narrowing: float = 1.0, seed: int = 0) -> pd.DataFrame:
    """Two equal variances, times noise; they grow where `narrowing` is negative."""
    rng = np.random.default_rng(seed)
    rows = []
    for q in dict.fromkeys((drift, 0.0)):
        for n in COUNTS:
            for model in range(MODELS):
                for task in range(TASKS):
                    p = variance(n, q, narrowing) * rng.lognormal(0, 0.05)
                    rows.append((model, task, 2 * np.log(p), 2 * p, p, p**0.5, 0.9 * p**0.5, q, n))
    columns = ["model", "task", "log_determinant", "trace", "smallest_eigenvalue", "sd_y", "exact_sd_y",
               "drift", "samples"]  # fmt: skip
    return pd.DataFrame(rows, columns=columns)


def evaluate(write, table: pd.DataFrame) -> dict[str, str]:
    statements = c1.evaluate(write({"regression": table}, "contraction"))
    assert len({s.text for s in statements}) == len(statements)
    return {s.text: s.verdict for s in statements}


def test_a_filter_with_drift_narrows_and_stops(write):
    verdicts = evaluate(write, contraction())
    assert len(verdicts) == 6
    assert set(verdicts.values()) == {"holds"}


def test_numbers_are_those_of_the_filter(write):
    statements = c1.evaluate(write({"regression": contraction()}, "contraction"))
    by_text = {s.text: s.interval for s in statements}
    for n in (2, 10):
        p = variance(n, DRIFT, 1.0)
        # Ratios of means of 120 values with 5 % of noise, geometric or not: within 5 standard errors.
        error = 5 * 0.05 * np.sqrt(2 / (MODELS * TASKS))
        area = by_text[f"The belief over phi narrows by {n} samples"]
        assert abs(area.value / p - 1) < error
        y = by_text[f"The belief over y narrows by {n} samples"]
        assert abs(y.value / np.sqrt(p) - 1) < error
        assert y.low < np.sqrt(p) < y.high
    still = by_text["With Q = 0 it goes on narrowing, towards zero"]
    assert abs(still.value / 0.5 - 1) < error + 0.01  # 1 / n, but for the prior


def test_a_belief_that_widens_does_not_narrow(write):
    verdicts = evaluate(write, contraction(narrowing=-0.1))
    narrows = {text: verdict for text, verdict in verdicts.items() if " narrows by " in text}
    assert len(narrows) == 4
    assert set(narrows.values()) == {"does not hold"}


def test_drift_that_stops_nothing_and_none_that_stops_do_not_hold(write):
    table = contraction()
    swapped = table.assign(drift=DRIFT - table["drift"])
    verdicts = evaluate(write, swapped)
    assert verdicts["With Q = 0.001 I the belief over phi stops narrowing above zero"] == "does not hold"
    assert verdicts["With Q = 0 it goes on narrowing, towards zero"] == "does not hold"


def test_a_ratio_at_the_limit_is_undecided(write):
    table = contraction()
    last = (table["samples"] == 1000) & (table["drift"] == DRIFT)
    table.loc[last, "smallest_eigenvalue"] *= c1.LEVEL
    verdicts = evaluate(write, table)
    assert verdicts["With Q = 0.001 I the belief over phi stops narrowing above zero"] == "undecided"


def test_a_model_without_drift_is_judged_by_what_it_has(write):
    verdicts = evaluate(write, contraction(drift=0.0))
    assert len(verdicts) == 5
    assert set(verdicts.values()) == {"holds"}
