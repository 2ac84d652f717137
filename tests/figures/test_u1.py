"""U1 from fabricated coverages and predictions."""

import numpy as np
import pandas as pd
import pytest
from slapshot.figures import u1_coverage
from slapshot.plotting import STAND_IN
from told import FIGURE

LEVELS, SAMPLES, VARIANCES = (0.5, 0.975), (0, 2, 8), (0.0, 0.1, 0.5)


def coverage(seed: int = 0) -> pd.DataFrame:
    rng = np.random.default_rng(seed)
    rows = [
        (model, variance, n, level, kind, rng.uniform(0, 1), rng.uniform(0.01, 0.1))
        for model in range(3)
        for variance in (np.nan, *VARIANCES)
        for n in SAMPLES
        for level in LEVELS
        for kind in ("raw", "calibrated")
    ]
    columns = ["model", "noise_variance", "samples", "level", "kind", "coverage", "area_m2"]
    return pd.DataFrame(rows, columns=columns)


def predictions(rigs: int = 4, hits: int = 50, seed: int = 1) -> pd.DataFrame:
    """Hits at known Mahalanobis distances: 0.6 of them within the first radius, all but one in the second."""
    rng = np.random.default_rng(seed)
    factor = np.array([[0.2, 0.0], [0.1, 0.05]])
    rows = []
    for source in ("recorded", "simulated"):
        for rig in range(rigs):
            for n in SAMPLES:
                for hit in range(hits):
                    distance2 = 1.0 if hit < 0.6 * hits else 3.0 if hit < hits - 1 else 9.0
                    angle = rng.uniform(0, 2 * np.pi)
                    off = factor @ np.array([np.cos(angle), np.sin(angle)]) * np.sqrt(distance2)
                    place = rng.normal(size=2)
                    rows.append((source, "lab", rig, n, *place, *(place + off)))
    table = pd.DataFrame(
        rows, columns=["source", "recording", "rig", "samples", "x_m", "y_m", "true_x_m", "true_y_m"]
    )
    cov = factor @ factor.T
    return table.assign(
        **{
            "cov_xx": cov[0, 0],
            "cov_xy": cov[0, 1],
            "cov_yy": cov[1, 1],
            "radius2_50": 2.0,
            "radius2_97.5": 4.0,
        }
    )


@pytest.fixture
def make(tmp_path):
    def make(shown: pd.DataFrame | None = None):
        folders = {name: tmp_path / name for name in ("calibrate", "predictions")}
        for folder in folders.values():
            folder.mkdir(exist_ok=True)
        coverage().to_parquet(folders["calibrate"] / "coverage.parquet")
        table = predictions() if shown is None else shown
        table.to_parquet(folders["predictions"] / "predictions.parquet")
        return folders

    return make


def test_lines_are_those_of_the_table(make, panel, texts):
    drawing = u1_coverage.draw(make(), FIGURE)
    assert drawing.name == "U1-hockey-coverage"
    table = drawing.table
    measured = coverage()
    trained = measured[measured["noise_variance"].isna()]
    expected = trained.groupby(["kind", "level", "samples"])["coverage"].agg(["mean", "min", "max"])
    for letter, keys in (
        ("a", [(kind, level, None) for kind in ("raw", "calibrated") for level in LEVELS]),
        ("b", [("calibrated", level, v) for v in VARIANCES for level in LEVELS]),
        ("c", [("calibrated", level, None) for level in LEVELS]),
    ):
        axes = panel(drawing.figure, f"({letter})")
        curves = [line for line in axes.lines if line.get_marker() == "o"]
        for line, (kind, level, variance) in zip(curves, keys, strict=True):
            rows = table[
                (table["panel"].str.startswith(letter)) & (table["kind"] == kind) & (table["level"] == level)
            ]
            rows = rows if variance is None else rows[rows["noise_variance"] == variance]
            assert line.get_xydata() == pytest.approx(rows[["samples", "coverage"]].to_numpy())
            assert len(rows) == len(SAMPLES)
            if letter == "a":
                assert rows[["coverage", "low", "high"]].to_numpy() == pytest.approx(
                    expected.loc[(kind, level)].to_numpy()
                )
        nominal = [line for line in axes.lines if line.get_linestyle() == ":"]
        assert [line.get_ydata()[0] for line in nominal] == list(LEVELS)
    seen = texts(drawing.figure)
    for word in (STAND_IN, "raw", "calibrated", "noise variance 0.5", "97.5 %", "(d)"):
        assert word in seen


def test_recorded_coverage_is_the_share_within_the_radius(make):
    """Distances are known: 0.6 and 0.98 lie inside, of every rig, so that rigs do not differ."""
    table = u1_coverage.draw(make(), FIGURE).table
    recorded = table[table["panel"] == "c"].set_index(["level", "samples"])
    for n in SAMPLES:
        for level, share in zip(LEVELS, (0.6, 0.98), strict=True):
            row = recorded.loc[(level, n)]
            assert row[["coverage", "low", "high"]].tolist() == pytest.approx([share] * 3)


def test_the_interval_is_over_rigs(make):
    shown = predictions()
    # All hits of rig 0 lie inside: shares of 1, 0.6, 0.6, 0.6.
    shown.loc[shown["rig"] == 0, ["true_x_m", "true_y_m"]] = shown[["x_m", "y_m"]].to_numpy()[
        shown["rig"] == 0
    ]
    table = u1_coverage.draw(make(shown), FIGURE).table
    row = table[(table["panel"] == "c") & (table["level"] == 0.5)].iloc[0]
    assert row["coverage"] == pytest.approx(0.7)
    assert row["high"] - row["coverage"] == pytest.approx(1.96 * 0.2 / 2)


def test_areas_are_those_of_the_largest_level(make, panel):
    drawing = u1_coverage.draw(make(), FIGURE)
    axes = panel(drawing.figure, "(d)")
    assert "97.5 %" in axes.get_title(loc="left")
    for kind, line in zip(("raw", "calibrated"), axes.lines, strict=True):
        rows = drawing.table[
            (drawing.table["panel"] == "a, d")
            & (drawing.table["kind"] == kind)
            & (drawing.table["level"] == 0.975)
        ]
        assert line.get_ydata() == pytest.approx(1e4 * rows["area_m2"].to_numpy())


@pytest.mark.parametrize("rigs", [0, 1])
def test_one_rig_or_none_can_be_drawn(make, rigs, texts):
    shown = predictions()
    shown = shown[(shown["source"] == "simulated") | (shown["rig"] < rigs)]
    drawing = u1_coverage.draw(make(shown), FIGURE)
    assert (drawing.table["panel"] == "c").sum() == rigs * len(LEVELS) * len(SAMPLES)


def test_the_same_drawing_gives_the_same_bytes(make, assert_same_bytes):
    folders = make()
    assert_same_bytes(lambda: u1_coverage.draw(folders, FIGURE))
