"""Concealed faults of the camera against their geometry."""

import numpy as np
import pytest
from slapshot.lab.camera import foot_of

PLACES = np.random.default_rng(0).uniform([0.0, -1.0], [2.5, 1.0], (50, 2))


def see(rig, places=PLACES, place=0.5):
    track = np.column_stack([np.arange(len(places)) * 0.01, places, np.zeros(len(places))])
    return rig.seen(track, place)


def distances(places):
    return np.linalg.norm(places[1:] - places[:-1], axis=1)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_scale_stretches_all_distances_and_leaves_a_point(conceal, sign):
    rig = conceal("camera_scale", 0.04, sign=sign, about_m=[1.5, 0.1])
    seen = see(rig)
    assert distances(seen[:, 1:]) == pytest.approx(np.exp(sign * 0.04) * distances(PLACES))
    assert see(rig, np.array([[1.5, 0.1]]))[0, 1:] == pytest.approx([1.5, 0.1])


def test_a_rotation_keeps_distances_and_turns_directions(conceal):
    rig = conceal("camera_rotation", 0.05, sign=-1.0, about_m=[1.5, 0.1])
    seen = see(rig)[:, 1:]
    assert distances(seen) == pytest.approx(distances(PLACES))
    before, after = PLACES - (1.5, 0.1), seen - (1.5, 0.1)
    turned = np.arctan2(*after.T[::-1]) - np.arctan2(*before.T[::-1])
    assert np.angle(np.exp(1j * turned)) == pytest.approx(np.full(50, -0.05))


def test_a_late_clock_reports_what_was(conceal):
    rig = conceal("camera_time", 0.02, drift_share=0.2)
    moving = np.column_stack([np.arange(100) * 0.01, np.zeros(100)])  # 1 m/s
    for place, delay in ((0.0, 0.018), (0.5, 0.02), (1.0, 0.022)):
        seen = see(rig, moving, place)
        assert np.interp(0.5, seen[:, 0], seen[:, 1]) == pytest.approx(0.5 - delay)


def test_a_lens_stretches_along_the_radius(conceal):
    k1, share, about = -0.02, 0.1, np.array([1.5, 0.1])
    rig = conceal("lens_distortion", 0.02, sign=-1.0, k2_share_per_m2=share, about_m=about.tolist())
    radius = np.linalg.norm(PLACES - about, axis=1)
    after = see(rig)[:, 1:] - about
    expected = radius * (1 + k1 * radius**2 + k1 * share * radius**4)
    assert np.linalg.norm(after, axis=1) == pytest.approx(expected)
    assert after / expected[:, None] == pytest.approx((PLACES - about) / radius[:, None])


def test_the_foot_is_where_the_ceiling_camera_looks(lab_scene, plain_rig):
    model = lab_scene.compile()
    assert foot_of(lab_scene, plain_rig.camera) == pytest.approx(
        model.cam_pos[model.camera("ceiling").id, :2]
    )
