"""What holds for every kind that joints can conceal."""

import json

import numpy as np
import pytest
from slapshot.lab.joints.noise import NOISE_SD, read_clean
from slapshot.lab.joints.registry import HIDDEN_EFFECTS
from slapshot.lab.joints.rig import draw_excitation
from slapshot.lab.joints.rig_simulator import RigSimulator
from slapshot.lab.joints.rigs import RIGS, rig_named

from .conftest import EPISODES, SECONDS, short

ASKED = 3.0
UNCATALOGUED = {
    "slack_cable", "slipping_base", "magnet", "foldback", "intermittent_contact", "sticky_sensor"
}  # fmt: skip
# Motors that are told a torque show friction best, servos all that lies before them.
RIG_OF = {name: "arm" if i % 2 else "pendulum" for i, name in enumerate(HIDDEN_EFFECTS)}


def test_names_and_what_is_catalogued():
    assert {name for name, effect in HIDDEN_EFFECTS.items() if not effect.catalogued} == UNCATALOGUED
    for name, effect in HIDDEN_EFFECTS.items():
        assert effect.name == name
        assert any(effect.fits(rig_named(rig)) for rig in RIGS)


@pytest.mark.parametrize("name", HIDDEN_EFFECTS)
def test_every_kind_changes_the_motion_by_what_is_asked(size_calibrations, name):
    check_size(size_calibrations, name, RIG_OF[name])


def test_kinds_that_need_no_actuator_do_so_for_a_robot_that_is_dragged(size_calibrations):
    fitting = [name for name, effect in HIDDEN_EFFECTS.items() if effect.fits(rig_named("fetchslide_arm"))]
    assert len(fitting) == 19
    for name in fitting:
        check_size(size_calibrations, name, "fetchslide_arm")


def check_size(size_calibrations, name, of):
    size_calibration, effect, rig = size_calibrations[of], HIDDEN_EFFECTS[name], short(of)
    found = size_calibration.find(effect, ASKED, np.random.default_rng(1))
    assert not found.bounded
    truth = json.loads(json.dumps(found.truth()))
    assert truth["kind"] == name
    assert truth["parameters"]
    assert truth["joint"] in (None, *rig.joints)
    assert truth["body"] in (None, *rig.links, rig.base, rig.tip[0])
    # Simulated anew, from the seed on, and measured without the rehearsal.
    excitation = draw_excitation(rig, EPISODES, SECONDS, np.random.default_rng(7))
    motion = RigSimulator(rig, [found]).execute(excitation)
    clean = read_clean(rig, motion, [found])
    assert np.isfinite(clean).all()
    moved = np.sqrt(((clean - size_calibration.nominal.positions) ** 2).mean((0, 1)))
    assert moved.max() / NOISE_SD == pytest.approx(ASKED, rel=0.2)
    assert moved.max() / NOISE_SD == pytest.approx(found.size, rel=1e-9)


@pytest.mark.parametrize("name", HIDDEN_EFFECTS)
def test_shapes_are_drawn_of_the_seed_and_differ(size_calibrations, name):
    effect, nominal = HIDDEN_EFFECTS[name], size_calibrations[RIG_OF[name]].nominal
    drawn = [effect.draw(nominal, np.random.default_rng(seed)) for seed in (3, 3, *range(4, 12))]
    assert drawn[0] == drawn[1]
    assert any(other != drawn[0] for other in drawn[2:])
    bounds = effect.bounds(nominal, drawn[0])
    assert 0 <= bounds.minimum <= bounds.typical <= bounds.maximum


def test_what_cannot_be_as_large_as_is_asked_is_bounded(size_calibrations):
    effect = HIDDEN_EFFECTS["saturation"]
    found = size_calibrations["pendulum"].find(effect, 1e6, np.random.default_rng(0))
    assert found.bounded
    assert found.size < 1e6
