"""Arms: their ranges, their rollouts against the nominal collector's, and the numbers that compare them."""

import json

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from slapshot.command import Run
from slapshot.config.domain import Domain
from slapshot.config.retraining import ArmRolloutsSettings
from slapshot.diagnosis.pucks.augmented import AUGMENTED, write_augmented
from slapshot.effects.catalogue import catalogue
from slapshot.effects.slide_law import slide
from slapshot.errors import InputError
from slapshot.recordings.format import ObjectInfo, Recording
from slapshot.recordings.read import read_recording
from slapshot.recordings.write import write_recording
from slapshot.retraining import ARMS, held_out, rollouts
from slapshot.retraining.collector import AugmentedCollector, swings_with_effects
from slapshot.retraining.compare import errors_by_arm, measures_of, noise_floor
from slapshot.retraining.ranges import refitted_ranges
from slapshot.rollouts.collector import Collector
from slapshot.validation import values_of

CAMERA = np.array([1.65, 0.0])


def one(mass, nominal, final, log_sd=(0.0, 0.0, 0.0)):
    fits = {"nominal": nominal, "final": final}
    return {"mass_kg": mass, "mass_sd_kg": 0.001} | {
        scene: {"friction": list(mu), "log_sd": list(log_sd)} for scene, mu in fits.items()
    }


REFIT = {
    "objects": {
        "red": one(0.1, (0.3, 0.33, 0.004), (0.32, 0.32, 0.004)),
        "blue": one(0.16, (0.4, 0.4, 0.006), (0.4, 0.38, 0.005)),
    },
    "start_error_sd_m": 0.012,
    "held_out": [1, 3],
}


# --- Ranges


def test_ranges_reach_beyond_all_fits_by_the_margin(hockey_config):
    found = values_of(refitted_ranges(hockey_config.randomisation, REFIT, 0.2))
    assert found["friction_x"] == {"uniform": pytest.approx([0.3 / 1.2, 0.4 * 1.2])}
    assert found["friction_y"] == {"uniform": pytest.approx([0.95 / 1.2, 1.1 * 1.2]), "times": "friction_x"}
    assert found["friction_torsional"] == {"uniform": pytest.approx([0.004 / 1.2, 0.006 * 1.2])}
    assert found["mass"] == {"uniform": pytest.approx([0.1 / 1.2, 0.16 * 1.2])}
    assert found["start_error"] == {"normal": [0.0, 0.012]}
    assert found["friction_rolling"]["uniform"] == hockey_config.randomisation.friction_rolling.uniform


def test_what_is_fitted_badly_is_drawn_widely(hockey_config):
    sure, unsure = ({**REFIT, "objects": {"red": one(0.1, *(((0.3, 0.3, 0.004),) * 2), (0.01, 0.01, sd))}}
                    for sd in (0.01, 1.0))  # fmt: skip
    narrow, wide = (
        refitted_ranges(hockey_config.randomisation, r, 0.1).friction_torsional.uniform
        for r in (sure, unsure)
    )
    assert narrow == pytest.approx([0.004 / 1.1, 0.004 * 1.1])
    assert wide == pytest.approx([0.004 * np.exp(-2), 0.004 * np.exp(2)])


# --- Rollouts


def test_without_effects_hits_are_those_of_the_collector(rig, make_hits):
    hits = make_hits(40)
    plain = Collector(rig.scene, rig.swings, 1).collect(hits)
    ours = AugmentedCollector(rig.scene, rig.swings, [], CAMERA, 1).collect(hits)
    np.testing.assert_array_equal(ours.rests[:, :2], plain.rests[:, :2])
    np.testing.assert_array_equal(ours.durations, plain.durations)


def test_a_tilt_acts_on_the_slide_alone_and_a_camera_on_what_is_seen(rig, make_hits):
    hits, known = make_hits(30), catalogue()
    plain = Collector(rig.scene, rig.swings, 1).collect(hits)
    tilt = (known["tilt"], {"slope_x": 0.0, "slope_y": 0.03})
    scale = (known["camera_scale"], {p.name: p.scale for p in known["camera_scale"].parameters})
    ours = AugmentedCollector(rig.scene, rig.swings, [tilt, scale], CAMERA, 1).collect(hits)
    np.testing.assert_array_equal(ours.launches, plain.launches)
    friction = np.stack([hits.conditions[f"friction_{k}"] for k in ("x", "y", "torsional")], axis=1)
    moved = AugmentedCollector(rig.scene, rig.swings, [tilt], CAMERA, 1).collect(hits).rests[:, :2]
    level = slide(plain.launches, friction, rig.scene.info.object_radius, 0.1).rests
    # Downhill is towards -y, by about slope / mu of the way.
    assert (moved[:, 1] < level[:, 1] + 1e-9).all()
    way = np.linalg.norm(level - plain.launches[:, :2], axis=1)
    far = way > 0.2
    share = (level - moved)[far, 1] / way[far] * friction[far, 1] / 0.03
    assert np.median(share) == pytest.approx(1.0, abs=0.5)
    each = {name: np.full(len(moved), value) for name, value in scale[1].items()}
    np.testing.assert_allclose(ours.rests[:, :2], scale[0].see(each, moved[:, None], CAMERA)[:, 0])


def test_swings_are_executed_as_late_as_a_delay_makes_them(rig):
    late = [(catalogue()["command_delay"], {"delay": 0.02})]
    same = swings_with_effects(rig.swings, rig.model, rig.scene, [], 1)
    np.testing.assert_allclose(same.targets, rig.swings.targets, atol=1e-12)
    delayed = swings_with_effects(rig.swings, rig.model, rig.scene, late, 1)
    ticks = round(0.02 / rig.scene.info.control_period)
    np.testing.assert_allclose(delayed.targets[:, ticks:], same.targets[:, :-ticks], atol=1e-9)


@pytest.fixture
def findings(rig, tmp_path):
    folder = tmp_path / "findings"
    folder.mkdir()
    (folder / "refit.json").write_text(json.dumps(REFIT))
    values = {"tilt": {"slope_x": 0.0, "slope_y": 0.03}}
    write_augmented(rig.scene, values, folder / AUGMENTED)
    return folder


def few_rollouts(config: Domain, arm: str) -> ArmRolloutsSettings:
    return ArmRolloutsSettings.from_parts(
        config.rollouts,
        arm=arm,
        seed=1,
        margin=0.2,
        effects=[],
        randomisation=config.randomisation,
        train=3,
        validation=1,
        test=1,
        hits=8,
        named_conditions={},
    )


def test_the_stage_writes_what_methods_read(rig, hockey_config, findings, tmp_path):
    tables = {}
    for arm in ARMS[1:]:
        out = tmp_path / arm
        out.mkdir()
        settings = values_of(few_rollouts(hockey_config, arm))
        rollouts.produce(Run(settings, {**rig.folders, "findings": findings}, out, 1))
        tables[arm] = pq.read_table(out / "hits-train.parquet").to_pandas()
        drawn = pd.read_parquet(out / "conditions.parquet")
        assert drawn["friction_x"].between(0.25, 0.48).all()
        assert json.loads((out / "effects.json").read_text()) == (
            {} if arm == "refitted" else {"tilt": {"slope_x": 0.0, "slope_y": 0.03}}
        )
    ends = {arm: np.stack(table["outcome"].to_list()) for arm, table in tables.items()}
    assert ends["augmented"].shape == (24, 2)
    assert (ends["augmented"][:, 1] <= ends["refitted"][:, 1] + 1e-3).all()


def test_a_diagnosis_that_could_not_tell_is_no_ground_for_arms(rig, hockey_config, tmp_path):
    run = Run(
        values_of(few_rollouts(hockey_config, "augmented")),
        {**rig.folders, "findings": tmp_path},
        tmp_path,
        1,
    )
    with pytest.raises(InputError, match=r"could not tell.*retraining\.recording"):
        rollouts.produce(run)


# --- Held-out hits and the comparison


def recording(ends, commands):
    count = len(ends)
    hits = pd.DataFrame(
        {
            "hit": np.arange(count),
            "object_id": "red",
            "order": np.arange(count),
            "recorded_at": pd.Series(pd.NaT, index=range(count), dtype="datetime64[us, UTC]"),
            "command_id": pd.array(commands, dtype="Int64"),
            "start_x": 0.0,
            "start_y": 0.0,
            "rest_x": ends[:, 0],
            "rest_y": ends[:, 1],
            "latent": None,
        }
    )
    info = {"red": ObjectInfo(shape="cylinder", size_m=(0.07, 0.02), mass_kg=0.1, mass_sd_kg=0.001)}
    joints = pd.DataFrame({"hit": np.repeat(np.arange(count), 2), "t": [0.0, 0.1] * count, "q0": 0.0})
    return Recording("rig", info, 50.0, "here", True, None, "", None, hits, None, joints, None)


def test_held_out_hits_are_a_recording_of_their_own(findings, tmp_path):
    write_recording(recording(np.ones((5, 2)), np.arange(5)), tmp_path / "whole")
    config = {"recordings": {"own": {"path": str(tmp_path / "whole")}}}
    held_out.produce(Run(config, {"findings": findings}, tmp_path, 1))
    found = read_recording(tmp_path / "recording")
    assert found.hits["hit"].tolist() == [1, 3]
    assert sorted(set(found.commands["hit"])) == [1, 3]


def test_the_noise_floor_is_the_mean_distance_of_a_gaussian():
    """Isotropic scatter of sd s about a rest point d away: the mean distance is s sqrt(pi / 2)."""
    rng = np.random.default_rng(0)
    sd, repeats, commands = 0.05, 6, 400
    ends = np.repeat([[1.0, 0.0]], repeats * commands, axis=0) + rng.normal(0, sd, (repeats * commands, 2))
    floor, count = noise_floor(recording(ends, np.repeat(np.arange(commands), repeats)))
    assert count == repeats * commands
    # Standard error: Rayleigh's sd over the mean is 0.52; five groups in six are free.
    error = 0.52 / np.sqrt(count * 5 / 6)
    assert floor == pytest.approx(sd * np.sqrt(np.pi / 2), rel=4 * error)
    assert np.isnan(noise_floor(recording(ends[:4], np.arange(4)))[0])


def test_the_share_that_effects_remove_is_exact_where_nothing_scatters():
    table = pd.DataFrame(
        [
            {"rig": 0, "object": "red", "repeat": r, "samples": 4, "model": m}
            for r in range(3)
            for m in range(2)
        ]
    )
    errors = {arm: table.assign(error_m=e) for arm, e in zip(ARMS, (0.5, 0.3, 0.2), strict=True)}
    assert {arm: e.shape for arm, e in errors_by_arm(errors, 4).items()} == dict.fromkeys(ARMS, (3, 2))
    found = measures_of(errors, 0.1, "all", np.random.default_rng(0))
    assert [m.value for m in found] == pytest.approx([0.5, 0.3, 0.2, 0.5])
    assert [m.low for m in found] == pytest.approx([m.high for m in found])
