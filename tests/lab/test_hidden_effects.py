"""What holds for every concealed kind: names, streams, sizes, and what a recording of it may tell."""

import json
from dataclasses import replace
from typing import get_args

import numpy as np
import pandas as pd
import pytest
from slapshot.config.lab import ConcealedEffect, ConcealedKind
from slapshot.effects.catalogue import catalogue
from slapshot.errors import InputError
from slapshot.lab.hidden_effects.draw import draw_concealed
from slapshot.lab.hidden_effects.effect_size_calibration import EffectSizeCalibration
from slapshot.lab.hidden_effects.hidden_effect import Concealed
from slapshot.lab.hidden_effects.registry import HIDDEN_EFFECTS
from slapshot.lab.hit import RigSimulator
from slapshot.lab.hit_types import HitNoise, HitSpec
from slapshot.lab.rig import Scatter
from slapshot.recordings.read import read_recording

UNCATALOGUED = {"attracting_spot", "tether", "pulsing_fan", "curved_blade", "crooked_arm"}
# Whatever its size, it hardly moves what the camera sees: hits are square.
FAINT = {"blade_friction"}
SMALL = {"hits": 2, "repeats": {"commands": 0, "times": 0}, "blade": None, "friction_field": None}
TABLES = ("hits", "tracks", "commands", "joints")
ASKED = 0.25  # of the scatter; some kinds cannot do much more with hits straight ahead
NOTHING = HitNoise(np.zeros(2), 1.0, np.zeros(7), 1.0)


def truth_of(folder):
    return json.loads((folder / "truth" / "truth.json").read_text())


def same(one, other):
    for name in TABLES:
        pd.testing.assert_frame_equal(getattr(one, name), getattr(other, name), check_exact=True)


@pytest.fixture(scope="module")
def size_calibration(lab_scene, plain_rig, motions):
    scatter = Scatter(0.015, 0.025, (0.012, 0.002, 0.012, 0.002, 0.012, 0.002, 0.02), 0.03)
    strokes = [HitSpec(motions[i], "puck", NOTHING, float(i)) for i in range(2)]
    return EffectSizeCalibration(
        lab_scene, replace(plain_rig, scatter=scatter), strokes, np.random.default_rng(0), cores=2
    )


@pytest.fixture(scope="module")
def null_hit(lab_scene, plain_rig, motions):
    return RigSimulator(lab_scene, plain_rig).hit(motions[0], "puck", NOTHING)


def test_every_effect_of_the_catalogue_has_a_counterpart_that_means_the_same(size_calibration):
    effects = catalogue()
    assert set(HIDDEN_EFFECTS) == set(effects) | UNCATALOGUED
    for name, effect in HIDDEN_EFFECTS.items():
        assert effect.name == name
        assert effect.catalogued == (name in effects)
        shape = effect.draw(size_calibration.nominal, np.random.default_rng(0))
        named = effect.parameters(effect.typical_amplitude, shape)
        assert (effect.parameter_match is None) == (not named)
        if name in effects:
            assert effect.phase == effects[name].phase
            known = {parameter.name: parameter for parameter in effects[name].parameters}
            for parameter, value in named.items():
                assert known[parameter].low <= value <= known[parameter].high


def test_the_schema_knows_the_kinds():
    assert list(get_args(ConcealedKind)) == list(HIDDEN_EFFECTS)


@pytest.mark.parametrize("name", HIDDEN_EFFECTS)
def test_little_of_a_kind_is_little_else(lab_scene, conceal, motions, null_hit, name):
    # What contact makes of any change, however small, is 3 mm: the object hops from other places. Another
    # step of integration, and another algorithm for a cylinder than for a box, are such changes.
    effect = HIDDEN_EFFECTS[name]
    rig = conceal(name, max(effect.min_amplitude, 1e-3 * effect.typical_amplitude))
    assert json.dumps(rig.concealed[0].truth())
    hit = RigSimulator(lab_scene, rig).hit(motions[0], "puck", NOTHING)
    seen = rig.seen(hit.track, 0.5)
    far = 0.01 if effect.changes_launch else 1e-3
    assert np.linalg.norm(seen[-1, 1:] - null_hit.rest[:2]) < far
    assert np.all(np.isfinite(seen))


@pytest.mark.parametrize("name", HIDDEN_EFFECTS)
def test_every_kind_shifts_what_happens_by_what_is_asked(size_calibration, name):
    effect = HIDDEN_EFFECTS[name]
    shape = effect.draw(size_calibration.nominal, np.random.default_rng(1))
    found = size_calibration.find(effect, shape, ASKED)
    assert 0 < found.amplitude <= effect.max_amplitude
    if name in FAINT:
        assert found.bounded
        assert found.amplitude == effect.max_amplitude
        return
    assert not found.bounded
    assert found.displacement == pytest.approx(ASKED, rel=0.15)
    # What was reported is what a whole simulation gives.
    again = size_calibration.displacement(Concealed(effect, found.amplitude, shape))
    assert again == pytest.approx(found.displacement, rel=1e-6)


def test_more_than_is_possible_is_bounded_and_says_so(size_calibration):
    effect = HIDDEN_EFFECTS["camera_time"]
    found = size_calibration.find(
        effect, effect.draw(size_calibration.nominal, np.random.default_rng(1)), 50.0
    )
    assert found.bounded
    assert found.amplitude == effect.max_amplitude
    truth = found.truth()
    assert truth["displacement_asked"] == 50.0
    assert truth["displacement"] < 5.0
    assert truth["displacement_of"] == "track"


def test_a_displacement_needs_scatter(lab_scene, plain_rig, motions):
    strokes = [HitSpec(motions[0], "puck", NOTHING)]
    still = EffectSizeCalibration(lab_scene, plain_rig, strokes, np.random.default_rng(0), 1)
    assert still.scatter == 0.0
    with pytest.raises(InputError, match="needs scatter"):
        still.find(HIDDEN_EFFECTS["tilt"], {}, 1.0)
    entry = ConcealedEffect(kind="camera_scale", amplitude=0.02)
    (scaled,) = draw_concealed([entry], still, np.random.default_rng(0))
    assert scaled.displacement is None


def test_to_take_one_kind_away_leaves_the_others(size_calibration):
    entries = [
        ConcealedEffect(kind="camera_rotation", amplitude=[0.01, 0.05]),
        ConcealedEffect(kind="camera_scale", amplitude=[0.01, 0.05]),
        ConcealedEffect(kind="lens_distortion", displacement=[0.3, 0.6]),
    ]
    whole = draw_concealed(entries, size_calibration, np.random.default_rng(7))
    part = draw_concealed(entries[:0:-1], size_calibration, np.random.default_rng(7))
    assert [c.truth() for c in part] == [c.truth() for c in whole[:0:-1]]
    other = draw_concealed(entries, size_calibration, np.random.default_rng(8))
    assert other[0].shape != whole[0].shape


def test_none_of_everything_is_the_recording_of_the_null_rig(make):
    null, nothing = (
        make("null", **SMALL),
        make("nothing", **SMALL, concealed=[{"kind": name, "amplitude": 0} for name in HIDDEN_EFFECTS]),
    )
    same(*(read_recording(folder / "recording") for folder in (null, nothing)))
    truths = [truth_of(folder) for folder in (null, nothing)]
    assert truths[0]["concealed"] == []
    assert [c["kind"] for c in truths[1]["concealed"]] == list(HIDDEN_EFFECTS)
    assert {c["displacement"] for c in truths[1]["concealed"]} == {0.0}
    for one, other in zip(truths[0]["hits"], truths[1]["hits"], strict=True):
        assert one == {key: value for key, value in other.items() if key != "quirk"}


def test_what_is_concealed_leaves_chance_and_commands_as_they_are(make):
    null = make("null", **SMALL)
    other = make("other", **SMALL, concealed=[{"kind": "camera_scale", "amplitude": 0.05}])
    truths = [truth_of(folder)["hits"] for folder in (null, other)]
    for one, two in zip(*truths, strict=True):
        assert one == {key: value for key, value in two.items() if key != "quirk"}
    recordings = [read_recording(folder / "recording") for folder in (null, other)]
    for name in ("commands", "joints"):
        pd.testing.assert_frame_equal(*(getattr(r, name) for r in recordings), check_exact=True)
    # Noise, lost frames and mistracks included, what differs is the stretch.
    about = np.array(truth_of(other)["concealed"][0]["shape"]["about_m"])
    sign = truth_of(other)["concealed"][0]["shape"]["sign"]
    rests = [r.hits[["rest_x", "rest_y"]].to_numpy() for r in recordings]
    true = np.array([hit["rest"][:2] for hit in truths[0]])
    stretched = rests[0] + (np.exp(sign * 0.05) - 1) * (true - about)
    assert rests[1] == pytest.approx(stretched, abs=1e-9)


def test_a_recording_says_neither_what_is_concealed_nor_the_seed(make):
    seed = 918273645
    entries = [{"kind": "curl", "amplitude": 0.3}, {"kind": "command_delay", "amplitude": 0.01}]
    folder = make("sealed", seed=seed, **SMALL, concealed=entries) / "recording"
    (null,) = [make("null", **SMALL) / "recording"]
    assert sorted(p.name for p in folder.iterdir()) == sorted(p.name for p in null.iterdir())
    words = [name.encode() for name in HIDDEN_EFFECTS] + [str(seed).encode(), b"displacement", b"amplitude"]
    for file in folder.iterdir():
        content = file.read_bytes()
        assert not [word for word in words if word in content], file.name
    headers = [json.loads((f / "recording.json").read_text()) for f in (folder, null)]
    assert {key for key in headers[0] if headers[0][key] != headers[1][key]} == {
        "objects", "sealed_truth_sha256"
    }  # fmt: skip


def test_the_truth_says_what_is_concealed(make):
    entries = [{"kind": "tilt", "displacement": 0.5}, {"kind": "tether", "amplitude": 2.0}]
    truth = truth_of(make("truth", **SMALL, concealed=entries))["concealed"]
    tilt, tether = truth
    assert (tilt["kind"], tilt["phase"], tilt["catalogued"]) == ("tilt", "slide", True)
    assert tilt["displacement"] == pytest.approx(0.5, rel=0.15)
    assert np.hypot(*tilt["parameters"].values()) == pytest.approx(tilt["amplitude"])
    assert (tether["kind"], tether["catalogued"], tether["parameters"]) == ("tether", False, {})
    assert tether["amplitude"] == 2.0
    assert tether["displacement"] > 0
    assert 0.01 < tether["scatter_m"] < 0.3


def test_what_cannot_be_concealed_is_refused(make):
    with pytest.raises(InputError, match=r"not possible; use 0, or 0 to 0\.06"):
        make("late", **SMALL, concealed=[{"kind": "command_delay", "amplitude": 1.0}])
