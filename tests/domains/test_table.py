"""The table: a box that slides as v^2 / (2 mu g) says, and a disc that stands for its footprint."""

from typing import Any

import mujoco
import numpy as np
import pytest
from slapshot.domains.table.model import disc_radius
from slapshot.domains.table.settings import TableScene
from slapshot.errors import InputError
from slapshot.scenes.domain import load_domain, scene_settings
from slapshot.scenes.scene import Scene, set_condition
from slapshot.validation import validated
from told import scripted_hits

G = 9.81
SETTINGS: dict[str, Any] = {
    "domain": "table",
    "size_m": [0.26, 0.20, 0.15],
    "mass_kg": 0.4,
    "timestep_s": 0.001,
    "start_m": [0.5, 0.1],
    "table_m": [2.0, 1.5],
}


@pytest.fixture(scope="module")
def table() -> Scene:
    return load_domain("table").build_scene(validated(TableScene, SETTINGS, "scene"))


def slide(
    scene: Scene, velocity: tuple[float, float], spin: float, mu_x: float, mu_y: float, mu_t: float
) -> np.ndarray:
    """(3,) displacement x, y (m) and turn (rad) until rest of a box pushed off on the table."""
    model, layout = scene.compile(), scene.layout
    friction = {"friction_x": mu_x, "friction_y": mu_y, "friction_torsional": mu_t, "friction_rolling": 0.0}
    set_condition(model, layout, {"mass": 0.4, **friction})
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 200)
    place = layout.object_q[[0, 1, 3]]
    begin = data.qpos[place].copy()
    data.qvel[layout.object_v[[0, 1, 3]]] = (*velocity, spin)
    mujoco.mj_step(model, data, 1500)
    assert np.abs(data.qvel[layout.object_v]).max() < 1e-3
    return data.qpos[place] - begin


@pytest.mark.parametrize("axis", [0, 1])
def test_the_box_stops_where_coulomb_says_along_both_axes(table: Scene, axis: int) -> None:
    speed, mu = 1.2, (0.2, 0.28)
    velocity = (speed, 0.0) if axis == 0 else (0.0, speed)
    moved = slide(table, velocity, 0.0, *mu, 0.005)
    expected = speed**2 / (2 * mu[axis] * G)
    assert moved[axis] == pytest.approx(expected, rel=0.01)
    assert abs(moved[1 - axis]) < 1e-3 * expected


def test_a_spinning_box_is_stopped_by_its_four_corners(table: Scene) -> None:
    # The contact points are the corners, R from the middle, each on the elliptic cone: the torque is
    # m g sqrt(R^2 mu^2 + mu_t^2) on the inertia m (a^2 + b^2) / 12.
    mu, mu_t, spin = 0.25, 0.02, 8.0
    a, b, _ = SETTINGS["size_m"]
    corner = np.hypot(a, b) / 2
    deceleration = G * np.hypot(corner * mu, mu_t) / ((a**2 + b**2) / 12)
    turned = slide(table, (0.0, 0.0), spin, mu, mu, mu_t)[2]
    assert turned == pytest.approx(spin**2 / (2 * deceleration), rel=0.02)


def test_the_box_has_the_inertia_of_the_disc_that_stands_for_it(table: Scene) -> None:
    model = table.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    turn = np.zeros(model.nv)
    turn[table.layout.object_v[3]] = 1.0
    momentum = np.zeros(model.nv)
    mujoco.mj_mulM(model, data, momentum, turn)
    assert momentum @ turn == pytest.approx(0.4 * table.info.object_radius**2 / 2)


@pytest.mark.parametrize(("ratio", "within"), [(1.0, 0.01), (2.0, 0.03)])
def test_the_disc_holds_a_turn_as_well_as_the_rectangle(ratio: float, within: float) -> None:
    # Under even pressure the torque is mu m g times the mean distance from the middle, 2 r / 3 for a disc.
    middles = (np.arange(400) + 0.5) / 400 - 0.5
    distance = np.hypot(*np.meshgrid(middles * ratio, middles)).mean()
    assert 2 / 3 * disc_radius(ratio, 1.0) == pytest.approx(distance, rel=within)


def test_the_scene_survives_saving_and_has_one_contact(table: Scene, tmp_path: Any) -> None:
    table.save(tmp_path)
    assert Scene.load(tmp_path) == table
    model = table.compile()
    assert model.npair == 1
    assert not model.geom_contype.any()
    assert not model.geom_conaffinity.any()


def test_a_domain_without_an_arm_says_so_when_asked_to_demonstrate(table: Scene) -> None:
    domain = load_domain("table")
    with pytest.raises(InputError, match="no arm"):
        domain.draw_task(scripted_hits(), np.random.default_rng(0))
    with pytest.raises(InputError, match="no arm"):
        domain.demonstrate(table, scripted_hits(), [])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"size_m": [0.2, 0.1]}, r"size_m: \[0.2, 0.1\] has 2 values; write 3"),
        ({"size_m": [0.2, 0.0, 0.1]}, "size_m.1: 0.0 is out of range; it must be >= 0.001"),
        ({"mass_kg": float("nan")}, "mass_kg: nan is not a finite number"),
        ({"mass_kg": 0.001}, "lighter than air"),
        ({"mass_kg": 400.0}, "denser than any metal"),
        ({"table_m": [-2.0, 1.5]}, "table_m.0: -2.0 is out of range"),
        ({"timestep_s": 0.0003}, "timestep_s: 0.0003 does not divide"),
    ],
)
def test_a_box_that_cannot_be_is_refused(change: dict[str, Any], words: str) -> None:
    model = scene_settings(load_domain("table"))
    validated(model, SETTINGS, "scene")
    with pytest.raises(InputError, match=words):
        validated(model, SETTINGS | change, "scene")
