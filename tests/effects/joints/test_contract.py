"""What holds for every effect on joints and bodies, on every bench."""

import re
from collections import Counter

import mujoco
import numpy as np
from slapshot.diagnosis.model.hypothesis import Hypothesis
from slapshot.effects.joints.catalogue import instances, joint_effects
from slapshot.effects.joints.effect import JointEffect, overrides
from slapshot.effects.joints.external_pulse import ExternalPulse, Pulse

from .rigs import Motion, arm, few, has_note, one_sd, start

_BASE = r"(kg|m|s|rad|N)(\^\d)?"
_PRODUCT = rf"{_BASE}( {_BASE})*"
_UNIT = re.compile(rf"(1|{_PRODUCT})(/({_BASE}|\({_PRODUCT}\)))?")
# Of what flies freely, neither the motion nor the reading of a place tells the mass.
_SILENT = {("ball", "link_mass")}
# Nor do a zero that is off about the upright axis, or of a slide that carries nothing else.
_STILL = {"joint_offset@a0 (of the geometry)", "joint_offset@mast (of the geometry)"}

# Have no instance before data were searched.
FOUND_IN_DATA = {"external_pulse"}


def saved(model: mujoco.MjModel) -> bytes:
    buffer = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()


def test_every_effect_sits_somewhere_and_keys_are_unique(any_bench):
    keys = Counter(effect.key for effect in any_bench.effects)
    assert max(keys.values()) == 1, keys.most_common(3)
    names = {effect.name for effect in any_bench.effects}
    flies = {"buoyancy", "linear_drag", "quadratic_drag", "spin_lift", "wind"}
    if any_bench.rig_motion.free_bodies:
        assert names >= flies | {"gravity_tilt", "link_mass"}
    else:
        # A load on what only slides makes it heavier, and that is its mass.
        unlike = flies | FOUND_IN_DATA | ({"payload"} if 2 in any_bench.rig.model.body_simple else set())
        assert names == {name for name in joint_effects() if name not in unlike}
    assert [e.key for e in instances(any_bench.rig_motion)] == list(keys)


def test_they_describe_themselves(any_bench):
    for effect in any_bench.effects:
        text = effect.phrase.format(part=effect.part)
        assert "{" not in text
        assert "slapshot" not in f"{text}{effect.key}"
        assert "  " not in f"{text} "
        assert effect.physics.strip()
        assert re.search(r"\d{4}\)|\(\d{4}\b", effect.source), effect.source
        assert not effect.variant or effect.variant in effect.key
        says = any(overrides(effect, place) for place in ("control", "force", "observe"))
        if says:
            assert overrides(effect, "note"), f"{effect.key} does not say how to add it to a simulation"
        note = effect.note(one_sd(effect))
        assert bool(note) == has_note(effect)
        assert not note or note.endswith("."), note


def test_a_push_says_when_and_how_much():
    joint = arm().rig_motion.joints[0]
    pulses = [Pulse(3, 0.5, 0.25, 0.5), Pulse(4, 0.0, 1.0, 1.125)]
    assert ExternalPulse(joint, pulses).note(np.array([1.5, -2.0])) == (
        "Apply as qfrc_applied at joint shoulder: 1.5 from 0.25 to 0.5 s of episode 3; -2 from 1 to 1.125 s "
        "of episode 4 (in N m; position q in rad, velocity v in rad/s)."
    )
    push = ExternalPulse(joint, [Pulse(3, 0.5, 0.25, 0.5, knots=3), pulses[1]])
    assert [p.name for p in push.parameters] == [
        "push_0 at 0.25 s", "push_0 at 0.38 s", "push_0 at 0.50 s", "push_1",
    ]  # fmt: skip
    assert push.note(np.array([0.0, 1.5, 0.5, -2.0])) == (
        "Apply as qfrc_applied at joint shoulder: 0, 1.5, 0.5 from 0.25 to 0.5 s of episode 3, linear "
        "between evenly spaced times; -2 from 1 to 1.125 s of episode 4 (in N m; position q in rad, velocity "
        "v in rad/s)."
    )


def test_parameters_hold_together(any_bench):
    for effect in any_bench.effects:
        assert len({p.name for p in effect.parameters}) == len(effect.parameters) > 0
        for p in effect.parameters:
            assert _UNIT.fullmatch(p.unit), p
            assert np.isfinite([p.scale, p.start, p.probe]).all(), (effect.key, p)
            assert p.low <= p.start <= p.high, (effect.key, p)
            assert 0 < p.scale < p.high - p.low, (effect.key, p)
            # A look is taken where the effect is possible, and not far from where its size is likely.
            assert p.low <= p.start + p.probe <= p.high, (effect.key, p)
            assert 0 <= p.probe <= p.scale, (effect.key, p)
        perturbations = effect.probe_values
        # What has a state of its own, or is found by a search, has no column.
        assert perturbations or effect.hidden_state, effect.key
        for values in perturbations:
            changed = [i for i, p in enumerate(effect.parameters) if values[i] != p.start]
            assert len(changed) == 1, (effect.key, values)
            assert all(p.low <= v <= p.high for p, v in zip(effect.parameters, values, strict=True))


def test_at_the_start_of_its_values_nothing_is_changed(any_bench):
    nominal = any_bench.nominal
    # Constants that are computed anew differ in the last digit, which a motion may amplify.
    for effect in few(any_bench):
        neutral = any_bench.moved(effect, *start(effect))
        for a, b in ((neutral.x, nominal.x), (neutral.y, nominal.y)):
            assert np.abs(a - b).max() < 1e-9, effect.key


def test_a_plain_case_changes_the_motion_or_what_is_seen_of_it_and_nothing_else(any_bench, request):
    name = request.node.callspec.params["any_bench"]
    nominal, before = any_bench.nominal, saved(any_bench.rig.model)
    control = any_bench.segments.control().copy()
    for effect in few(any_bench):
        values = one_sd(effect)
        motion, again = any_bench.moved(effect, *values), any_bench.moved(effect, *values)
        assert np.array_equal(motion.y, again.y), effect.key
        assert np.array_equal(motion.x, again.x), effect.key
        assert saved(any_bench.rig.model) == before, effect.key
        check_change(effect, motion, nominal, (name, effect.name) in _SILENT or effect.key in _STILL)
        assert np.array_equal(any_bench.segments.control(), control)
        assert np.array_equal(values, one_sd(effect))


def check_change(effect: JointEffect, motion: Motion, nominal: Motion, silent: bool) -> None:
    for a in (motion.x, motion.y):
        assert np.isfinite(a).all(), effect.key
    spread = np.abs(nominal.x).max()
    assert np.abs(motion.x).max() < 20 * spread, effect.key
    changed = max(np.abs(motion.x - nominal.x).max(), np.abs(motion.y - nominal.y).max())
    assert (changed > 1e-6) != silent, (effect.key, changed)
    moves = any(overrides(effect, place) for place in ("edit", "control", "force"))
    if not moves:
        assert np.array_equal(motion.x, nominal.x), effect.key


def test_one_of_each_can_act_at_once(any_bench):
    """As no effect knows of another, they must bear one another in any order."""
    one_of_each = tuple({effect.name: effect for effect in reversed(few(any_bench))}.values())
    for effects in (one_of_each, one_of_each[::-1]):
        theta = np.concatenate([0.9 * start(e) + 0.1 * one_sd(e) for e in effects])
        model = Hypothesis(any_bench.rig, effects).compiled(theta, any_bench.segments.step)
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, 50)
        assert np.isfinite(data.qpos).all()
