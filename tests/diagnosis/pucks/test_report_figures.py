"""Figures and the Rerun recording of a diagnosis: what is seen is what was found."""

import subprocess
import sys
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from matplotlib.collections import PathCollection
from matplotlib.container import ErrorbarContainer
from matplotlib.quiver import Quiver
from rerun.chunk import RrdReader
from slapshot import plotting
from slapshot.arrays import GRAVITY
from slapshot.diagnosis.pucks.held_out import predict_held_out
from slapshot.diagnosis.pucks.report import (
    FIGURES,
    errors_figure,
    hits_figure,
    location_map,
    ranking,
    tracks_figure,
)
from slapshot.diagnosis.pucks.report.by_variable import launch_table
from slapshot.diagnosis.pucks.report.outcome import Launches
from slapshot.diagnosis.pucks.report.rerun_recording import HIT, RECORDING_FILE
from slapshot.diagnosis.pucks.report.sentences import VERDICT_TEXT, headline
from slapshot.diagnosis.pucks.verdict import Location
from slapshot.diagnosis.pucks.verdict_file import VERDICT_FILE
from slapshot.plotting import STAND_IN
from slapshot.viewer.bodies import TIME
from waiting import HANG_S

from .conftest import SLOPE

MAX_BYTES = 2_000_000
SINGLE = 1e-6  # m: Rerun keeps single precision

# --- Figures


def test_files_are_written_for_all_kinds_of_verdict(reports):
    figures = {f"{module.NAME}.{suffix}" for module in FIGURES for suffix in ("png", "pdf", "csv")}
    everything = {VERDICT_FILE, VERDICT_TEXT, RECORDING_FILE} | figures
    assert {p.name for p in reports["tilt"].folder.iterdir()} == everything
    assert {p.name for p in reports["nothing"].folder.iterdir()} == everything
    hits = {f"{hits_figure.NAME}.{suffix}" for suffix in ("png", "pdf", "csv")}
    for name in ("cannot tell", "no fit"):
        assert {p.name for p in reports[name].folder.iterdir()} == {VERDICT_FILE, VERDICT_TEXT} | hits
    for module in FIGURES:
        assert f"]({module.NAME}.png)" in reports["tilt"].text
        assert module.CAPTION in reports["tilt"].text


def test_tables_are_saved_beside_the_figures(tilt, drawings):
    for name, shown in drawings.items():
        saved = pd.read_csv(tilt.folder / f"{name}.csv")
        assert list(saved) == list(shown.table)
        numeric = saved.select_dtypes("number").columns
        np.testing.assert_allclose(saved[numeric], shown.table[numeric].astype(float), rtol=1e-5, atol=1e-12)


def test_arrows_and_bins_of_the_location_map_are_those_of_its_table(drawings):
    shown = drawings[location_map.NAME]
    table = shown.table
    a, b = shown.figure.axes
    arrows = table[table["panel"] == "a"]
    quivers = [q for q in a.collections if isinstance(q, Quiver)]
    for quiver, significant in zip(quivers, (False, True), strict=True):
        rows = arrows[arrows["significant"] == significant]
        np.testing.assert_array_equal(quiver.XY, rows[["x_m", "y_m"]])
        np.testing.assert_array_equal(np.column_stack([quiver.U, quiver.V]), rows[["ax_m_s2", "ay_m_s2"]])
    bins = table[(table["panel"] == "b") & (table["scene"] == "nominal")]
    bars = [c for c in b.containers if isinstance(c, ErrorbarContainer)]
    for side, bar in zip(("along", "left"), bars, strict=True):
        rows = bins[bins["side"] == side]
        np.testing.assert_allclose(bar.lines[0].get_ydata().astype(float), rows["value"])
        ends = np.array([s[:, 1] for s in bar.lines[2][0].get_segments()])
        np.testing.assert_allclose(ends, rows[["low", "high"]])
    tracks = table[table["panel"] == "tracks"]
    assert sum(len(line.get_xdata()) for line in a.lines) == len(tracks)


def test_the_location_map_shows_the_slope(drawings):
    table = drawings[location_map.NAME].table
    arrows = table[table["panel"] == "a"]
    sure = arrows[arrows["significant"].astype(bool)]
    assert len(sure) >= 2
    assert ((sure["ay_low"] < -GRAVITY * SLOPE) & (sure["ay_high"] > -GRAVITY * SLOPE)).mean() >= 0.5
    bins = table[(table["panel"] == "b") & (table["scene"] == "nominal")]
    assert set(bins["variable"]) == {"heading"}
    heading = (bins["bin_low"] + bins["bin_high"]) / 2
    left, along = bins["side"] == "left", bins["side"] == "along"
    # Downhill is -y: to the right of who moves along x, along the motion of who moves along -y.
    assert np.corrcoef(bins[left]["value"], -np.cos(heading[left]))[0, 1] > 0.5
    assert np.corrcoef(bins[along]["value"], -np.sin(heading[along]))[0, 1] > 0.8
    after = table[(table["panel"] == "b") & (table["scene"] == "augmented")]
    assert np.abs(after["value"]).max() < np.abs(bins["value"]).max() / 2


def test_launches_are_compared_with_those_of_their_commands():
    rng = np.random.default_rng(0)
    heading = rng.uniform(-1, 1, 400)
    nominal = np.zeros((400, 5))
    nominal[:, 2], nominal[:, 3] = np.cos(heading), np.sin(heading)
    off = np.zeros_like(nominal)
    off[:, 2], off[:, 3] = 0.1 * np.cos(heading), 0.1 * np.sin(heading)  # faster, not turned
    noise = rng.normal(0, 0.01, nominal.shape)
    launches = Launches(np.zeros(400), nominal + off + noise, nominal, nominal + off)
    table = launch_table(launches, "heading").set_index(["scene", "side"])
    np.testing.assert_allclose(table.loc["nominal", "along"]["value"], 0.1, atol=5 * 0.01 / np.sqrt(50))
    assert table.loc[("nominal", "along"), "significant"].all()
    for key in (("nominal", "left"), ("augmented", "along"), ("augmented", "left")):
        np.testing.assert_allclose(table.loc[key, "value"], 0.0, atol=5 * 0.01 / np.sqrt(50))


def test_launches_have_their_part_of_the_figures(tilt):
    outcome = tilt.outcome
    rng, count = np.random.default_rng(0), len(outcome.fitter.model.tracks)
    expected = np.column_stack([np.zeros((count, 2)), rng.uniform(1, 2, count), np.zeros((count, 2))])
    turned = expected + np.array([0, 0, 0, 0.1, 0])
    told = turned + rng.normal(0, 0.01, turned.shape)
    launches = Launches(outcome.fitter.model.tracks.order, told, expected, turned)
    yaw = replace(
        tilt.verdict.effects[0],
        name="blade_yaw",
        phase="contact",
        variable="command",
        members={"blade_yaw": 1.0},
    )
    outcome = replace(
        outcome,
        verdict=replace(tilt.verdict, location=Location("contact", "command", "20 mm"), effects=(yaw,)),
    )
    outcome.__dict__["launches"] = launches  # a cached property
    plotting.use_style()
    bins = location_map.draw(outcome).table
    bins = bins[bins["panel"] == "b"].set_index(["scene", "side"])
    assert set(bins["unit"]) == {"m/s"}
    np.testing.assert_allclose(bins.loc[("nominal", "left"), "value"], 0.1, atol=0.03)
    np.testing.assert_allclose(bins.loc[("augmented", "left"), "value"], 0.0, atol=0.03)
    plt.close("all")


def test_the_ranking_is_that_of_the_search(tilt, drawings):
    shown = drawings[ranking.NAME]
    table = shown.table[shown.table["panel"] == "a"]
    screen, seen = tilt.diagnosis.screen, tilt.diagnosis.search.seen
    assert dict(zip(table["hypothesis"], table["screen_nats"], strict=True)) == dict(screen.log_evidence)
    assert table["shown_nats"].is_monotonic_decreasing
    for row in table.dropna(subset="refitted_nats").itertuples():
        assert row.refitted_nats == seen[(row.hypothesis,)].log_evidence
    named = table.dropna(subset="class_of")
    assert (
        dict(zip(named["hypothesis"], named["probability"], strict=True)) == tilt.verdict.effects[0].members
    )
    dots = next(c for c in shown.figure.axes[0].collections if isinstance(c, PathCollection))
    np.testing.assert_array_equal(dots.get_offsets()[:, 0], table["screen_nats"])


def test_tracks_are_predicted_as_for_the_errors_of_the_verdict(tilt):
    outcome = tilt.outcome
    predicted = outcome.predicted
    wanted = predict_held_out(outcome.held_out, outcome.nominal.fit)
    np.testing.assert_allclose(predicted.rmse(predicted.nominal) ** 2, wanted.track_square, rtol=1e-6)
    mean = np.sqrt((predicted.rmse(predicted.augmented) ** 2).mean())
    np.testing.assert_allclose(mean, tilt.verdict.fit["augmented"].track_rmse_m.value, rtol=1e-6)


def test_tracks_of_the_hits_that_differ_most_are_drawn(tilt, drawings):
    shown = drawings[tracks_figure.NAME]
    predicted = tilt.outcome.predicted
    apart = np.linalg.norm(predicted.augmented - predicted.nominal, axis=-1) * predicted.ahead
    order = np.argsort(-np.sqrt((apart**2).sum(1) / predicted.ahead.sum(1)))
    hits = list(dict.fromkeys(shown.table["hit"]))
    assert hits == predicted.hit[order][: tracks_figure.HITS].tolist()
    for axes, hit in zip(shown.figure.axes, hits, strict=False):
        rows = shown.table[shown.table["hit"] == hit]
        drawn = {len(line.get_xdata()): line for line in axes.lines}
        for scene in ("recorded", "nominal", "augmented"):
            wanted = np.column_stack([rows[f"{scene}_along_m"], 1e3 * rows[f"{scene}_left_m"]])
            assert any(np.array_equal(np.column_stack(line.get_data()), wanted) for line in axes.lines), (
                hit,
                scene,
                drawn.keys(),
            )
        # Turning changes no distance.
        flat = np.hypot(
            rows["augmented_along_m"] - rows["recorded_along_m"],
            rows["augmented_left_m"] - rows["recorded_left_m"],
        )
        np.testing.assert_allclose(flat, rows["augmented_distance_m"], atol=1e-12)


def test_points_of_the_error_figure_are_the_errors_of_the_verdict(tilt, drawings):
    shown = drawings[errors_figure.NAME]
    table = shown.table.set_index(["measure", "scene"])
    for (measure, scene), row in table.iterrows():
        wanted = getattr(tilt.verdict.fit[scene], measure)
        assert (row["value"], row["low"], row["high"]) == (wanted.value, wanted.low, wanted.high)
    for axes, measure in zip(shown.figure.axes, ("track_rmse_m", "rest_rmse_m"), strict=False):
        drawn = [c.lines[0].get_xdata()[0] for c in axes.containers]
        np.testing.assert_allclose(drawn, 1e3 * table.loc[measure]["value"])


# --- Rerun recording


def read(file, index):
    return RrdReader(file).stream().collect().reader(index=index).to_pandas()


@pytest.mark.parametrize("name", ["tilt", "nothing"])
def test_the_recording_can_be_opened_and_is_small(reports, name):
    file = reports[name].folder / RECORDING_FILE
    command = [sys.executable, "-m", "rerun", "rrd", "verify", str(file)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=HANG_S, check=False)
    assert done.returncode == 0, done.stderr
    assert file.stat().st_size < MAX_BYTES
    schema = RrdReader(file).store().schema()
    assert {HIT, TIME} <= {column.name for column in schema.index_columns()}


def test_the_recording_holds_the_tracks_of_all_hits_and_the_verdict(tilt):
    file = tilt.folder / RECORDING_FILE
    outcome = tilt.outcome
    rows = read(file, HIT).dropna(subset="/one_hit/recorded:Points3D:positions").set_index(HIT)
    parts = [outcome.predicted_used, outcome.predicted]
    assert sorted(rows.index) == sorted(np.concatenate([p.hit for p in parts]))
    for predicted in parts:
        for i, hit in enumerate(predicted.hit):
            row, valid = rows.loc[hit], predicted.valid[i]
            places = np.stack(list(row["/one_hit/recorded:Points3D:positions"]))
            np.testing.assert_allclose(places[:, :2], predicted.recorded[i][valid], atol=SINGLE)
            strip = np.stack(list(row["/one_hit/augmented:LineStrips3D:strips"][0]))
            np.testing.assert_allclose(strip[:, :2], predicted.augmented[i][valid], atol=SINGLE)
            error = row["/track_error_mm/augmented:Scalars:scalars"][0]
            np.testing.assert_allclose(error, 1e3 * predicted.rmse(predicted.augmented)[i], rtol=1e-6)
    static = read(file, None)
    text = static["/verdict:TextDocument:text"].dropna().iloc[0][0]
    assert text.startswith(f"# {headline(tilt.verdict)}")
    assert STAND_IN in text
    vectors = np.stack(list(static["/residual_push:Arrows3D:vectors"].dropna().iloc[0]))
    arrows = outcome.arrows
    scale = location_map.arrow_scale(arrows)
    np.testing.assert_allclose(vectors[:, :2], scale * arrows[["ax_m_s2", "ay_m_s2"]], atol=SINGLE)


def test_all_objects_slide_on_the_timeline_of_time(tilt):
    rows = read(tilt.folder / RECORDING_FILE, TIME).dropna(subset="/all_hits/recorded:Points3D:positions")
    places = np.stack([np.stack(list(p)) for p in rows["/all_hits/recorded:Points3D:positions"]])
    parts = [tilt.outcome.predicted_used, tilt.outcome.predicted]
    first = np.concatenate([p.recorded[:, 0] for p in parts])
    last = np.concatenate([p.recorded[np.arange(len(p.hit)), p.last] for p in parts])
    np.testing.assert_allclose(places[0, :, :2], first, atol=SINGLE)
    np.testing.assert_allclose(places[-1, :, :2], last, atol=SINGLE)
