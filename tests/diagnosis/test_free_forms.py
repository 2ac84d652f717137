"""Free forms: what sums of bumps can be, and what they are called."""

import mujoco
import numpy as np
import pytest
from slapshot.diagnosis.model.segments import Segments
from slapshot.diagnosis.selection.free_forms import BUMPS, FREE, FreeForce, FreeReading, free_forms, is_free
from slapshot.effects.joints.catalogue import instances
from slapshot.effects.joints.effect import Joint, JointEffect, Observed, RigMotion, SensedChannel, State

SPAN = np.linspace(-2.0, 3.0, 400)


def joint(unit: str = "N m", **more: object) -> Joint:
    values = {
        "name": "swing", "q": 0, "v": 0, "unit": unit, "actuators": (0,), "torque": 2.0, "largest": (5.0,),
        "speed": 3.0, "travel": 0.5, "middle": 0.25, "inertia": 0.3,
    }  # fmt: skip
    return Joint(**(values | more))  # type: ignore[arg-type]


def segments() -> Segments:
    y = np.zeros((2, 10, 1))
    time = np.tile(np.arange(10) * 0.1, (2, 1))
    whole = np.array([0, 1])
    return Segments(
        0.1, 1, y, y, y, y[..., 0] == 0, time, whole, 0 * whole, whole - 0.5, (), whole, np.zeros(1)
    )


def rig(of: Joint, episodes: int) -> RigMotion:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><joint name='a'/><geom size='1'/></body></worldbody>"
        "<actuator><motor joint='a'/></actuator></mujoco>"
    )
    sensed = (
        SensedChannel(0, "angle", "position", of.name, "main"),
        SensedChannel(1, "rate", "velocity", of.name, "main"),
    )
    return RigMotion(model, (of,), (), sensed, 0.1, episodes)


def state(at: np.ndarray) -> State:
    """Every variable has values of its own, so that none is taken for another."""
    n = len(at)
    return State(at[:, None], 2 * at[:, None], 3 * at[:, None], 4 * at, np.full(n, 0.2) + 0 * at)


@pytest.mark.parametrize("law", [np.sin, np.tanh, lambda x: x**2 / 4, lambda x: 0 * x + 1])
def test_bumps_reproduce_what_is_smooth(law):
    """A sine of nearly a whole period, with as many bumps as that asks for, to a few per cent."""
    form = FreeForce(joint(), "position", -2.0, 3.0)
    basis = form.basis(SPAN)
    assert basis.shape == (len(SPAN), BUMPS)
    wanted = law(SPAN)
    weights, *_ = np.linalg.lstsq(basis, wanted, rcond=None)
    force = form.force(state(SPAN), weights)
    assert force.shape == (len(SPAN), 1)
    assert np.sqrt(np.mean((force[:, 0] - wanted) ** 2)) < 0.05 * np.sqrt(np.mean(wanted**2))


def test_beyond_its_range_a_form_is_as_at_the_end():
    form = FreeForce(joint(), "position", -2.0, 3.0)
    np.testing.assert_array_equal(form.basis(np.array([-9.0, 9.0])), form.basis(np.array([-2.0, 3.0])))


@pytest.mark.parametrize(("variable", "factor"), [("position", 1), ("velocity", 2), ("load", 3), ("time", 4)])
def test_a_form_follows_its_variable(variable: str, factor: int):
    form = FreeForce(joint(), variable, -2.0, 3.0)
    weights = np.arange(BUMPS, dtype=float)
    found = form.force(state(SPAN), weights)[:, 0]
    np.testing.assert_allclose(found, form.basis(factor * SPAN) @ weights)


@pytest.mark.parametrize(("unit", "angle"), [("N m", "rad"), ("N", "m")])
def test_names_and_units(unit: str, angle: str):
    forms = list(free_forms(rig(joint(unit), 4), segments()))
    assert {form.key for form in forms} == {
        *(f"free_force@swing (over {v})" for v in ("position", "velocity", "load", "time", "session")),
        *(f"free_reading@swing (over {v})" for v in ("position", "velocity", "session")),
    }
    for form in forms:
        assert form.name.startswith(FREE)
        assert is_free(form)
        assert len(form.probe_values) == BUMPS
        assert {p.unit for p in form.parameters} == {unit if isinstance(form, FreeForce) else angle}
        assert all(p.start == 0 and p.scale > p.probe > 0 for p in form.parameters)
    assert not any(map(is_free, _named(rig(joint(unit), 4))))


def _named(of: RigMotion) -> list[JointEffect]:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint name="swing"/><geom size="0.1"/></body></worldbody>'
        '<actuator><motor joint="swing"/></actuator></mujoco>'
    )
    return list(instances(RigMotion(model, of.joints, (), of.sensed, of.interval, of.episodes)))


def test_what_cannot_be_told_is_left_out():
    """Drifts need episodes to be told apart; a load needs a motor."""
    few = {form.key for form in free_forms(rig(joint(largest=(), actuators=()), 3), segments())}
    assert few == {
        "free_force@swing (over position)",
        "free_force@swing (over velocity)",
        "free_reading@swing (over position)",
        "free_reading@swing (over velocity)",
    }


def test_a_reading_changes_its_own_columns_alone():
    form = FreeReading(joint(), [0], "position", -2.0, 3.0)
    y = np.stack([SPAN, SPAN + 1], axis=1)
    weights = 0.01 * np.arange(BUMPS)
    added = form.observe(Observed(y, 0 * y, 0 * y, np.full(len(y), 0.2)), weights)
    expected = FreeForce(joint(), "position", -2.0, 3.0).basis(SPAN) @ weights
    np.testing.assert_allclose(added, np.stack([expected, 0 * SPAN], axis=1))
    by_speed = FreeReading(joint(), [0], "velocity", -4.0, 6.0)
    added = by_speed.observe(Observed(0 * y, 2 * y, 0 * y, np.full(len(y), 0.2)), weights)
    np.testing.assert_allclose(
        added[:, 0], FreeForce(joint(), "velocity", -4.0, 6.0).basis(2 * SPAN) @ weights
    )
    over = FreeReading(joint(), [0], "session", -0.5, 0.5)
    assert np.ptp(over.observe(Observed(y, 0 * y, 0 * y, np.full(len(y), 0.2)), weights)[:, 0]) == 0
