import os
import subprocess
import sys

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from slapshot.config.randomisation import MassDistribution, Randomisation, StartErrorDistribution
from slapshot.config.results import RandomisationFigureSettings
from slapshot.error_curves import draw_curves, summarise
from slapshot.figures import f7_simulated, f8_recorded, randomisation_table
from slapshot.plotting import STAND_IN, method_colour, method_line, method_name
from told import FIGURE

METHODS = ("kalman", "lstm", "maml_1", "maml_8")


def simulated_errors(method="kalman", seed=0):
    rng = np.random.default_rng(seed)
    rows = [
        (method, model, name, condition, variance, variance**0.5 * 0.1, samples)
        for model in range(3)
        for condition, name in enumerate(["", "", *f7_simulated.FRICTIONS])
        for variance in (0.0, 0.1, 0.5)
        for samples in range(17)
    ]
    columns = ["method", "model", "name", "condition", "noise_variance", "noise_sd_m", "samples"]
    table = pd.DataFrame(rows, columns=columns)
    table["error_m"] = 0.3 / (1 + table["samples"]) + rng.uniform(0, 0.02, len(table))
    return table


def recorded_errors(stand_in, seed=0, rigs=1):
    rng = np.random.default_rng(seed)
    rows = [
        ("kalman", model, rig, name, repeat, samples, stand_in)
        for model in range(3)
        for rig in range(rigs)
        for name in ("red", "blue")
        for repeat in range(4)
        for samples in range(17)
    ]
    table = pd.DataFrame(rows, columns=["method", "model", "rig", "object", "repeat", "samples", "stand_in"])
    table["error_m"] = 0.4 / (1 + table["samples"]) + rng.uniform(0, 0.02, len(table))
    return table


def test_summary_is_mean_spread_and_interval_over_models():
    errors = pd.DataFrame(
        {"method": "m", "samples": 0, "model": [0, 0, 1, 1], "error_m": [0.1, 0.3, 0.2, 0.4]}
    )
    row = summarise(errors, ["method"]).iloc[0]
    assert row["error_m"] == pytest.approx(0.25)
    assert row["sd_m"] == pytest.approx(np.std([0.1, 0.3, 0.2, 0.4]))
    # Model means 0.2 and 0.3: Student's t with one degree of freedom has 12.706 at 97.5 %.
    half = 12.706 * np.std([0.2, 0.3], ddof=1) / np.sqrt(2)
    assert row["mean_high_m"] - row["error_m"] == pytest.approx(half, rel=1e-3)


def test_the_interval_can_be_over_rigs_instead():
    errors = pd.DataFrame(
        {"samples": 0, "model": [0, 1, 0, 1], "rig": [0, 0, 1, 1], "error_m": [0.1, 0.3, 0.2, 0.4]}
    )
    row = summarise(errors, [], "rig").iloc[0]
    # Rigs' means are 0.2 and 0.3, as those of the models are 0.15 and 0.35.
    assert row["mean_high_m"] - 0.25 == pytest.approx(12.706 * np.sqrt(0.005 / 2), rel=1e-3)
    assert summarise(errors, []).iloc[0]["mean_high_m"] - 0.25 == pytest.approx(12.706 * 0.1, rel=1e-3)


def test_curves_are_told_apart_by_colour_and_by_line():
    looks = {m: (method_colour(m), str(method_line(m))) for m in (*METHODS, "maml_4")}
    assert len(set(looks.values())) == len({line for _, line in looks.values()}) == len(looks)
    assert len({colour for colour, _ in looks.values()}) == len(looks)
    # What has no look of its own has one that is the same in every process.
    assert method_colour("kalman_wide") == method_colour("kalman_wide")
    assert method_colour("kalman_wide") not in {colour for colour, _ in looks.values()}
    assert method_line("kalman_wide") == "-"
    assert method_name("kalman_wide") == "kalman wide"


@pytest.mark.parametrize("band", ["sd", "mean", ""])
def test_bands_are_those_of_the_summary(band):
    summary = summarise(pd.concat([simulated_errors("kalman"), simulated_errors("lstm", 1)]), ["method"])
    _, axes = plt.subplots()
    draw_curves(axes, summary, last=8, band=band)
    assert [line.get_color() for line in axes.lines] == [method_colour(m) for m in ("kalman", "lstm")]
    assert [line.get_linestyle() for line in axes.lines] == ["-", "--"]
    assert axes.get_xlim() == (0, 8)
    assert len(axes.collections) == (2 if band else 0)
    for method, line, drawn in zip(("kalman", "lstm"), axes.lines, axes.collections, strict=False):
        rows = summary[(summary["method"] == method) & (summary["samples"] <= 8)]
        assert line.get_ydata() == pytest.approx(100 * rows["error_m"].to_numpy())
        high = rows["error_m"] + rows["sd_m"] if band == "sd" else rows["mean_high_m"]
        assert drawn.get_paths()[0].vertices[:, 1].max() == pytest.approx(100 * high.max())
        assert drawn.get_paths()[0].vertices[:, 1].min() >= 0


def test_an_empty_summary_draws_nothing():
    _, axes = plt.subplots()
    summary = summarise(simulated_errors(), ["method"])
    draw_curves(axes, summary)
    limits = axes.get_xlim()
    draw_curves(axes, summary[:0])
    assert len(axes.lines) == 1
    assert axes.get_xlim() == limits


@pytest.fixture
def write(tmp_path):
    """Methods -> folders with their errors in simulation."""

    def write(*methods, named=True):
        folders = {}
        for seed, method in enumerate(methods):
            folders[method] = tmp_path / method
            folders[method].mkdir(exist_ok=True)
            table = simulated_errors(method, seed)
            (table if named else table[table["name"] == ""]).to_parquet(folders[method] / "errors.parquet")
        return folders

    return write


@pytest.fixture
def simulated(write):
    return f7_simulated.draw(write(*METHODS), FIGURE)


def test_simulated_figure_shows_every_method_and_panel(simulated, texts):
    assert simulated.name == "F7-hockey-simulated"
    seen = texts(simulated.figure)
    names = [method_name(method) for method in METHODS]
    for word in (*names, "(a)", "(b)", "(c)", "cm", "samples seen", "noise variance 0.5"):
        assert word in seen
    assert set(simulated.table["panel"]) == {"a", "b", "c"}


def test_what_is_drawn_is_what_the_table_says(simulated, panel):
    rows = simulated.table.groupby(["panel", "method"])
    axes = panel(simulated.figure, "(a)")
    for method, line in zip(METHODS, axes.lines, strict=True):
        assert line.get_label() == method_name(method)
        assert line.get_ydata() == pytest.approx(100 * rows.get_group(("a", method))["error_m"].to_numpy())
    # Only the two that the paper shades: more bands would hide one another.
    assert len(axes.collections) == 2
    for letter, titles, column in (
        ("b", dict(zip(f7_simulated.FRICTIONS, f7_simulated.FRICTIONS, strict=True)), "condition"),
        (
            "c",
            {f"noise variance {v:g} (sd {10 * v**0.5:.0f} cm)": v for v in (0.0, 0.1, 0.5)},
            "noise_variance",
        ),
    ):
        for number, (title, key) in enumerate(titles.items()):
            axes = panel(simulated.figure, title if number else f"({letter}) {title}")
            for method, line in zip(METHODS, axes.lines, strict=True):
                own = rows.get_group((letter, method))
                own = own[(own[column] == key) & (own["samples"] <= axes.get_xlim()[1])]
                assert line.get_ydata() == pytest.approx(100 * own["error_m"].to_numpy())


@pytest.mark.parametrize("methods", [("kalman",), ("maml_1", "maml_8"), ("kalman", "lstm")])
def test_some_methods_alone_can_be_drawn(write, methods, panel):
    drawing = f7_simulated.draw(write(*methods, named=False), FIGURE)
    assert len(panel(drawing.figure, "(a)").lines) == len(methods)
    assert set(drawing.table["panel"]) == {"a", "c"}


@pytest.mark.parametrize("stand_in", [True, False])
def test_recorded_figure_names_a_stand_in_as_one(tmp_path, stand_in, texts):
    recorded_errors(stand_in).to_parquet(tmp_path / "errors.parquet")
    drawing = f8_recorded.draw({"kalman/lab": tmp_path}, FIGURE)
    assert (STAND_IN in texts(drawing.figure)) == stand_in
    assert drawing.table["stand_in"].all() == stand_in
    assert {"red", "blue"} <= set(drawing.table["object"].dropna())


@pytest.fixture
def recorded(tmp_path):
    """Two methods on five rigs, and on a recording of one real rig with one object."""
    folders = {}
    for seed, method in enumerate(("kalman", "maml_8")):
        for recording, rigs in (("lab", 5), ("mine", 1)):
            folder = folders[f"{method}/{recording}"] = tmp_path / method / recording
            folder.mkdir(parents=True)
            errors = recorded_errors(rigs > 1, seed, rigs).assign(method=method)
            errors = errors if rigs > 1 else errors[errors["object"] == "red"]
            errors.to_parquet(folder / "errors.parquet")
    return folders


def test_recorded_curves_are_those_of_the_table(recorded, texts):
    drawing = f8_recorded.draw(recorded, FIGURE)
    rows = [axes for axes in drawing.figure.axes if axes.get_visible()]
    # All pucks, the first samples, and each puck.
    assert len(rows) == (2 + 2) + (2 + 1)
    seen = texts(drawing.figure)
    assert "recording “lab”, 5 rigs\n" in seen
    assert "recording “mine”, 1 rig\n" in seen
    objects = {"lab": ["all", "all", "red", "blue"], "mine": ["all", "all", "red"]}
    shown = [(recording, name) for recording, names in objects.items() for name in names]
    table = drawing.table.fillna({"object": "all"})
    for axes, (recording, name) in zip(rows, shown, strict=True):
        for method, line in zip(("kalman", "maml_8"), axes.lines, strict=True):
            own = table[
                (table["recording"] == recording) & (table["object"] == name) & (table["method"] == method)
            ]
            own = own[own["samples"] <= axes.get_xlim()[1]]
            assert line.get_ydata() == pytest.approx(100 * own["error_m"].to_numpy())


def test_the_interval_is_over_rigs_where_there_are_several(recorded):
    table = f8_recorded.draw(recorded, FIGURE).table
    for recording, unit in (("lab", "rig"), ("mine", "model")):
        errors = pd.read_parquet(recorded[f"kalman/{recording}"] / "errors.parquet")
        expected = summarise(errors, ["method"], unit)
        own = table[
            (table["recording"] == recording) & (table["method"] == "kalman") & table["object"].isna()
        ]
        assert own["mean_low_m"].to_numpy() == pytest.approx(expected["mean_low_m"].to_numpy())


def table_of(randomisation: Randomisation) -> RandomisationFigureSettings:
    return RandomisationFigureSettings.from_parts(FIGURE, figure="T1", randomisation=randomisation)


def test_randomisation_table_is_the_configuration(hockey_config):
    drawing = randomisation_table.draw({}, table_of(hockey_config.randomisation))
    table = drawing.table.set_index("parameter")
    assert table.loc["friction_y", "times"] == "friction_x"
    assert table.loc["mass", ["low_or_mean", "high_or_sd"]].tolist() == [0.01, 0.1]
    assert table.index[0] == "mass"


def test_small_numbers_of_the_table_have_no_exponent(hockey_config):
    mass = MassDistribution(uniform=[0.00005, 0.001], label="Mass", unit="kg")
    randomisation = Randomisation.from_parts(hockey_config.randomisation, mass=mass)
    drawing = randomisation_table.draw({}, table_of(randomisation))
    (table,) = drawing.figure.axes[0].tables
    assert r"(0.00005,\ 0.001)" in table[1, 1].get_text().get_text()


def test_what_does_not_vary_is_left_out_of_the_table(hockey_config):
    mass = MassDistribution(uniform=[2.0, 2.0], label="Mass", unit="kg")
    start = StartErrorDistribution(normal=[0.1, 0.0], label="Start", unit="m")
    same = Randomisation.from_parts(hockey_config.randomisation, mass=mass, start_error=start)
    drawing = randomisation_table.draw({}, table_of(same))
    assert not {"mass", "start_error"} & set(drawing.table["parameter"])
    assert drawing.name == "T1-hockey-randomisation"


def test_same_drawing_gives_the_same_bytes(write, recorded, assert_same_bytes):
    folders = write("kalman", "maml_8")
    assert_same_bytes(lambda: f7_simulated.draw(folders, FIGURE))
    assert_same_bytes(lambda: f8_recorded.draw(recorded, FIGURE))


def test_missing_gl_library_names_the_package():
    code = (
        "import ctypes\n"
        "def missing(name, *rest, **more): raise OSError(name)\n"
        "ctypes.CDLL = missing\n"
        "import slapshot.figures.rendering"
    )
    environment = {k: v for k, v in os.environ.items() if k != "MUJOCO_GL"}
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False
    )
    assert result.returncode != 0
    last = result.stderr.strip().splitlines()[-1]
    assert "InputError" in last
    assert "libegl1" in last
