"""Ranges from beliefs: the stages on a world that is known, the claim and the figure."""

import json

import numpy as np
import pandas as pd
import pytest
import torch
import yaml
from slapshot.adaptation.data import Standardiser
from slapshot.claims import s11
from slapshot.command import Run
from slapshot.config.methods import EnsembleTraining, KalmanSettings
from slapshot.config.randomisation import Draw, Draws
from slapshot.config.refinement import RefinedRolloutsSettings, RefinedTrainSettings
from slapshot.config.rollouts import RolloutsSettings
from slapshot.figures import a3_refinement, a5_refined
from slapshot.refinement import rollouts as refined_rollouts
from slapshot.refinement import train as refined_train
from slapshot.refinement.__main__ import NOISE, Prior, configuration
from slapshot.refinement.coverage import produce as cover
from slapshot.refinement.errors import ALL_RANGES, REFINED
from slapshot.refinement.refined import narrowed, refined_settings
from slapshot.rollouts.reading import Sequences
from slapshot.validation import values_of
from told import FIGURE

RANDOMISATION = Draws(
    mass=Draw(uniform=[0.01, 0.1]),
    friction_x=Draw(uniform=[0.15, 0.95]),
    friction_y=Draw(uniform=[0.7, 1.3], times="friction_x"),
    friction_torsional=Draw(uniform=[0.001, 0.05]),
    friction_rolling=Draw(uniform=[0.2, 0.2]),
    start_error=Draw(normal=[0.0, 0.02]),
)


def test_only_what_is_drawn_is_refined_and_ratios_stay_ratios():
    prior = Prior(RANDOMISATION, 0.5)
    conditions = pd.DataFrame(
        {"mass": [0.05], "friction_x": [0.4], "friction_y": [0.44], "friction_torsional": [0.01],
         "friction_rolling": [0.2]}
    )  # fmt: skip
    found = prior.parameters(conditions)
    assert np.exp(found[0]) == pytest.approx([0.01, 0.4, 1.1, 0.05])
    rows = prior.rows(np.repeat(found, 3, axis=0), np.log([0.1, 0.2, 0.3]))
    assert [row["parameter"] for row in rows] == [
        "friction_torsional",
        "friction_x",
        "friction_y",
        "mass",
        NOISE,
    ]
    assert rows[2]["median"] == pytest.approx(1.1)
    assert (rows[4]["low"], rows[4]["high"], rows[4]["prior_high"]) == pytest.approx((0.1, 0.3, 0.5))


def test_a_refined_range_is_never_outside_of_what_was_drawn_from_and_has_a_width():
    prior = Prior(RANDOMISATION, 0.5)
    far = np.log(np.array([[0.01, 0.9, 1.0, 1.0], [0.01, 0.92, 1.0, 2.0], [0.01, 3.0, 1.0, 9.0]]))
    rows = {row["parameter"]: row for row in prior.rows(far, np.log([0.6, 0.7, 0.8]))}
    assert (rows["mass"]["low"], rows["mass"]["high"]) == pytest.approx((0.0955, 0.1))
    assert (rows["friction_x"]["low"], rows["friction_x"]["high"]) == pytest.approx((0.9, 0.95))
    assert rows["friction_y"]["high"] - rows["friction_y"]["low"] == pytest.approx(0.03)
    for row in rows.values():
        assert row["prior_low"] <= row["low"] <= row["median"] <= row["high"] <= row["prior_high"]


def table(rigs: int = 4, shift: float = 1.0) -> pd.DataFrame:
    rows = []
    for rig in range(rigs):
        for name in ("red", "blue"):
            for parameter, middle in (("mass", 0.05), ("friction_x", 0.4), ("friction_y", 1.0),
                                      ("friction_torsional", 0.01), (NOISE, 0.1)):  # fmt: skip
                known = parameter != NOISE
                low, high = RANDOMISATION.of_parameter(parameter).numbers if known else (0.0, 0.5)
                rows.append(
                    {"recording": "lab", "rig": rig, "object": name, "parameter": parameter,
                     "low": 0.8 * shift * middle, "median": shift * middle, "high": 1.25 * shift * middle,
                     "prior_low": low, "prior_high": high}
                )  # fmt: skip
    return pd.DataFrame(rows)


def simulated(share: float, conditions: int = 40) -> pd.DataFrame:
    """Ranges of which a share holds the truth, the same of all parameters."""
    rows = [
        {"condition": number, "parameter": parameter, "low": 0.8, "median": 1.0, "high": 1.25,
         "truth": 1.0 if number < share * conditions else 2.0}
        for number in range(conditions)
        for parameter in ("mass", "friction_x", "friction_y", "friction_torsional", NOISE)
    ]  # fmt: skip
    return pd.DataFrame(rows)


def test_a_rig_s_configuration_holds_all_its_objects():
    own = table(1)
    own.loc[own["object"] == "blue", ["low", "high"]] *= 1.5
    told = configuration(own, "hockey", "0")
    domain = told["domains"]["hockey"]
    assert domain["randomisation"]["friction_x"]["uniform"] == pytest.approx([0.32, 0.75])
    assert domain["training"]["noise_variance_max"] == pytest.approx(0.1875)
    assert NOISE not in domain["randomisation"]
    assert yaml.safe_load(yaml.safe_dump(told)) == told
    assert told["name"] == "refined-lab-0"


@pytest.fixture
def covered(tmp_path):
    """Stage `coverage` of four rigs; `shift` moves all ranges, the truth is in the middle of unmoved ones."""

    def make(shift: float) -> dict:
        refined, out = tmp_path / "refinement", tmp_path / "coverage"
        inputs = {"refinement": refined}
        for folder in (refined, out):
            folder.mkdir()
        table(shift=shift).to_parquet(refined / "refinement.parquet")
        simulated(0.95).to_parquet(refined / "simulated.parquet")
        for rig in range(4):
            inputs[f"lab/lab/{rig}"] = tmp_path / f"lab{rig}"
            (tmp_path / f"lab{rig}" / "truth").mkdir(parents=True)
            # The blue puck is heavier than anything that training drew.
            objects = {
                name: {"mass": mass, "friction_x": 0.4, "friction_y": 0.4, "friction_torsional": 0.01}
                for name, mass in (("red", 0.05), ("blue", 0.163))
            }
            text = json.dumps({"rig": {"objects": objects}})
            (tmp_path / f"lab{rig}" / "truth" / "truth.json").write_text(text)
        cover(Run({}, inputs, out, 1))
        return {"coverage": out}

    return make


def test_truth_is_looked_for_in_the_ranges(covered):
    found = pd.read_parquet(covered(1.0)["coverage"] / "coverage.parquet")
    assert NOISE not in set(found["parameter"])
    blue = (found["object"] == "blue") & (found["parameter"] == "mass")
    assert found.loc[~blue, "inside"].all()
    assert not found.loc[blue, ["inside", "drawable"]].any(axis=None)
    assert found.loc[~blue, "drawable"].all()


@pytest.mark.parametrize(("shift", "verdict"), [(1.0, "holds"), (0.6, "does not hold")])
def test_the_verdict_is_the_share_of_truths_inside(covered, shift, verdict):
    statements = s11.evaluate(covered(shift))
    assert [s.verdict for s in statements] == [*[verdict] * 4, "holds"]
    assert statements[4].interval.value == pytest.approx(0.95)
    assert "40 validation conditions" in statements[4].note
    assert f"middle is {shift:.2f} times the truth" in statements[0].note
    inside = 4 if verdict == "holds" else 0
    mass = f"{inside} of 4 rigs and pucks, without 4 whose truth training cannot draw; "
    assert statements[2].note.startswith(mass)
    assert statements[0].note.startswith(f"{2 * inside} of 8 rigs and pucks; ")


def test_the_figure_shows_ranges_and_truths(covered):
    drawing = a3_refinement.draw(covered(0.6), FIGURE)
    drawing.figure.canvas.draw()
    assert drawing.name == "A3-hockey-refinement"
    titles = [axes.get_title(loc="left") for axes in drawing.figure.axes]
    simulation = "in simulation: 95 % of 40 conditions"
    assert titles[0] == f"friction along x\ntruths inside: 0 of 8 (0 %)\n{simulation}"
    # The blue puck of each of four rigs is heavier than anything that training drew.
    assert titles[2] == f"mass (kg)\ntruths inside: 0 of 4 (0 %); 4 left out\n{simulation}"
    assert set(drawing.table["simulated_share"]) == {0.95}
    assert set(drawing.table["simulated_n"]) == {40}


def test_narrowed_ranges_keep_what_was_not_refined(tmp_path):
    told = configuration(table(1), "hockey", "0")
    (tmp_path / "rig-0.yaml").write_text(yaml.safe_dump(told))
    refined = refined_settings(tmp_path, "hockey", 0)
    assert values_of(refined) == told["domains"]["hockey"]
    found = narrowed(RANDOMISATION, refined)
    assert values_of(found.friction_y) == {"uniform": pytest.approx([0.8, 1.25]), "times": "friction_x"}
    assert found.friction_rolling == RANDOMISATION.friction_rolling
    assert found.start_error == RANDOMISATION.start_error


def test_refined_rollouts_are_rollouts_with_other_ranges(tmp_path, monkeypatch):
    told = configuration(table(1), "own", "0")
    (tmp_path / "rig-0.yaml").write_text(yaml.safe_dump(told))
    made: list[RolloutsSettings] = []
    monkeypatch.setattr(refined_rollouts, "simulate", lambda settings, *_: made.append(settings))
    rollouts = RolloutsSettings(
        domain="hockey", seed=1, train=4, validation=1, test=1, hits=7, track_share=0.1, track_period_s=0.02,
        named_conditions={}, randomisation=RANDOMISATION,
    )  # fmt: skip
    config = values_of(RefinedRolloutsSettings.from_parts(rollouts, name="own", rig=0))
    refined_rollouts.produce(Run(config, {"refinement": tmp_path}, tmp_path, 1))
    assert made[0].randomisation.mass.uniform == pytest.approx([0.04, 0.0625])
    assert RolloutsSettings.from_parts(made[0], randomisation=RANDOMISATION) == rollouts


def test_noise_means_as_many_metres_in_other_units(tmp_path, monkeypatch):
    """Outcomes of refined rollouts spread half as far: a variance is four times as large in their units."""
    rng = np.random.default_rng(0)
    outcome = rng.normal(size=(50, 20, 2)).astype(np.float32)
    before = Sequences(outcome, outcome, 2 * outcome, pd.DataFrame())
    after = Sequences(outcome, outcome, outcome, pd.DataFrame())
    monkeypatch.setattr(refined_train, "load_ensemble", lambda folder: (None, Standardiser.fit(before)))
    monkeypatch.setattr(refined_train, "read_sequences", lambda folder, split: after)
    told = configuration(table(1), "own", "0")
    (tmp_path / "rig-0.yaml").write_text(yaml.safe_dump(told))
    asked: list[EnsembleTraining] = []

    def train_ensemble(rollouts, method, settings, training, device):
        asked.append(training)
        raise InterruptedError

    monkeypatch.setattr(refined_train, "train_ensemble", train_ensemble)
    training = EnsembleTraining(
        seed=1, models=2, steps=3, tasks=4, sequence=5, learning_rate=0.01, noise_variance_max=0.5
    )
    own = KalmanSettings(latent=2, hidden=(4,), drift=0.0)
    settings = RefinedTrainSettings(name="own", rig=0, method="kalman", settings=own, training=training)
    config = values_of(settings)
    inputs = {"refinement": tmp_path, "train": tmp_path, "rollouts": tmp_path}
    with pytest.raises(InterruptedError):
        refined_train.produce(Run(config, inputs, tmp_path, torch.get_num_threads()))
    noise = pytest.approx(4 * 0.125, rel=1e-4)
    assert [values_of(one) for one in asked] == [values_of(training) | {"noise_variance_max": noise}]


def errors_of(gain: float) -> pd.DataFrame:
    """Refined models err by `gain` times as much."""
    rng = np.random.default_rng(1)
    return pd.DataFrame(
        [
            {"arm": arm, "model": m, "rig": 0, "object": o, "repeat": r, "samples": n,
             "error_m": scale * 0.3 / (1 + n) * (1 + 0.02 * rng.normal())}
            for arm, scale in ((ALL_RANGES, 1.0), (REFINED, gain))
            for m in range(4) for o in ("red", "blue") for r in range(5) for n in range(9)
        ]
    )  # fmt: skip


@pytest.mark.parametrize(("gain", "verdict"), [(0.6, "holds"), (0.9, "does not hold")])
def test_the_verdict_on_models_made_again_is_the_ratio_of_errors(covered, tmp_path, gain, verdict):
    folder = tmp_path / "errors"
    folder.mkdir()
    errors_of(gain).to_parquet(folder / "errors.parquet")
    error, samples = s11.evaluate(covered(1.0) | {"0": folder})[-2:]
    assert error.verdict == verdict
    assert error.interval.value == pytest.approx(gain, rel=0.02)
    assert "10.0 cm before" in error.note
    # gain / (1 + n) = 1 / 9, up to straight lines between samples.
    assert samples.interval.value == pytest.approx((9 * gain - 1) / 8, rel=0.06)
    assert samples.verdict == "holds"
    drawing = a5_refined.draw({"0": folder}, FIGURE)
    assert drawing.name == "A5-hockey-refined"
    drawing.figure.canvas.draw()
    assert set(drawing.table["arm"]) == {ALL_RANGES, REFINED}
