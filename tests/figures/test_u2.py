"""U2 from fabricated innovations."""

import numpy as np
import pandas as pd
import pytest
from slapshot.figures import u2_innovations
from slapshot.plotting import STAND_IN
from told import FIGURE

SAMPLES, MODELS = range(5), 2


def innovations(seed: int = 0, recorded: bool = True) -> pd.DataFrame:
    """Simulated: 1 to 100, times 10 for model 1. Recorded: a fifth (red) or all (blue) beyond all of them."""
    rng = np.random.default_rng(seed)
    tables = []
    for model in range(MODELS):
        scale = 10.0**model
        for n in SAMPLES:
            known = {"model": model, "samples": n}
            nis = scale * np.arange(1, 101.0)
            trained = pd.DataFrame({"nis": nis, "noise_variance": np.nan, "name": "", "x_m": 1.0, "y_m": 0.0})
            # Neither what has a noise of its own nor what has a name counts.
            tables += [
                trained.assign(source="simulated", rig=-1, object="", recording="", **known),
                trained.assign(source="simulated", nis=1e6, noise_variance=0.5, rig=-1, object="", **known),
                trained.assign(source="simulated", nis=1e6, name="low friction", rig=-1, object="", **known),
            ]
            for rig in (0, 1) if recorded else ():
                for name, beyond in (("red", 4), ("blue", 20)):
                    nis = scale * np.where(np.arange(20) < beyond, 97.0, 50.0)
                    place = {"x_m": 1.0 if name == "red" else 2.0, "y_m": rng.uniform(-0.05, 0.05, 20)}
                    own = pd.DataFrame({"nis": nis, "noise_variance": np.nan, "name": "", **place})
                    tables.append(
                        own.assign(source="recorded", recording="lab", rig=rig, object=name, **known)
                    )
    return pd.concat(tables, ignore_index=True)


@pytest.fixture
def make(tmp_path):
    def make(**changed):
        innovations(**changed).to_parquet(tmp_path / "innovations.parquet")
        return {"beliefs": tmp_path}

    return make


def test_bands_are_quantiles_by_source_and_samples(make, panel, texts):
    drawing = u2_innovations.draw(make(), FIGURE)
    assert drawing.name == "U2-hockey-innovations"
    bands = drawing.table[drawing.table["panel"] == "a"]
    assert len(bands) == 2 * len(SAMPLES)
    both = np.concatenate([np.arange(1, 101.0), 10 * np.arange(1, 101.0)])
    for _, row in bands[bands["source"] == "simulated"].iterrows():
        quantiles = row[["nis_5", "nis_50", "nis_95"]].to_numpy(float)
        assert quantiles == pytest.approx(np.quantile(both, [0.05, 0.5, 0.95]))
    lines = {line.get_label(): line for line in panel(drawing.figure, "(a)").lines}
    for source in ("simulated", "recorded"):
        rows = bands[bands["source"] == source]
        for label, column in ((f"{source}, median", "nis_50"), (f"{source}, 95 %", "nis_95")):
            assert lines[label].get_xydata() == pytest.approx(rows[["samples", column]].to_numpy(float))
    assert STAND_IN in texts(drawing.figure)


def test_surprise_is_held_against_simulated_samples_of_the_same_model(make, panel):
    """A model's own 95 %: 97 is beyond model 0's 95.05, and 500 of model 1 is not beyond its 950.5."""
    drawing = u2_innovations.draw(make(), FIGURE)
    rigs = drawing.table[drawing.table["panel"] == "b"].set_index(["object", "rig"])["beyond"]
    assert rigs["red"].tolist() == pytest.approx([0.2, 0.2])
    assert rigs["blue"].tolist() == pytest.approx([1.0, 1.0])
    axes = panel(drawing.figure, "(b)")
    points = [line for line in axes.lines if line.get_marker() == "o"]
    assert [line.get_ydata().tolist() for line in points] == [[100, 100], pytest.approx([20, 20])]
    assert [label.get_text() for label in axes.get_xticklabels()] == ["blue puck", "red puck"]
    nominal = [line for line in axes.lines if line.get_linestyle() == ":"]
    assert nominal[0].get_ydata()[0] == pytest.approx(5)


def test_cells_hold_what_came_to_rest_there(make, panel):
    drawing = u2_innovations.draw(make(), FIGURE)
    cells = drawing.table[drawing.table["panel"] == "c"]
    assert cells["n"].sum() == 2 * 2 * 20 * len(SAMPLES) * MODELS
    assert cells.loc[cells["x_m"] < 1.5, "beyond"].to_numpy() == pytest.approx(0.2)
    assert cells.loc[cells["x_m"] > 1.5, "beyond"].to_numpy() == pytest.approx(1.0)
    # The middle of the cell that a point lies in is within half a cell, 0.075 m, of it.
    assert np.abs(cells["x_m"] - np.where(cells["x_m"] < 1.5, 1.0, 2.0)).max() <= 0.075
    points = panel(drawing.figure, "(c)").collections[0]
    assert np.asarray(points.get_offsets()) == pytest.approx(cells[["x_m", "y_m"]].to_numpy(float))
    assert np.asarray(points.get_array()) == pytest.approx(100 * cells["beyond"].to_numpy(float))


def test_a_cell_of_a_few_samples_is_not_shown(tmp_path):
    table = innovations()
    lonely = table[table["source"] == "recorded"].head(7).assign(x_m=-3.0)
    pd.concat([table, lonely]).to_parquet(tmp_path / "innovations.parquet")
    drawing = u2_innovations.draw({"beliefs": tmp_path}, FIGURE)
    assert drawing.table["x_m"].min() > 0


def test_without_recordings_only_simulation_is_drawn(make):
    drawing = u2_innovations.draw(make(recorded=False), FIGURE)
    assert set(drawing.table["source"].dropna()) == {"simulated"}


def test_the_same_drawing_gives_the_same_bytes(make, assert_same_bytes):
    folders = make()
    assert_same_bytes(lambda: u2_innovations.draw(folders, FIGURE))
