"""F3: six panels, drawn from the tables of the regression stage."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.patches import Ellipse
from slapshot.errors import InputError
from slapshot.figures import f3_linear_regression
from slapshot.plotting import save, use_style
from told import FIGURE

COUNTS = (0, 2, 10)


@pytest.fixture(autouse=True)
def style():
    use_style()


@pytest.fixture
def folder(tmp_path):
    """Tables as the stage writes them, with made-up numbers."""
    rng = np.random.default_rng(0)
    beliefs, predictions = [], []
    x = np.linspace(-2, 2, 9)
    for n in COUNTS:
        factor = np.tril(rng.uniform(0.2, 1, (2, 2))) / np.sqrt(1 + n)
        covariance, mean = factor @ factor.T, rng.normal(size=2)
        entries = {f"covariance_{i + 1}_{j + 1}": covariance[i, j] for i, j in np.ndindex(2, 2)}
        beliefs.append({"samples": n, "mean_1": mean[0], "mean_2": mean[1], **entries})
        columns = {name: rng.uniform(0.1, 1, 9) for name in ("mean_y", "sd_y", "exact_mean_y", "exact_sd_y")}
        predictions.append(pd.DataFrame({"x": x, "true_y": 0.5 * x, **columns, "samples": n}))
    samples = {"sample": range(1, 11), "x": rng.uniform(-2, 2, 10), "observed_y": rng.normal(size=10)}
    pd.DataFrame(beliefs).to_parquet(tmp_path / "belief.parquet")
    pd.concat(predictions).to_parquet(tmp_path / "prediction.parquet")
    pd.DataFrame(samples).assign(true_y=0.0).to_parquet(tmp_path / "observed.parquet")
    return tmp_path


@pytest.fixture
def drawing(folder):
    return f3_linear_regression.draw({"regression": folder}, FIGURE)


def test_six_panels_with_samples_in_their_titles(drawing):
    assert drawing.name == "F3-linear-regression"
    titles = [axes.get_title(loc="left") for axes in drawing.figure.axes]
    assert [title[:3] for title in titles] == ["(a)", "(b)", "(c)", "(d)", "(e)", "(f)"]
    for row, seen in enumerate(("no samples", "2 samples", "10 samples")):
        assert all(title.endswith(seen) for title in titles[2 * row : 2 * row + 2])
    left = drawing.figure.axes[::2]
    assert len({axes.get_xlim() + axes.get_ylim() for axes in left}) == 1


def part(drawing, name, samples=None):
    rows = drawing.table[drawing.table["shown"] == name]
    return rows if samples is None else rows[rows["samples"] == samples]


def test_curves_and_samples_are_those_of_the_table(drawing):
    for n, axes in zip(COUNTS, drawing.figure.axes[1::2], strict=True):
        rows, seen = part(drawing, "prediction", n), part(drawing, "observed")
        lines = [line.get_ydata() for line in axes.lines]
        exact, sd = rows["exact_mean_y"], rows["exact_sd_y"]
        expected = [rows["true_y"], seen[seen["sample"] <= n]["observed_y"], exact, exact - sd, exact + sd,
                    rows["mean_y"]]  # fmt: skip
        for line, values in zip(lines, expected, strict=True):
            np.testing.assert_array_equal(line, values)
        band = axes.collections[0].get_paths()[0].vertices[:, 1]
        assert set(band) >= set(rows["mean_y"] - rows["sd_y"]) | set(rows["mean_y"] + rows["sd_y"])


def test_ellipses_are_contours_of_the_beliefs(drawing):
    for n, axes in zip(COUNTS, drawing.figure.axes[::2], strict=True):
        ellipses = [p for p in axes.patches if isinstance(p, Ellipse)]
        # Filled and outlined at 1 and 2 sd; the prior's outlines come first where it is not the belief.
        behind = 2 if n else 0
        assert len(ellipses) == 4 + behind
        for i, ellipse in enumerate(ellipses):
            row = part(drawing, "belief", 0 if i < behind else n).iloc[0]
            precision = np.linalg.inv(
                [
                    [row["covariance_1_1"], row["covariance_1_2"]],
                    [row["covariance_2_1"], row["covariance_2_2"]],
                ]
            )
            edge = ellipse.get_transform() - axes.transData
            points = edge.transform([(np.cos(a), np.sin(a)) for a in np.linspace(0, 6, 7)])
            offset = points - row[["mean_1", "mean_2"]].to_numpy(float)
            distance = np.sqrt(np.einsum("ni,ij,nj->n", offset, precision, offset))
            sd = round(distance[0])
            assert sd in (1, 2)
            # Rounding of transforms to pixels and back.
            np.testing.assert_allclose(distance, sd, rtol=1e-9)


def test_nothing_lies_outside_the_axes(drawing):
    for axes in drawing.figure.axes[1::2]:
        (low, high), rows = axes.get_ylim(), part(drawing, "prediction")
        assert low < (rows["mean_y"] - rows["sd_y"]).min()
        assert high > (rows["mean_y"] + rows["sd_y"]).max()
        assert low < part(drawing, "observed")["observed_y"].min()
        assert high > part(drawing, "observed")["observed_y"].max()


def test_belief_of_one_dimension_is_refused_with_a_remedy(folder):
    belief = pd.read_parquet(folder / "belief.parquet")[["samples", "mean_1", "covariance_1_1"]]
    belief.to_parquet(folder / "belief.parquet")
    with pytest.raises(InputError, match=r"regression\.kalman\.latent to 2"):
        f3_linear_regression.draw({"regression": folder}, FIGURE)


def test_same_drawing_gives_the_same_bytes(folder):
    for name in ("first", "second"):
        (folder / name).mkdir()
        save(f3_linear_regression.draw({"regression": folder}, FIGURE), folder / name)
    for suffix in ("png", "pdf", "csv"):
        name = f"F3-linear-regression.{suffix}"
        assert (folder / "first" / name).read_bytes() == (folder / "second" / name).read_bytes()
