"""The level of a joint's dry friction is in one effect, and the motion is the same as by all of them."""

import copy
from dataclasses import replace

import numpy as np
import pytest
from slapshot.diagnosis.model.hypothesis import Hypothesis, Simulator
from slapshot.diagnosis.selection.dry_friction import with_one_level
from slapshot.effects.joints.coulomb_friction import CoulombFriction
from slapshot.effects.joints.direction_friction import DirectionFriction
from slapshot.effects.joints.effect import JointEffect
from slapshot.effects.joints.stribeck_friction import StribeckFriction
from slapshot.effects.joints.torque_offset import TorqueOffset
from slapshot.effects.joints.viscous_friction import ViscousFriction

from .test_linear import arm_situation, random_path

VALUES = {
    CoulombFriction: [0.3],
    DirectionFriction: [0.2, 0.1],
    StribeckFriction: [0.25, 0.15, 0.4],
    ViscousFriction: [0.05],
    TorqueOffset: [-0.05],
}
BESIDE = {  # what is merged -> the values left of each
    (CoulombFriction, DirectionFriction): {"direction_friction": [0.5, 0.4]},
    (StribeckFriction, CoulombFriction): {"stribeck_friction": [0.55, 0.15, 0.4]},
    (ViscousFriction, StribeckFriction, DirectionFriction): {
        "viscous_friction": [0.05],
        "stribeck_friction": [0.15, 0.4],
        "direction_friction": [0.45, 0.35],
    },
    (CoulombFriction, StribeckFriction, DirectionFriction): {
        "stribeck_friction": [0.15, 0.4],
        "direction_friction": [0.75, 0.65],
    },
    (CoulombFriction, TorqueOffset): {"direction_friction": [0.35, 0.25]},
    (DirectionFriction, TorqueOffset): {"direction_friction": [0.25, 0.05]},
    (TorqueOffset, StribeckFriction): {
        "direction_friction": [0.3, 0.2],
        "stribeck_friction": [0.15, 0.4],
    },
}


@pytest.mark.parametrize(("kinds", "left"), BESIDE.items())
def test_several_levels_are_one_and_nothing_moves_otherwise(kinds, left):
    rig, segments, of, _ = arm_situation(100, 0.005)
    elbow = [next(e for e in kind.instances(of) if e.part == "elbow") for kind in kinds]
    hypothesis, theta = Hypothesis(rig, tuple(elbow)), np.concatenate([VALUES[kind] for kind in kinds])
    merged, values = with_one_level(hypothesis, theta)
    found = {e.name: list(values[own]) for e, own in zip(merged.effects, merged.slices, strict=True)}
    assert found.keys() == left.keys()
    for name, expected in left.items():
        assert found[name] == pytest.approx(expected)
    assert {effect.key for effect in merged.effects} <= {
        *(effect.key for effect in elbow),
        "direction_friction@elbow",
    }
    n, simulator = segments.time.size, Simulator(rig)
    x = random_path(rig, segments, 4, size=0.2).reshape(n, -1)
    u = segments.control().reshape(n, segments.substeps, -1)
    ends = [
        simulator.advance(h, v, h.compiled(v, segments.step), x, u, segments.time.reshape(n), np.zeros(n))[0]
        for h, v in ((hypothesis, theta), (merged, values))
    ]
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-9)
    assert with_one_level(merged, values)[0] is merged


@pytest.mark.parametrize("torque", [0.31, -0.31])
def test_a_constant_torque_above_dry_friction_is_no_friction(torque):
    rig, _, of, _ = arm_situation(100, 0.005)
    kinds = CoulombFriction, TorqueOffset
    both = Hypothesis(rig, tuple(next(e for e in k.instances(of) if e.part == "elbow") for k in kinds))
    theta = np.array([0.3, torque])
    assert with_one_level(both, theta) == (both, theta)
    smaller = with_one_level(both, np.array([0.3, 0.9 * torque]))[0]
    assert [effect.key for effect in smaller.effects] == ["direction_friction@elbow"]


def test_whether_a_constant_torque_is_friction_is_a_matter_of_all_that_rubs():
    rig, _, of, _ = arm_situation(100, 0.005)
    direction, coulomb, offset = (
        next(e for e in kind.instances(of) if e.part == "elbow")
        for kind in (DirectionFriction, CoulombFriction, TorqueOffset)
    )
    both = Hypothesis(rig, (direction, offset))
    for torque, merged in ((0.3, [0.2, 0.4]), (0.6, None), (-0.2, None)):
        found, values = with_one_level(both, np.array([0.5, 0.1, torque]))
        assert (found is both) == (merged is None)
        assert merged is None or values == pytest.approx(merged)
    # Friction of the rig itself counts, too.
    rubs = copy.copy(rig.model)
    rubs.dof_frictionloss[:] = 1.0
    weaker = Hypothesis(replace(rig, model=rubs), (coulomb, offset))
    found, values = with_one_level(weaker, np.array([-0.2, 0.3]))
    assert [effect.key for effect in found.effects] == ["direction_friction@elbow"]
    assert values == pytest.approx([-0.5, 0.1])


def test_what_lies_in_different_joints_or_was_free_before_stays():
    rig, _, of, _ = arm_situation(100, 0.005)

    def at(kind: type[JointEffect], part: str) -> JointEffect:
        return next(effect for effect in kind.instances(of) if effect.part == part)

    apart = Hypothesis(rig, (at(CoulombFriction, "shoulder"), at(DirectionFriction, "elbow")))
    assert with_one_level(apart, np.array([0.3, 0.2, 0.1]))[0] is apart
    both = (at(CoulombFriction, "elbow"), at(DirectionFriction, "elbow"))
    for free in ("coulomb_friction", "coulomb_friction@elbow"):
        given = Hypothesis(replace(rig, free=(free,)), both)
        assert with_one_level(given, np.array([0.3, 0.2, 0.1]))[0] is given
