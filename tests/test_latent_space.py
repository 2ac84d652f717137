"""Principal components of hidden states that are a known linear map of friction."""

import numpy as np
import pandas as pd
import pytest
from slapshot.latent_space import at_samples, fit_projection, read_latents

MIXING = np.array([[3.0, 0.0, 4.0], [0.0, -2.0, 0.0]])  # magnitude along the one, direction along the other


def make(conditions: int = 60, seed: int = 0, mixing: np.ndarray = MIXING) -> pd.DataFrame:
    """Hidden states (log magnitude, log direction) @ mixing of drawn conditions, and rows to leave out."""
    rng = np.random.default_rng(seed)
    x, y = np.exp(rng.uniform(-1, 1, (2, conditions)))
    table = pd.DataFrame({"friction_x": x, "friction_y": y, "condition": range(conditions)})
    guides = np.stack([np.log(np.sqrt(x * y)), np.log(y / x)], axis=1)
    table["hidden"] = list(guides @ mixing + 0.5)
    table = table.assign(source="simulated", name="", samples=4)
    odd = {"hidden": [[1e3, -1e3, 1e3]]}
    left_out = pd.concat(
        [
            table[:1].assign(samples=0, **odd),
            table[:1].assign(name="low friction", **odd),
            table[:1].assign(source="recorded", friction_x=np.nan, friction_y=np.nan, **odd),
        ]
    )
    return pd.concat([table, left_out], ignore_index=True)


@pytest.fixture
def latents(tmp_path) -> pd.DataFrame:
    make().to_parquet(tmp_path / "latents.parquet")
    return read_latents(tmp_path)


def test_magnitude_and_direction_of_friction(latents):
    row = latents.iloc[7]
    assert np.exp(row["magnitude"]) ** 2 == pytest.approx(row["friction_x"] * row["friction_y"])
    assert np.exp(row["direction"]) == pytest.approx(row["friction_y"] / row["friction_x"])
    assert latents.loc[latents["source"] == "recorded", ["magnitude", "direction"]].isna().all(axis=None)


def test_named_conditions_recordings_and_the_prior_have_no_part_in_the_components(latents):
    projection = fit_projection(latents)
    # Of rank two: the outliers, 1000 away, would be the first component.
    assert projection.explained.sum() == pytest.approx(1)
    assert np.abs(projection.mean).max() < 10


@pytest.mark.parametrize("signs", [(1, 1), (-1, 1), (1, -1), (-1, -1)])
def test_components_grow_with_magnitude_and_direction(tmp_path, signs):
    make(mixing=MIXING * np.array(signs)[:, None]).to_parquet(tmp_path / "latents.parquet")
    latents = read_latents(tmp_path)
    drawn = latents[(latents["source"] == "simulated") & (latents["name"] == "") & (latents["samples"] > 0)]
    scores = fit_projection(latents).apply(np.stack(drawn["hidden"].to_list()))
    assert np.corrcoef(scores[:, 0], drawn["magnitude"])[0, 1] > 0.9
    assert np.corrcoef(scores[:, 1], drawn["direction"])[0, 1] > 0.9


@pytest.mark.parametrize(("samples", "kept"), [(4, 4), (20, 16), (16, 16), (99, 32), (0, 0)])
def test_rows_after_so_many_samples_or_the_number_below(samples, kept):
    table = pd.DataFrame({"samples": [0, 4, 16, 32, 16, 4]})
    assert (at_samples(table, samples)["samples"] == kept).all()
