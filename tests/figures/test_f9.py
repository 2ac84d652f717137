"""F9 from fabricated hidden states."""

import numpy as np
import pandas as pd
import pytest
from slapshot.config.results import LatentsFigureSettings
from slapshot.figures import f9_latents
from slapshot.latent_space import fit_projection, read_latents
from slapshot.plotting import STAND_IN
from told import FIGURE

METHODS = ["kalman", "lstm"]
NAMED = {"low friction": 0.2, "medium friction": 0.5}


def latents(seed: int, samples=(0, 4, 20, 32), recorded: bool = True) -> pd.DataFrame:
    """log friction along one axis and its direction along another, of two models with axes of their own."""
    rng = np.random.default_rng(seed)
    frictions = np.concatenate([np.exp(rng.uniform(-1.5, 0, (30, 2))), [[mu, mu] for mu in NAMED.values()]])
    keys = pd.DataFrame(frictions, columns=["friction_x", "friction_y"]).assign(
        condition=range(32), name=[""] * 30 + list(NAMED), source="simulated", recording="", rig=-1, object=""
    )
    tables = [keys.assign(noise_variance=v) for v in (0.0, np.nan)]
    if recorded:
        pucks = pd.DataFrame(
            [(rig, name) for rig in (0, 1) for name in ("red", "blue")], columns=["rig", "object"]
        )
        hits = {"source": "recorded", "recording": "lab", "name": "", "condition": -1}
        tables.append(pucks.assign(friction_x=0.3, friction_y=0.3, **hits))
    every = pd.concat(tables, ignore_index=True)
    parts = []
    for model in (0, 1):
        axes = np.linalg.qr(rng.normal(size=(4, 4)))[0][:2] * [[3.0], [1.0]]
        for n in samples:
            for repeat in (0, 1):
                x, y = np.log(every["friction_x"]), np.log(every["friction_y"])
                hidden = min(n, 8) * np.stack([x + y, y - x], axis=1) @ axes + rng.normal(
                    0, 0.1, (len(every), 4)
                )
                parts.append(every.assign(model=model, samples=n, repeat=repeat, hidden=list(hidden)))
    table = pd.concat(parts, ignore_index=True)
    table.loc[table["source"] == "recorded", ["friction_x", "friction_y"]] = np.nan
    return table


@pytest.fixture
def inputs(tmp_path):
    folders = {method: tmp_path / method for method in METHODS}
    for seed, folder in enumerate(folders.values()):
        folder.mkdir()
        latents(seed).to_parquet(folder / "latents.parquet")
    return folders


SETTINGS = LatentsFigureSettings.from_parts(FIGURE, methods=METHODS)


def test_a_row_of_panels_for_each_method(inputs, panel, texts):
    drawing = f9_latents.draw(inputs, SETTINGS)
    assert drawing.name == "F9-hockey-latents"
    for title in ("(a) Kalman after 20", "(b) Kalman by", "(c) LSTM after 20", "(d) LSTM by"):
        panel(drawing.figure, title)
    seen = texts(drawing.figure)
    for word in (STAND_IN, "low friction", "red puck, recorded", "blue puck, recorded", "samples seen"):
        assert word in seen
    assert set(drawing.table["panel"]) == {"a", "b", "c", "d"}


def test_points_are_those_of_the_table(inputs, panel):
    drawing = f9_latents.draw(inputs, SETTINGS)
    for title, letter in (("(a)", "a"), ("(c)", "c")):
        table = drawing.table[drawing.table["panel"] == letter]
        axes = panel(drawing.figure, title)
        drawn = np.concatenate([np.asarray(c.get_offsets()) for c in axes.collections])
        assert drawn == pytest.approx(table[["pc1", "pc2"]].to_numpy())
        assert (table["samples"] == 20).all()
        # A point for each puck of each rig, and for each repeat of a condition at a level of noise.
        count = {"recorded": 4, "simulated": 2 * (30 + len(NAMED))}
        assert table["source"].value_counts().to_dict() == count
        by_name = {c.get_label(): len(c.get_offsets()) for c in axes.collections}
        expected = {"drawn conditions": 60, "low friction": 2, "medium friction": 2}
        assert by_name == expected | {"red puck, recorded": 2, "blue puck, recorded": 2}
    for title, letter in (("(b)", "b"), ("(d)", "d")):
        table = drawing.table[drawing.table["panel"] == letter].sort_values(["pc1", "pc2"])
        points = panel(drawing.figure, title).collections[0]
        drawn = np.column_stack([np.asarray(points.get_offsets()), np.asarray(points.get_array())])
        order = np.lexsort((drawn[:, 1], drawn[:, 0]))
        assert drawn[order] == pytest.approx(table[["pc1", "pc2", "samples"]].to_numpy(float))
        assert set(table["samples"]) == {0, 4, 20, 32}


def test_points_are_projections_of_the_first_models_hidden_states(inputs):
    table = f9_latents.draw(inputs, SETTINGS).table
    states = read_latents(inputs["lstm"])
    states = states[states["model"] == 0]
    scores = fit_projection(states).apply(np.stack(states["hidden"].to_list()))
    states = states.assign(pc1=scores[:, 0], pc2=scores[:, 1])
    wanted = states[
        (states["samples"] == 20) & (states["name"] == "low friction") & states["noise_variance"].notna()
    ]
    found = table[(table["panel"] == "c") & (table["name"] == "low friction")]
    assert found[["pc1", "pc2"]].to_numpy() == pytest.approx(wanted[["pc1", "pc2"]].to_numpy())
    pucks = states[(states["samples"] == 20) & (states["source"] == "recorded")]
    means = pucks.groupby(["rig", "object"])[["pc1", "pc2"]].mean()
    found = table[(table["panel"] == "c") & (table["source"] == "recorded")]
    assert found.set_index(["rig", "object"])[["pc1", "pc2"]].sort_index().to_numpy() == pytest.approx(
        means.to_numpy()
    )
    # The first component is friction's magnitude: medium lies above low.
    named = table[(table["panel"] == "a") & (table["name"] != "")].groupby("name")["pc1"].mean()
    assert named["medium friction"] > named["low friction"]


def test_without_recordings_or_twenty_samples(tmp_path, panel):
    latents(3, samples=(0, 4), recorded=False).to_parquet(tmp_path / "latents.parquet")
    drawing = f9_latents.draw({"lstm": tmp_path}, LatentsFigureSettings.from_parts(FIGURE, methods=["lstm"]))
    panel(drawing.figure, "(a) LSTM after 4 samples")
    assert set(drawing.table["source"]) == {"simulated"}


def test_the_same_drawing_gives_the_same_bytes(inputs, assert_same_bytes):
    assert_same_bytes(lambda: f9_latents.draw(inputs, SETTINGS))
