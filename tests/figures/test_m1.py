"""M1 from fabricated loss curves."""

import json

import numpy as np
import pandas as pd
import pytest
from slapshot.figures import m1_training
from slapshot.plotting import method_colour, method_name
from told import FIGURE

PARAMETERS = {"kalman": 57_258, "maml_8": 50_563}
STEPS = (0, 50, 100)


@pytest.fixture
def inputs(tmp_path):
    folders = {}
    for seed, (method, count) in enumerate(PARAMETERS.items()):
        folders[method] = tmp_path / method
        folders[method].mkdir()
        rng = np.random.default_rng(seed)
        rows = [(step, model, *rng.uniform(0.01, 1, 2)) for step in STEPS for model in range(3)]
        losses = pd.DataFrame(rows, columns=["step", "model", "train", "validation"])
        losses.to_csv(folders[method] / "losses.csv", index=False)
        (folders[method] / "ensemble.json").write_text(json.dumps({"parameters_per_model": count}))
    return folders


def test_lines_are_the_mean_of_the_models_and_bands_their_range(inputs, panel):
    drawing = m1_training.draw(inputs, FIGURE)
    assert drawing.name == "M1-hockey-training"
    axes = panel(drawing.figure, "(a)")
    assert axes.get_yscale() == "log"
    for method, line, band in zip(PARAMETERS, axes.lines, axes.collections, strict=True):
        rows = drawing.table[drawing.table["method"] == method]
        by_step = rows.groupby("step")["validation"]
        assert line.get_xdata() == pytest.approx(STEPS)
        assert line.get_ydata() == pytest.approx(by_step.mean().to_numpy())
        assert line.get_label() == method_name(method)
        assert line.get_color() == method_colour(method)
        edge = band.get_paths()[0].vertices[:, 1]
        assert (edge.min(), edge.max()) == pytest.approx((rows["validation"].min(), rows["validation"].max()))


def test_bars_are_the_sizes_of_one_model(inputs, panel):
    drawing = m1_training.draw(inputs, FIGURE)
    axes = panel(drawing.figure, "(b)")
    assert [bar.get_width() for bar in axes.patches] == pytest.approx([57.258, 50.563])
    assert [label.get_text() for label in axes.get_yticklabels()] == ["Kalman", "MAML, 8 an update"]
    sizes = drawing.table.drop_duplicates("method").set_index("method")["parameters"]
    assert sizes.to_dict() == PARAMETERS
    assert len(drawing.table) == len(PARAMETERS) * len(STEPS) * 3


def test_the_same_drawing_gives_the_same_bytes(inputs, assert_same_bytes):
    assert_same_bytes(lambda: m1_training.draw(inputs, FIGURE))
