"""Stage `beliefs` on a made-up world: hidden states and innovations, with the keys they belong to."""

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
import torch
from slapshot.adaptation import beliefs
from slapshot.adaptation.checkpoint import load_ensemble, save_ensemble
from slapshot.adaptation.data import Standardiser
from slapshot.adaptation.kalman import Kalman
from slapshot.adaptation.method import Sizes
from slapshot.command import Run
from slapshot.config.methods import KalmanSettings
from slapshot.rollouts.reading import read_sequences

MODELS, CONDITIONS, TASKS, REPEATS = 2, 22, 4, 3
SAMPLES, VARIANCES, VARIANCE_MAX = [0, 1, 6], [0.0, 0.1, 0.4], 0.2
LEVELS = 1 + len(VARIANCES)
SETTINGS = {
    "samples": SAMPLES,
    "repeats": REPEATS,
    "noise_variances": VARIANCES,
    "noise_variance_max": VARIANCE_MAX,
}
KEYS = ["source", "recording", "rig", "object", "condition", "name", "friction_x", "friction_y",
        "noise_variance", "repeat", "model", "samples"]  # fmt: skip


@pytest.fixture(scope="module")
def produce(world):
    def run(out: Path, method: str = "kalman", **changed) -> Path:
        out.mkdir()
        beliefs.produce(Run(world.config(method, **SETTINGS) | changed, world.inputs(method), out, 1))
        return out

    return run


@pytest.fixture(scope="module")
def kalman(produce, tmp_path_factory) -> Path:
    return produce(tmp_path_factory.mktemp("beliefs") / "kalman")


@pytest.fixture(scope="module")
def latents(kalman) -> pd.DataFrame:
    return pd.read_parquet(kalman / "latents.parquet")


@pytest.fixture(scope="module")
def innovations(kalman) -> pd.DataFrame:
    return pd.read_parquet(kalman / "innovations.parquet")


def test_a_hidden_state_for_every_task_noise_repeat_model_and_number_of_samples(latents):
    assert set(latents) == {*KEYS, "hidden"}
    assert not latents.duplicated(KEYS).any()
    each = MODELS * len(SAMPLES) * REPEATS
    assert latents["source"].value_counts().to_dict() == {
        "simulated": CONDITIONS * LEVELS * each,
        "recorded": TASKS * each,
    }
    simulated = latents[latents["source"] == "simulated"]
    assert set(simulated["noise_variance"].dropna()) == set(VARIANCES)
    assert simulated["noise_variance"].isna().mean() == 1 / LEVELS
    recorded = latents[latents["source"] == "recorded"]
    assert recorded[["rig", "object"]].drop_duplicates().to_numpy().tolist() == [
        [rig, name] for rig in (0, 1) for name in ("red", "blue")
    ]


def test_conditions_keep_their_names_and_frictions(world, latents):
    known = read_sequences(world.rollouts, "test").conditions
    simulated = latents[latents["source"] == "simulated"]
    expected = known.loc[simulated["condition"]]
    for column in ("name", "friction_x", "friction_y"):
        assert (simulated[column].to_numpy() == expected[column].to_numpy()).all()


def test_hidden_states_are_a_list_of_fixed_size(kalman):
    kind = pq.read_schema(kalman / "latents.parquet").field("hidden").type
    assert kind.list_size == 3  # of the made-up world's Kalman model


def test_a_hidden_state_of_one_dimension_is_a_list_too(world, tmp_path):
    settings = KalmanSettings(latent=1, hidden=(4,), drift=0.0)
    generator = torch.Generator().manual_seed(0)
    method = Kalman(Sizes(2, 2, 2), settings, MODELS, generator)
    standardiser = Standardiser.fit(read_sequences(world.rollouts, "train"))
    save_ensemble(tmp_path, "kalman", method, standardiser)
    out = tmp_path / "out"
    out.mkdir()
    beliefs.produce(Run(world.config(**SETTINGS), world.inputs() | {"train": tmp_path}, out, 1))
    assert pd.read_parquet(out / "latents.parquet")["hidden"].map(len).unique().tolist() == [1]


def test_before_any_sample_there_is_only_the_prior(world, latents):
    method, _ = load_ensemble(world.kalman)
    prior = method.hidden(method.prior(1))[:, 0].detach().numpy()
    for model, rows in latents[latents["samples"] == 0].groupby("model"):
        hidden = np.stack(rows["hidden"].to_list())
        assert hidden == pytest.approx(np.broadcast_to(prior[int(str(model))], hidden.shape))
    later = latents[(latents["samples"] == 6) & (latents["model"] == 0)]
    assert len({tuple(h) for h in later["hidden"]}) == len(later)


def test_hidden_states_and_innovations_are_those_of_the_hits_they_stand_beside(
    world, latents, produce, tmp_path, spy
):
    """From the calls: what was adapted to, adapted to once more, one sample after the other."""
    calls = spy(beliefs)
    produce(tmp_path / "out")
    method, standardiser = load_ensemble(world.kalman)
    innovations = pd.read_parquet(tmp_path / "out" / "innovations.parquet")
    where = ["source", "repeat", "noise_variance", "rig", "object"]
    groups = [rows for _, rows in latents.groupby(where, sort=False, dropna=False)]
    surprises = [rows for _, rows in innovations.groupby(where, sort=False, dropna=False)]
    simulated = REPEATS * LEVELS
    assert len(calls.adapted) == simulated + TASKS
    for call, group, surprise in [
        *zip(calls.adapted[:simulated], groups, surprises, strict=False),
        *zip(
            calls.adapted[simulated:],
            by_task(groups[simulated:]),
            by_task(surprises[simulated:]),
            strict=True,
        ),
    ]:
        data = [
            standardiser.standardise(name, call[key]).expand(MODELS, *call[key].shape)
            for name, key in (("state", "state"), ("action", "action"), ("outcome", "observed"))
        ]
        belief = method.prior(data[0].shape[1])
        shape = (MODELS, data[0].shape[1])
        ends = surprise[["x_m", "y_m"]].to_numpy().reshape(*shape, max(SAMPLES), 2)
        assert ends[1] == pytest.approx(call["observed"], abs=1e-4)
        nis = surprise["nis"].to_numpy().reshape(*shape, max(SAMPLES))
        hidden = np.stack(group["hidden"].to_list()).reshape(*shape, len(SAMPLES), -1)
        with torch.no_grad():
            for n in range(max(SAMPLES) + 1):
                if n in SAMPLES:
                    found = hidden[:, :, SAMPLES.index(n)]
                    # Float32, standardised and back: 1e-7 of values up to 10, through steep networks.
                    assert found == pytest.approx(method.hidden(belief).numpy(), abs=1e-4)
                if n < max(SAMPLES):
                    sample = [x[:, :, n] for x in data]
                    expected = method.normalised_innovation_squared(belief, *sample)
                    assert nis[:, :, n] == pytest.approx(expected.numpy(), rel=1e-3, abs=1e-3)
                    belief = method.update(belief, *sample)


def by_task(groups: list[pd.DataFrame]) -> list[pd.DataFrame]:
    """Groups of one repeat each, put together by rig and object in the order of (model, repeat)."""
    table = pd.concat(groups)
    tasks = [rows for _, rows in table.groupby(["rig", "object"], sort=False)]
    return [rows.sort_values(["model", "repeat", "samples"]) for rows in tasks]


def test_levels_of_noise_are_those_asked_for(world, innovations):
    data = read_sequences(world.rollouts, "test")
    scale = read_sequences(world.rollouts, "train").outcome.reshape(-1, 2).std(0, ddof=1)
    drawn = innovations[(innovations["source"] == "simulated") & (innovations["model"] == 0)]
    assert len(drawn) == CONDITIONS * REPEATS * LEVELS * max(SAMPLES)
    keys = ["condition", "repeat", "samples"]
    ends = drawn.assign(noise_variance=drawn["noise_variance"].fillna(-1)).set_index(
        [*keys, "noise_variance"]
    )
    ends = ends[["x_m", "y_m"]].unstack("noise_variance")
    clean, tenth, most, trained = (
        ends.xs(v, axis=1, level="noise_variance").to_numpy() for v in (0.0, 0.1, 0.4, -1)
    )
    # Without noise: where a hit of that condition came to rest.
    for condition, end in zip(ends.index.get_level_values("condition"), clean, strict=True):
        assert np.abs(data.outcome[condition] - end).max(1).min() < 1e-6
    noise = (tenth - clean) / scale
    # The mean square of n normal draws, give or take v sqrt(2 / n).
    assert np.square(noise).mean() == pytest.approx(0.1, abs=5 * 0.1 * np.sqrt(2 / noise.size))
    assert (most - clean) / scale == pytest.approx(2 * noise, abs=1e-4)
    # Variances of training are drawn from U(0, v) for each condition, component and repeat (see
    # test_calibrate.py for this spread).
    spread = VARIANCE_MAX * np.sqrt(1 / 12 / (2 * CONDITIONS * REPEATS) + 2 / 3 / noise.size)
    assert np.square((trained - clean) / scale).mean() == pytest.approx(VARIANCE_MAX / 2, abs=5 * spread)


def test_recorded_samples_are_hits_of_that_object(world, innovations):
    recorded = innovations[innovations["source"] == "recorded"]
    for (rig, name), rows in recorded.groupby(["rig", "object"]):
        hits = world.hits(int(str(rig)))
        own = hits.loc[hits["object_id"] == name, ["rest_x", "rest_y"]].dropna().to_numpy()
        off = np.abs(rows[["x_m", "y_m"]].to_numpy()[:, None] - own).max(-1).min(1)
        assert off.max() < 1e-6
        orders = rows[rows["model"] == 0].groupby("repeat")["x_m"].agg(tuple)
        assert len(set(orders)) == REPEATS


def test_every_method_sees_the_same_hits(produce, tmp_path, spy):
    calls = spy(beliefs)
    for method in ("kalman", "lstm"):
        produce(tmp_path / method, method)
    half = len(calls.adapted) // 2
    assert half == REPEATS * LEVELS + TASKS
    for one, other in zip(calls.adapted[:half], calls.adapted[half:], strict=True):
        assert all((one[name] == other[name]).all() for name in one)


def test_a_method_that_knows_no_surprise_has_hidden_states_only(produce, tmp_path):
    out = produce(tmp_path / "lstm", "lstm")
    assert [p.name for p in out.iterdir()] == ["latents.parquet"]


def test_without_recordings_there_are_simulated_ones_only(produce, tmp_path):
    out = produce(tmp_path / "none", recordings={})
    for name in ("latents", "innovations"):
        assert set(pd.read_parquet(out / f"{name}.parquet")["source"]) == {"simulated"}


def test_the_seed_decides(kalman, produce, tmp_path):
    again, other = produce(tmp_path / "again"), produce(tmp_path / "other", seed=6)
    for name in ("latents.parquet", "innovations.parquet"):
        assert (again / name).read_bytes() == (kalman / name).read_bytes()
        assert (other / name).read_bytes() != (kalman / name).read_bytes()
