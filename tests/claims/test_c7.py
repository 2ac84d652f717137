"""C7 on hidden states that are a known function of friction."""

import numpy as np
import pandas as pd
import pytest
from slapshot.claims import c7

MODELS, CONDITIONS, REPEATS, H = 3, 40, 2, 5
FIRST = "The first component follows the magnitude of friction rather than its direction"
SECOND = "The second component follows the direction of friction rather than its magnitude"
BETWEEN = "The recorded pucks lie between low and medium friction"


def hidden(
    magnitude: np.ndarray, direction: np.ndarray, scales: tuple[float, float, float], model: int
) -> list:
    """(n) vectors: magnitude and direction along axes of the model's own, and noise along another."""
    rng = np.random.default_rng(model)
    axes = np.linalg.qr(rng.normal(size=(H, H)))[0][:3]
    parts = np.stack([magnitude, direction, rng.normal(size=len(magnitude))], axis=1) * scales
    return list(parts @ axes + rng.normal(size=H) + rng.normal(0, 0.01, (len(magnitude), H)))


def latents(scales=(3.0, 1.0, 0.0), recorded: float | None = 0.35, named: bool = True, samples=(8, 20)):
    """Drawn conditions, those named low and medium (frictions 0.2 and 0.5), and rigs of one friction."""
    rng = np.random.default_rng(100)
    x = np.exp(rng.uniform(-1.5, 0, CONDITIONS))
    y = x * np.exp(rng.uniform(-0.5, 0.5, CONDITIONS))
    drawn = pd.DataFrame({"condition": range(CONDITIONS), "name": "", "friction_x": x, "friction_y": y})
    tables = [drawn.assign(source="simulated", noise_variance=v) for v in (0.0, np.nan)]
    if named:
        frictions = {"low friction": 0.2, "medium friction": 0.5}
        for number, (name, mu) in enumerate(frictions.items()):
            row = {"condition": [CONDITIONS + number], "name": name, "friction_x": mu, "friction_y": mu}
            tables.append(pd.DataFrame(row).assign(source="simulated", noise_variance=0.0))
    simulated = pd.concat(tables).assign(recording="", rig=-1, object="")
    parts = [simulated]
    if recorded is not None:
        rigs = pd.DataFrame({"rig": range(8)}).assign(
            source="recorded", recording="lab", object="red", name=""
        )
        mu = recorded * np.exp(rng.normal(0, 0.1, len(rigs)))
        parts.append(rigs.assign(friction_x=mu, friction_y=mu, condition=-1))
    keys = pd.concat(parts, ignore_index=True)
    rows = []
    for model in range(MODELS):
        each = pd.concat([keys.assign(repeat=r, samples=n) for r in range(REPEATS) for n in samples])
        log_x, log_y = np.log(each["friction_x"].to_numpy()), np.log(each["friction_y"].to_numpy())
        rows.append(
            each.assign(model=model, hidden=hidden((log_x + log_y) / 2, log_y - log_x, scales, model))
        )
    table = pd.concat(rows, ignore_index=True)
    # What the friction of a recording is, nobody tells.
    table.loc[table["source"] == "recorded", ["friction_x", "friction_y"]] = np.nan
    return table


@pytest.fixture
def evaluate(write):
    def run(table: pd.DataFrame) -> dict[str, str]:
        statements = c7.evaluate(write({"beliefs": table}, "latents"))
        return {s.text: s.verdict for s in statements}

    return run


def test_what_is_as_claimed_holds(evaluate):
    assert evaluate(latents()) == {FIRST: "holds", SECOND: "holds", BETWEEN: "holds"}


def test_components_in_the_other_order_do_not_hold(evaluate):
    verdicts = evaluate(latents(scales=(0.5, 4.0, 0.0)))
    assert verdicts[FIRST] == "does not hold"
    assert verdicts[SECOND] == "does not hold"


def test_components_that_follow_neither_are_undecided(evaluate):
    """Most of the variance lies along something that is neither."""
    verdicts = evaluate(latents(scales=(0.2, 0.2, 5.0)))
    assert verdicts[FIRST] == "undecided"


@pytest.mark.parametrize(
    ("friction", "verdict"),
    [(0.1, "does not hold"), (0.9, "does not hold"), (0.2, "undecided"), (0.3, "holds")],
)
def test_recorded_pucks_are_placed_by_their_hidden_state(evaluate, friction, verdict):
    assert evaluate(latents(recorded=friction))[BETWEEN] == verdict


def test_place_is_that_of_the_logarithm_of_friction(write):
    """ln(0.3162 / 0.2) over ln(0.5 / 0.2) is 0.5; eight rigs scatter by 10 %."""
    found = c7.evaluate(write({"beliefs": latents(recorded=0.3162)}, "latents"))[2].interval
    assert found.value == pytest.approx(0.5, abs=5 * 0.1 / np.log(2.5) / np.sqrt(8))


@pytest.mark.parametrize("missing", [{"recorded": None}, {"named": False}])
def test_without_recordings_or_named_conditions_there_is_no_place(evaluate, missing):
    assert evaluate(latents(**missing)) == {FIRST: "holds", SECOND: "holds"}


def test_states_after_twenty_samples_are_judged(evaluate):
    """At other numbers of samples they may belong to anything."""
    table = latents(samples=(8, 20, 32))
    for seed, (_, rows) in enumerate(table[table["samples"] != 20].groupby(["model", "samples"])):
        order = np.random.default_rng(seed).permutation(len(rows))
        table.loc[rows.index, "hidden"] = rows["hidden"].to_numpy()[order]
    assert evaluate(table) == {FIRST: "holds", SECOND: "holds", BETWEEN: "holds"}
