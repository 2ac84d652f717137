"""F1 from fabricated predictions."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.patches import Ellipse
from slapshot.figures import f1_intro
from told import FIGURE


def predictions(seed: int = 0) -> pd.DataFrame:
    """Hits whose errors are 0.1, 0.2, ... m before and a tenth of that after four samples."""
    rng = np.random.default_rng(seed)
    rows = []
    for condition in range(3):
        for hit in range(3):
            error, angle = 0.1 * (1 + 3 * condition + hit), rng.uniform(0, 2 * np.pi)
            true = rng.normal([1.5, 0.0], 0.2)
            for samples, share in ((0, 1.0), (1, 0.5), (4, 0.1)):
                off = share * error * np.array([np.cos(angle), np.sin(angle)])
                factor = np.array([[0.2, 0.0], [0.1, 0.05]]) * np.sqrt(share)
                rows.append(("simulated", condition, hit, samples, *(true + off), factor @ factor.T, *true))
    columns = ["source", "condition", "hit", "samples", "x_m", "y_m", "covariance", "true_x_m", "true_y_m"]
    table = pd.DataFrame(rows, columns=columns)
    stacked = np.stack(table.pop("covariance").to_list())
    table["cov_xx"], table["cov_xy"], table["cov_yy"] = stacked[:, 0, 0], stacked[:, 0, 1], stacked[:, 1, 1]
    table = table.assign(radius2_50=1.2 + table["samples"], radius2_90=4.0 + table["samples"])
    # What is recorded is not shown, however ordinary.
    return pd.concat([table, table.assign(source="recorded", condition=-1, x_m=99.0)], ignore_index=True)


@pytest.fixture
def inputs(tmp_path, scene):
    folders = {name: tmp_path / name for name in ("predictions", "scene")}
    for folder in folders.values():
        folder.mkdir()
    predictions().to_parquet(folders["predictions"] / "predictions.parquet")
    scene.save(folders["scene"])
    return folders


@pytest.fixture
def drawing(inputs):
    return f1_intro.draw(inputs, FIGURE)


def test_the_most_ordinary_hit_is_shown(drawing):
    """Errors are 0.1 to 0.9 m: the hit in the middle is hit 1 of condition 1, with 0.5 m."""
    assert drawing.name == "F1-hockey-intro"
    table = drawing.table
    assert set(table["source"]) == {"simulated"}
    assert table[["condition", "hit"]].drop_duplicates().to_numpy().tolist() == [[1, 1]]
    assert table["samples"].tolist() == [0, 1, 4]


def test_each_panel_shows_the_tables_prediction_truth_and_start(drawing, scene, panel, texts):
    rows = drawing.table.set_index("samples")
    for title, samples in (("(a) before any sample", 0), ("(b) after 4 other hits", 4)):
        axes = panel(drawing.figure, title)
        lines = {line.get_label(): line.get_xydata()[0] for line in axes.lines}
        row = rows.loc[samples]
        assert lines["predicted"] == pytest.approx(row[["x_m", "y_m"]].to_numpy(float))
        assert lines["true rest point"] == pytest.approx(row[["true_x_m", "true_y_m"]].to_numpy(float))
        assert lines["start"] == pytest.approx(scene.info.start)
        ellipses = [patch for patch in axes.patches if isinstance(patch, Ellipse)]
        assert [e.get_label() for e in ellipses] == ["50 % region", "90 % region"]
        low, high = np.array([axes.get_xlim(), axes.get_ylim()]).T
        for ellipse, radius2 in zip(ellipses, row[["radius2_50", "radius2_90"]], strict=True):
            edge = outline(ellipse)
            assert squared_distance(edge, row) == pytest.approx(radius2)
            assert (low < edge.min(0)).all()
            assert (edge.max(0) < high).all()
    assert "start" in texts(drawing.figure)


def outline(ellipse: Ellipse) -> np.ndarray:
    """(n, 2) points of its edge, in m."""
    angle = np.linspace(0, 2 * np.pi, 60)
    return ellipse.get_patch_transform().transform(np.stack([np.cos(angle), np.sin(angle)], axis=1))


def squared_distance(points: np.ndarray, row: pd.Series) -> np.ndarray:
    covariance = np.array([[row["cov_xx"], row["cov_xy"]], [row["cov_xy"], row["cov_yy"]]], float)
    off = points - row[["x_m", "y_m"]].to_numpy(float)
    return (off @ np.linalg.inv(covariance) * off).sum(1)


@pytest.mark.parametrize(
    "covariance", [(0.04, 0.0, 0.01), (0.01, 0.0, 0.04), (0.04, -0.015, 0.01), (0.02, 0.0, 0.02)]
)
def test_a_region_is_where_the_mahalanobis_distance_is_the_calibrated_radius(covariance):
    names = ["cov_xx", "cov_xy", "cov_yy", "x_m", "y_m", "radius2_50", "radius2_97.5"]
    row = pd.Series(dict(zip(names, (*covariance, 1.0, -0.5, 1.5, 8.0), strict=True)))
    half, most = f1_intro.region(row, "black")
    assert squared_distance(outline(half), row) == pytest.approx(1.5)
    assert squared_distance(outline(most), row) == pytest.approx(8.0)
    assert most.get_label() == "97.5 % region"


def test_the_same_drawing_gives_the_same_bytes(inputs, assert_same_bytes):
    assert_same_bytes(lambda: f1_intro.draw(inputs, FIGURE))
