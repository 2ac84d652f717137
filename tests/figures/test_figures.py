import os
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from slapshot.figures import f7_simulated, f8_recorded, t2_randomisation
from slapshot.figures.curves import summarise
from slapshot.figures.drawing import STAND_IN, save, use_style


@pytest.fixture(autouse=True)
def style():
    use_style()


def texts(figure):
    found = [t.get_text() for t in figure.findobj(match=lambda o: hasattr(o, "get_text"))]
    return "\n".join(found)


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


def recorded_errors(stand_in, seed=0):
    rng = np.random.default_rng(seed)
    rows = [
        ("kalman", model, name, repeat, samples, stand_in)
        for model in range(3)
        for name in ("red", "blue")
        for repeat in range(4)
        for samples in range(17)
    ]
    table = pd.DataFrame(rows, columns=["method", "model", "object", "repeat", "samples", "stand_in"])
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


@pytest.fixture
def simulated(tmp_path):
    folders = {}
    for method in ("kalman", "lstm"):
        folders[method] = tmp_path / method
        folders[method].mkdir()
        simulated_errors(method).to_parquet(folders[method] / "errors.parquet")
    return f7_simulated.draw(folders, {"domain": "hockey"})


def test_simulated_figure_shows_every_method_and_panel(simulated):
    assert simulated.name == "F7-hockey-simulated"
    seen = texts(simulated.figure)
    for word in ("Kalman", "LSTM", "(a)", "(b)", "(c)", "cm", "samples seen", "noise variance 0.5"):
        assert word in seen
    assert set(simulated.table["panel"]) == {"a", "b", "c"}


def test_what_is_drawn_is_what_the_table_says(simulated):
    axes = simulated.figure.findobj(match=lambda o: hasattr(o, "get_title") and hasattr(o, "lines"))
    first = next(a for a in axes if a.get_title(loc="left").startswith("(a)"))
    panel = simulated.table[simulated.table["panel"] == "a"]
    for method, line in zip(("kalman", "lstm"), first.lines, strict=True):
        rows = panel[panel["method"] == method]
        assert line.get_ydata() == pytest.approx(100 * rows["error_m"].to_numpy())


@pytest.mark.parametrize("stand_in", [True, False])
def test_recorded_figure_names_a_stand_in_as_one(tmp_path, stand_in):
    recorded_errors(stand_in).to_parquet(tmp_path / "errors.parquet")
    drawing = f8_recorded.draw({"kalman/lab": tmp_path}, {"domain": "hockey"})
    assert (STAND_IN in texts(drawing.figure)) == stand_in
    assert drawing.table["stand_in"].all() == stand_in
    assert {"red", "blue"} <= set(drawing.table["object"].dropna())


def test_randomisation_table_is_the_configuration(hockey_config):
    config = {"domain": "hockey", "randomisation": hockey_config["randomisation"]}
    drawing = t2_randomisation.draw({}, config)
    table = drawing.table.set_index("parameter")
    assert table.loc["friction_y", "times"] == "friction_x"
    assert table.loc["mass", ["low_or_mean", "high_or_sd"]].tolist() == [0.01, 0.1]
    assert table.index[0] == "mass"


def test_same_drawing_gives_the_same_bytes(tmp_path, simulated):
    first, second = tmp_path / "first", tmp_path / "second"
    folders = {m: tmp_path / m for m in ("kalman", "lstm")}
    for folder in (first, second):
        folder.mkdir()
        save(f7_simulated.draw(folders, {"domain": "hockey"}), folder)
    for suffix in ("png", "pdf", "csv"):
        name = f"F7-hockey-simulated.{suffix}"
        assert (first / name).read_bytes() == (second / name).read_bytes()


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
