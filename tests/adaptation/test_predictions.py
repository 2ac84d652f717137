"""Stage `predictions` on a made-up world: which hits it predicts, from which others, and what it writes."""

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from slapshot.adaptation import predictions
from slapshot.adaptation.checkpoint import load_ensemble
from slapshot.command import Run
from slapshot.rollouts.reading import read_sequences

SAMPLES, LEVELS = [0, 2, 8], [0.5, 0.975]
CONDITIONS, ALL_TRACKED = 22, 3
SETTINGS = {"draws": 16, "samples": SAMPLES, "shown_noise_variance": 0.1}
COLUMNS = [
    "hit", "source", "recording", "rig", "object", "condition", "name", "samples", "model", "x_m", "y_m",
    "cov_xx", "cov_xy", "cov_yy", "true_x_m", "true_y_m", "radius2_50", "radius2_97.5",
]  # fmt: skip
TRUTH = ["true_x_m", "true_y_m"]
KEYS = ["source", "rig", "object", "condition", "hit", "samples"]


@pytest.fixture(scope="module")
def calibration(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("calibration")
    rows = [(m, n, p, 10 * m + n + p) for m in (0, 1) for n in SAMPLES for p in LEVELS]
    table = pd.DataFrame(rows, columns=["model", "samples", "level", "radius2"])
    table.to_parquet(folder / "calibration.parquet")
    return folder


@pytest.fixture(scope="module")
def produce(world, calibration):
    def run(out: Path, changed_inputs: dict[str, Path] | None = None, **changed) -> pd.DataFrame:
        out.mkdir()
        config = world.config(**SETTINGS) | changed
        inputs = world.inputs(calibrate=calibration) | (changed_inputs or {})
        predictions.produce(Run(config, inputs, out, 1))
        return pd.read_parquet(out / "predictions.parquet")

    return run


@pytest.fixture(scope="module")
def table(produce, tmp_path_factory) -> pd.DataFrame:
    return produce(tmp_path_factory.mktemp("predictions") / "out")


def tracked(world) -> pd.DataFrame:
    tracks = pd.read_parquet(world.rollouts / "tracks.parquet")
    own = tracks[(tracks["split"] == "test") & (tracks["condition"] != ALL_TRACKED)]
    return own[["condition", "hit"]].drop_duplicates()


def with_outcomes(world, folder: Path, outcome: np.ndarray) -> Path:
    """Rollouts whose test hits end elsewhere."""
    shutil.copytree(world.rollouts, folder)
    hits = pq.read_table(folder / "hits-test.parquet")
    column = pa.FixedSizeListArray.from_arrays(pa.array(outcome.astype(np.float32).ravel()), 2)
    pq.write_table(hits.set_column(2, "outcome", column), folder / "hits-test.parquet")
    return folder


def distance(table: pd.DataFrame) -> pd.Series:
    return np.hypot(table["x_m"] - table["true_x_m"], table["y_m"] - table["true_y_m"])


def test_a_row_for_each_tracked_or_recorded_hit_and_number_of_samples(world, table):
    assert sorted(table) == sorted(COLUMNS)
    assert not table.duplicated(KEYS).any()
    assert (table.groupby(KEYS[:-1])["samples"].agg(set) == set(SAMPLES)).all()
    simulated = table[table["source"] == "simulated"]
    # Not those of the condition that has no other hits to adapt to.
    shown = simulated[["condition", "hit"]].drop_duplicates().sort_values(["condition", "hit"])
    assert shown.to_numpy().tolist() == tracked(world).sort_values(["condition", "hit"]).to_numpy().tolist()
    assert (simulated["rig"] == -1).all()
    assert set(simulated["name"]) == {"", "low friction", "medium friction"}
    recorded = table[table["source"] == "recorded"]
    assert set(recorded["recording"]) == {"lab"}
    assert recorded.groupby(["rig", "object"]).ngroups == 4
    assert (recorded["condition"] == -1).all()
    assert (table["model"] == 0).all()


def test_truth_is_where_the_hit_came_to_rest(world, table):
    data = read_sequences(world.rollouts, "test")
    simulated = table[table["source"] == "simulated"]
    ends = data.outcome[simulated["condition"], simulated["hit"]]
    assert simulated[TRUTH].to_numpy() == pytest.approx(ends)
    recorded = table[table["source"] == "recorded"]
    for rig, rows in recorded.groupby("rig"):
        hits = world.hits(int(str(rig))).set_index("hit").loc[rows["hit"]]
        assert (hits["object_id"].to_numpy() == rows["object"].to_numpy()).all()
        assert rows[TRUTH].to_numpy() == pytest.approx(hits[["rest_x", "rest_y"]].to_numpy(), abs=1e-6)


def test_radii_are_the_calibrated_ones_of_the_model_that_is_shown(table):
    assert table["radius2_50"].to_numpy() == pytest.approx(table["samples"] + 0.5)
    assert table["radius2_97.5"].to_numpy() == pytest.approx(table["samples"] + 0.975)


def test_covariances_are_positive_definite(table):
    assert (table[["cov_xx", "cov_yy"]] > 0).all(axis=None)
    assert (table["cov_xx"] * table["cov_yy"] > table["cov_xy"] ** 2).all()


def test_other_hits_of_the_same_task_help(table):
    """The world has two unknown parameters: eight hits of another task would make predictions worse."""
    for _, rows in table.assign(off=distance(table)).groupby("source"):
        mean = rows.groupby("samples")["off"].mean()
        assert mean[8] < 0.6 * mean[0]


def test_no_hit_and_no_command_is_both_adapted_to_and_predicted(world, produce, tmp_path, spy):
    calls = spy(predictions)
    table = produce(tmp_path / "out")
    tasks = CONDITIONS - 1 + 4
    assert len(calls.adapted) == tasks
    assert len(calls.predicted) == tasks * len(SAMPLES)
    for i, adapted in enumerate(calls.adapted):
        asked = [call["action"][0] for call in calls.predicted[i * len(SAMPLES) : (i + 1) * len(SAMPLES)]]
        assert all((other == asked[0]).all() for other in asked)
        assert adapted["action"].shape == (1, max(SAMPLES), 2)
        # Repeats of a command have one action.
        apart = np.abs(adapted["action"][0][:, None] - asked[0]).max(-1)
        assert apart.min() > 1e-4
    recorded = table[(table["source"] == "recorded") & (table["samples"] == 0)]
    assert len(recorded) == sum(call["action"].shape[1] for call in calls.predicted[-4 * len(SAMPLES) :]) / 3
    for (rig, _), rows in recorded.groupby(["rig", "object"]):
        hits = world.hits(int(str(rig)))
        commands = hits.set_index("hit")["command_id"]
        left = commands[rows["hit"]].dropna().unique()
        # All repeats of a predicted command are predicted, or were never seen by the camera.
        own = hits[(hits["object_id"] == rows["object"].iloc[0]) & hits["rest_x"].notna()]
        assert set(own.loc[own["command_id"].isin(left), "hit"]) <= set(rows["hit"])


@pytest.mark.parametrize("variance", [0.0, 0.3])
def test_simulated_hits_to_adapt_to_are_as_noisy_as_asked_and_recorded_ones_as_they_are(
    world, produce, tmp_path, spy, variance
):
    calls = spy(predictions)
    produce(tmp_path / "out", shown_noise_variance=variance)
    scale = read_sequences(world.rollouts, "train").outcome.reshape(-1, 2).std(0, ddof=1)
    data = read_sequences(world.rollouts, "test")
    conditions = [c for c in range(CONDITIONS) if c != ALL_TRACKED]
    noise = []
    for condition, call in zip(conditions, calls.adapted, strict=False):
        row = np.abs(call["action"][0][:, None] - data.action[condition]).max(-1).argmin(1)
        noise.append((call["observed"][0] - data.outcome[condition, row]) / scale)
    count = np.size(noise)
    spread = 5 * variance * np.sqrt(2 / count)  # of a mean square of normal draws
    assert np.square(noise).mean() == pytest.approx(variance, abs=spread + 1e-6)
    for i, call in enumerate(calls.adapted[len(conditions) :]):
        hits = world.hits(i // 2).dropna(subset="rest_x")
        ends = hits[["rest_x", "rest_y"]].to_numpy()
        assert np.abs(call["observed"][0][:, None] - ends).max(-1).min(1).max() < 1e-4


def test_where_a_predicted_hit_came_to_rest_changes_no_prediction(world, table, produce, tmp_path):
    data = read_sequences(world.rollouts, "test")
    moved = data.outcome.copy()
    shown = tracked(world)
    moved[shown["condition"], shown["hit"]] += 5.0
    changed = {"rollouts": with_outcomes(world, tmp_path / "rollouts", moved)}
    for rig, folder in enumerate(world.rigs):
        changed[f"lab/lab/{rig}"] = tmp_path / f"rig{rig}"
        shutil.copytree(folder, changed[f"lab/lab/{rig}"])
        path = changed[f"lab/lab/{rig}"] / "recording" / "hits.parquet"
        hits = pq.read_table(path)
        asked = table.loc[(table["source"] == "recorded") & (table["rig"] == rig), "hit"]
        x = hits["rest_x"].to_numpy() + np.where(np.isin(hits["hit"].to_numpy(), asked), 5.0, 0.0)
        place = hits.column_names.index("rest_x")
        rest = pa.array(x, mask=np.isnan(x))
        pq.write_table(hits.set_column(place, hits.schema.field(place), rest), path)
    after = produce(tmp_path / "out", changed)
    others = [c for c in COLUMNS if c not in TRUTH]
    pd.testing.assert_frame_equal(after[others], table[others], check_exact=True)
    assert (after["true_x_m"] - table["true_x_m"]).to_numpy() == pytest.approx(5.0, abs=1e-5)


def test_a_recording_of_ones_own_is_one_rig(world, produce, tmp_path):
    mine = {"mine": {"path": str(world.rigs[1] / "recording")}}
    table = produce(tmp_path / "out", recordings=mine)
    recorded = table[table["source"] == "recorded"]
    assert set(recorded["recording"]) == {"mine"}
    assert set(recorded["rig"]) == {0}
    none = produce(tmp_path / "none", recordings={})
    assert set(none["source"]) == {"simulated"}


def test_the_seed_decides(table, produce, tmp_path):
    pd.testing.assert_frame_equal(produce(tmp_path / "again"), table, check_exact=True)
    other = produce(tmp_path / "other", seed=6)
    assert not other["x_m"].equals(table["x_m"])


def test_a_prediction_is_the_ensembles_first_model(world, table):
    """Before any hit nothing is random but the spread: the mean is that of the prior."""
    method, standardiser = load_ensemble(world.kalman)
    data = read_sequences(world.rollouts, "test")
    rows = table[(table["source"] == "simulated") & (table["samples"] == 0)]
    state, action = (
        standardiser.standardise(name, getattr(data, name)[rows["condition"], rows["hit"]][None, None])
        for name in ("state", "action")
    )
    every = (method.models, -1, -1, -1)
    expected = method.predict(method.prior(1), state.expand(every), action.expand(every))
    expected = standardiser.restore("outcome", expected)[0, 0].detach().numpy()
    assert rows[["x_m", "y_m"]].to_numpy() == pytest.approx(expected, abs=1e-5)
