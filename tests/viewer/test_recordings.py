"""What the stage writes, read back with Rerun's own tools."""

import subprocess
import sys

import mujoco
import numpy as np
import pandas as pd
import pytest
from rerun.chunk import RrdReader
from slapshot.command import Run
from slapshot.errors import InputError
from slapshot.viewer.__main__ import produce
from slapshot.viewer.bodies import TIME
from slapshot.viewer.hit_recording import CARDS_FILE, LAYOUT_FILE, SCENE_FILE, STEP
from slapshot.viewer.hits import STAND_IN
from waiting import HANG_S

from .conftest import CONFIG, HITS, SAMPLES, Made, read, values

MAX_BYTES = 100_000
SINGLE = 1e-6  # m and rad: Rerun keeps single precision


def files(made: Made):
    return [made.folder / hit["file"] for hit in made.hits]


def test_every_file_can_be_opened(made):
    everything = [*files(made), *(made.folder / n for n in (SCENE_FILE, LAYOUT_FILE, CARDS_FILE))]
    command = [sys.executable, "-m", "rerun", "rrd", "verify", *map(str, everything)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=HANG_S, check=False)
    assert done.returncode == 0, done.stderr


def test_ids_are_unique_and_those_of_the_index(made):
    ids = [RrdReader(file).recordings()[0].recording_id for file in files(made)]
    assert ids == [hit["recording_id"] for hit in made.hits]
    assert len(set(ids)) == len(ids) == CONFIG["simulated"] + CONFIG["recorded"]
    assert {p.name for p in (made.folder / "hits").iterdir()} == {f"{i}.rrd" for i in ids}


def test_the_same_inputs_give_the_same_hits(made, tmp_path):
    produce(Run(CONFIG, made.inputs, tmp_path, 1))
    assert (tmp_path / "index.json").read_bytes() == (made.folder / "index.json").read_bytes()


def test_hits_are_small(made):
    assert max(file.stat().st_size for file in files(made)) < MAX_BYTES


@pytest.mark.parametrize("source", ["simulated", "recorded"])
def test_timelines(made, source):
    schema = RrdReader(made.folder / made.hit(source)["file"]).store().schema()
    assert {column.name for column in schema.index_columns()} == {TIME, STEP}


def test_simulated_object_moves_along_its_track(made):
    hit = made.hit("simulated")
    tracks = pd.read_parquet(made.inputs["rollouts"] / "tracks.parquet")
    wanted = tracks[(tracks["split"] == "test") & (tracks["condition"] == hit["condition"])]
    wanted = wanted[wanted["hit"] == hit["hit"]]
    rows = read(made.folder / hit["file"], TIME).dropna(subset="/object:Transform3D:translation")
    positions = np.concatenate(values(rows, "/object:Transform3D:translation"))
    np.testing.assert_allclose(rows[TIME], wanted["t"], atol=SINGLE)
    np.testing.assert_allclose(positions[:, :2], wanted[["x", "y"]], atol=SINGLE)
    quaternions = np.concatenate(values(rows, "/object:Transform3D:quaternion"))
    np.testing.assert_allclose(2 * np.arcsin(quaternions[:, 2]), wanted["yaw"], atol=1e-5)
    (strips,) = values(read(made.folder / hit["file"], None), "/track:LineStrips3D:strips")
    np.testing.assert_allclose(strips[0, :, :2], wanted[["x", "y"]], atol=SINGLE)


def test_recorded_object_is_where_the_camera_saw_it_and_the_line_breaks_at_gaps(made):
    hit = made.hit("recorded")
    seen = made.recording.tracks[made.recording.tracks["hit"] == hit["hit"]]
    rows = read(made.folder / hit["file"], TIME).dropna(subset="/object:Transform3D:translation")
    positions = np.concatenate(values(rows, "/object:Transform3D:translation"))
    np.testing.assert_allclose(rows[TIME], seen["t"], atol=SINGLE)
    np.testing.assert_allclose(positions[:, :2], seen[["x", "y"]], atol=SINGLE)
    strips = read(made.folder / hit["file"], None)["/track:LineStrips3D:strips"].iloc[0]
    gaps = (np.diff(seen["t"]) > 1.5 / made.recording.camera_rate_hz).sum()
    assert 1 <= len(strips) <= gaps + 1


@pytest.mark.parametrize("source", ["simulated", "recorded"])
@pytest.mark.parametrize(("name", "samples"), [("before", 0), ("after", max(SAMPLES))])
def test_regions_and_points_are_those_predicted(made, source, name, samples):
    hit = made.hit(source)
    belief = made.beliefs(hit).set_index("samples").loc[samples]
    static = read(made.folder / hit["file"], None)
    mean = belief[["x_m", "y_m"]].to_numpy(float)
    inverse = np.linalg.inv([[belief["cov_xx"], belief["cov_xy"]], [belief["cov_xy"], belief["cov_yy"]]])
    (strips,) = values(static, f"/{name}/regions:LineStrips3D:strips")
    for strip, share in zip(strips, (50, 90), strict=True):
        off = strip[:, :2] - mean
        radii2 = np.einsum("ni,ij,nj->n", off, inverse, off)
        np.testing.assert_allclose(radii2, belief[f"radius2_{share}"], rtol=2e-3)
    (points,) = values(static, f"/{name}/point:Points3D:positions")
    np.testing.assert_allclose(points[0, :2], mean, atol=SINGLE)


def test_the_timeline_of_hits_shows_the_end_of_the_motion(made):
    file = made.folder / made.hit("simulated")["file"]
    for column in ("/object:Transform3D:translation", "/scene/link7:Transform3D:quaternion"):
        end = values(read(file, TIME), column)[-1]
        np.testing.assert_array_equal(values(read(file, STEP), column)[-1], end)


def test_the_belief_can_be_followed_hit_by_hit(made):
    hit = made.hit("simulated")
    rows = read(made.folder / hit["file"], STEP).dropna(subset="/learning/point:Points3D:positions")
    assert tuple(rows[STEP]) == SAMPLES
    positions = np.concatenate(values(rows, "/learning/point:Points3D:positions"))
    np.testing.assert_allclose(positions[:, :2], made.beliefs(hit)[["x_m", "y_m"]], atol=SINGLE)


@pytest.mark.parametrize("source", ["simulated", "recorded"])
def test_the_cross_the_text_and_the_index_agree_with_the_truth(made, source):
    hit = made.hit(source)
    beliefs = made.beliefs(hit)
    truth = beliefs[["true_x_m", "true_y_m"]].to_numpy(float)[0]
    errors = np.linalg.norm(beliefs[["x_m", "y_m"]].to_numpy(float) - truth, axis=1)
    assert hit["error_before_m"] == pytest.approx(errors[0])
    assert hit["error_after_m"] == pytest.approx(errors[-1])
    static = read(made.folder / hit["file"], None)
    (cross,) = values(static, "/rest:LineStrips3D:strips")
    np.testing.assert_allclose(cross[:, :, :2].mean((0, 1)), truth, atol=SINGLE)
    text = static["/about:TextDocument:text"].iloc[0][0]
    assert f"**{100 * errors[0]:.1f} cm** before" in text
    assert f"**{100 * errors[-1]:.1f} cm** after {max(SAMPLES)}" in text
    assert (STAND_IN in text) == (source == "recorded")


def test_the_scene_is_there_once_and_the_arm_moves_as_its_kinematics_say(made, rig):
    scene = read(made.folder / SCENE_FILE, None)
    model = rig.scene.compile()
    shown = [
        model.geom(i).name
        for i in range(model.ngeom)
        if model.geom_rgba[i, 3] and model.geom(i).name != "puck"
    ]
    entities = {c.split(":")[0] for c in scene.columns if c.startswith("/scene/")}
    assert {e.rsplit("/", 1)[1] for e in entities} == set(shown)

    hit = made.hit("recorded")
    joints = made.recording.joints[made.recording.joints["hit"] == hit["hit"]]
    data = mujoco.MjData(model)
    data.qpos[rig.scene.layout.arm_q] = joints[[f"q{i}" for i in range(7)]].to_numpy()[0]
    mujoco.mj_kinematics(model, data)
    rows = read(made.folder / hit["file"], TIME)
    position = values(rows, "/scene/link7:Transform3D:translation")[0][0]
    rotation = values(rows, "/scene/link7:Transform3D:quaternion")[0][0]
    np.testing.assert_allclose(position, data.body("link7").xpos, atol=SINGLE)
    assert abs(rotation @ np.roll(data.body("link7").xquat, -1)) == pytest.approx(1, abs=SINGLE)


def test_a_recording_of_ones_own_is_shown_too(made, tmp_path):
    inputs = dict(made.inputs)
    folder = inputs.pop("lab/lab/0") / "recording"
    produce(Run(CONFIG | {"recordings": {"lab": {"path": str(folder)}}}, inputs, tmp_path, 1))
    pd.testing.assert_frame_equal(
        pd.read_parquet(tmp_path / "index.parquet"), pd.read_parquet(made.folder / "index.parquet")
    )


def test_as_many_as_there_are_if_more_are_wanted(made, tmp_path):
    produce(Run({**CONFIG, "simulated": 10**6, "recorded": 0}, made.inputs, tmp_path, 1))
    assert len(pd.read_parquet(tmp_path / "index.parquet")) == 2 * HITS


def test_nothing_to_show_is_said(made, tmp_path):
    with pytest.raises(InputError, match="no hit to show"):
        produce(Run({**CONFIG, "simulated": 0, "recorded": 0}, made.inputs, tmp_path, 1))
