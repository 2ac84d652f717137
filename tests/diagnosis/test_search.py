"""What a search takes for a candidate, and what it takes back."""

from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from slapshot.diagnosis.diagnose import diagnose
from slapshot.diagnosis.fit.fit import Fit
from slapshot.diagnosis.model.hypothesis import Hypothesis
from slapshot.diagnosis.model.rig import bind
from slapshot.diagnosis.model.segments import segment_recording
from slapshot.diagnosis.selection import search
from slapshot.diagnosis.selection.problem import Problem, is_incredible
from slapshot.diagnosis.selection.search import _forward_search, _forward_step, _much_is_left, _preselect
from slapshot.diagnosis.selection.steps import P_VALUE, Rival, Search, Step, nominal_motion, nominal_step
from slapshot.effects.joints.coulomb_friction import CoulombFriction
from slapshot.effects.joints.direction_friction import DirectionFriction
from slapshot.effects.joints.effect import JointEffect
from slapshot.effects.joints.encoder_delay import EncoderDelay
from slapshot.effects.joints.encoder_scale import EncoderScale
from slapshot.effects.joints.external_pulse import ExternalPulse
from slapshot.effects.joints.joint_offset import JointOffset
from slapshot.effects.joints.payload import Payload
from slapshot.effects.joints.viscous_friction import ViscousFriction

from .mechanisms import PENDULUM, control_channel, joint, recording, simulate
from .test_linear import arm_situation


def test_an_effect_of_no_size_does_nothing_wherever_it_sits():
    rig, _, of, _ = arm_situation(20)

    def has_no_effect(effect: JointEffect, *values: float) -> bool:
        hypothesis = Hypothesis(rig, (next(iter(ViscousFriction.instances(of))), effect))
        theta = np.array([0.3, *values])
        fit = Fit(hypothesis, theta, np.zeros((1, 1, 4)), 0.0, np.eye(len(theta)), True, 0.0)
        return Rival(effect, 70.0, fit).has_no_effect

    payload = next(iter(Payload.instances(of)))
    assert has_no_effect(payload, 0.0, 0.0, 0.0, -0.6)
    assert not has_no_effect(payload, 0.01, 0.0, 0.0, -0.6)
    # Friction that a joint has too much of is less of it: 0 is one of its values.
    friction = next(iter(ViscousFriction.instances(of)))
    assert has_no_effect(friction, 0.0) == (friction.parameters[0].low == 0)
    assert not has_no_effect(friction, 0.1)


def test_a_search_before_an_effect_ends_where_that_was_not_yet_there():
    rig, _, of, _ = arm_situation(20)
    friction, payload = next(iter(ViscousFriction.instances(of))), next(iter(Payload.instances(of)))

    def step(*effects: JointEffect, added: JointEffect | None = None) -> Step:
        scored = SimpleNamespace(fit=SimpleNamespace(hypothesis=Hypothesis(rig, effects)))
        return Step(None, scored, None, added)

    nominal, first = step(), step(friction, added=friction)
    # The last step was taken, and then an effect of before was removed from it.
    found = Search((nominal, first, step(friction, payload, added=payload), step(payload, added=payload)), ())
    assert [effect.key for effect in found.named] == [payload.key]
    assert found.before(payload).steps == (nominal, first)
    assert found.before(payload).before(friction).final is nominal
    assert found.since(friction) == [friction, payload]
    assert found.since(payload) == [payload]


def test_what_was_found_stays_where_a_refit_with_pushes_diverges(monkeypatch):
    def diverges(*_: object) -> None:
        raise np.linalg.LinAlgError

    monkeypatch.setattr(search, "has_windows_set_aside", lambda step: True)
    monkeypatch.setattr(search, "push_step", diverges)
    steps = [Step(None, None, SimpleNamespace(p_value=0.5))]
    said: list[str] = []
    found, by_laws, by_structure = _forward_search(steps, np.random.default_rng(1), said.append)
    assert found == steps
    assert not by_laws
    assert not by_structure
    assert said == ["a refit with pushes diverges: the search ends"]


@pytest.mark.parametrize(
    ("nominal", "after", "laws"), [(0.05, 0.5, 0), (0.001, 0.05, 2), (0.001, 0.2, 1), (0.001, 0.001, 5)]
)
def test_once_something_is_found_what_is_left_need_not_be_significant_but_open(
    monkeypatch, nominal, after, laws
):
    """Then only laws are added: neither pairs nor hidden states. Here the second law leaves nothing."""

    def step(p_value: float) -> Step:
        fit = SimpleNamespace(hypothesis=SimpleNamespace(effects=()))
        scored = SimpleNamespace(noise=SimpleNamespace(set_aside=None), fit=fit)
        return Step(None, scored, SimpleNamespace(p_value=p_value), None, 20.0)

    asked: list[float] = []

    def pair_step(before: Step, *_: object) -> tuple[Step, list[Step]]:
        asked.append(before.test.p_value)
        return before, []

    added: list[Step] = []

    def forward_step(*_: object) -> Step:
        added.append(step(after if not added or after < P_VALUE else 0.5))
        return added[-1]

    monkeypatch.setattr(search, "_forward_step", forward_step)
    monkeypatch.setattr(search, "pair_step", pair_step)
    monkeypatch.setattr(search, "_much_is_left", lambda step: False)
    found, *_ = _forward_search([step(nominal)], np.random.default_rng(1), lambda text: None)
    assert found[1:] == added
    assert len(added) == laws
    assert all(p_value < P_VALUE for p_value in asked)


@pytest.mark.parametrize(
    ("added", "tried"),
    [("push push push push push", 2), ("push law push push push", 4), ("law push push push push", 3)],
)
def test_hidden_states_are_not_fitted_again_after_every_push(monkeypatch, added, tried):
    """Twice beside the same laws, where another push was added since, and not beside two laws."""
    effects = {"push": ExternalPulse.__new__(ExternalPulse), "law": None}
    more = iter(added.split())
    count = []

    def step(effect: JointEffect | None) -> Step:
        fit = SimpleNamespace(hypothesis=SimpleNamespace(effects=()))
        scored = SimpleNamespace(noise=SimpleNamespace(set_aside=None), fit=fit)
        return Step(None, scored, SimpleNamespace(p_value=0.001), effect, 20.0)

    monkeypatch.setattr(search, "_forward_step", lambda *_: step(effects[next(more)]))
    monkeypatch.setattr(search, "pair_step", lambda before, *_: (before, []))
    monkeypatch.setattr(search, "_much_is_left", lambda _: True)
    monkeypatch.setattr(search, "structural_step", lambda *_: count.append(1))
    found, *_ = _forward_search([step(None)], np.random.default_rng(1), lambda text: None)
    assert len(found) == 1 + len(added.split())
    assert len(count) == tried


@pytest.mark.parametrize(("more", "taken"), [(-2.9, False), (2.9, False), (3.1, True)])
def test_a_hidden_state_is_taken_where_it_explains_more_than_laws_and_kept_in_mind_where_as_much(
    monkeypatch, more, taken
):
    def step(name: str, p_value: float, gain: float) -> Step:
        fit = SimpleNamespace(hypothesis=SimpleNamespace(effects=()))
        scored = SimpleNamespace(noise=SimpleNamespace(set_aside=None), fit=fit)
        return Step(name, scored, SimpleNamespace(p_value=p_value), None, gain)

    nominal, law, structure = step("nominal", 0.001, 0.0), step("law", 0.5, 21.0), step("s", 0.5, 21 + more)
    monkeypatch.setattr(search, "_forward_step", lambda *_: law)
    monkeypatch.setattr(search, "_much_is_left", lambda _: True)
    monkeypatch.setattr(search, "structural_step", lambda *_: structure)
    found = _forward_search([nominal], np.random.default_rng(1), lambda text: None)

    def diverges(*_: object) -> None:
        raise np.linalg.LinAlgError

    monkeypatch.setattr(search, "structural_step", diverges)
    kept, *_ = _forward_search([nominal], np.random.default_rng(1), lambda text: None)
    assert kept == [nominal, law]
    if taken:
        assert found == ([nominal, structure], [nominal, law], [])
    else:
        assert found == ([nominal, law], [], [nominal, structure])


@pytest.mark.parametrize(
    ("behind", "columns", "refitted"), [(0.04, 0.04, 2), (0.12, 0.12, 1), (0.12, 0.01, 4), (0.12, 0.04, 1)]
)
def test_what_lies_behind_is_refitted_where_it_may_act_alike(monkeypatch, behind, columns, refitted):
    """A simpler friction of the joint, and what columns do not tell from the best in spite of first fits.

    A twentieth behind by columns is told apart, a hundredth is not.
    """
    _, _, of, _ = arm_situation(20)
    (best, *_), (coulomb, elsewhere, *_), (other, *_) = (
        list(kind.instances(of)) for kind in (DirectionFriction, CoulombFriction, Payload)
    )
    assert best.part == coulomb.part != elsewhere.part
    effects = (best, coulomb, elsewhere, other)
    shares = {best.key: 1.0, coulomb.key: 1 - behind, elsewhere.key: 1 - behind, other.key: 1 - behind}
    begun: list[JointEffect] = []

    def refit(step: Step, effect: JointEffect, start: np.ndarray) -> SimpleNamespace:
        begun.append(effect)
        hypothesis, theta = SimpleNamespace(effects=(effect,)), np.ones(len(effect.parameters))
        return SimpleNamespace(hypothesis=hypothesis, theta=theta, log_evidence=2000 * shares[effect.key])

    gains = [
        SimpleNamespace(
            log_evidence=2000.0 * (1 - columns * (e is not best)), values=np.ones(len(e.parameters))
        )
        for e in effects
    ]
    scored = SimpleNamespace(
        gains=gains,
        effects=effects,
        fit=SimpleNamespace(log_evidence=0.0),
        noise=SimpleNamespace(set_aside=None),
    )
    monkeypatch.setattr(search, "one_step_values", lambda scored, i, values: values)
    monkeypatch.setattr(search, "fine_ripples", lambda step: [])
    monkeypatch.setattr(search, "refitted_pushes", lambda *_: [])
    monkeypatch.setattr(search, "gain_elsewhere", lambda step, rival: rival.gain)
    monkeypatch.setattr(search, "refit", refit)
    monkeypatch.setattr(search, "simplest", lambda step, rivals: rivals[0])
    monkeypatch.setattr(search, "rival_overdispersion", lambda *_: 1.0)
    monkeypatch.setattr(search, "step_to", lambda step, fit, effect, *_: effect)
    monkeypatch.setattr(
        search, "_preselect", lambda step, ones: [(e, s, 2000 * shares[e.key]) for e, s in ones]
    )
    assert _forward_step(Step(None, scored, None), np.random.default_rng(1), lambda text: None) is best
    assert begun == [best, coulomb, elsewhere, other][:refitted]


def test_a_delay_is_raced_from_both_signs_and_the_best_candidate_comes_first():
    rig, segments, of, _ = arm_situation(20)
    delay, friction = next(iter(EncoderDelay.instances(of))), next(iter(ViscousFriction.instances(of)))
    begun: list[tuple[str, ...]] = []

    def fit(hypothesis: Hypothesis, theta: np.ndarray, *_: object, **__: object) -> SimpleNamespace:
        """No step is taken; a delay of less than 0 is the better one, and better than friction."""
        begun.append((*(effect.key for effect in hypothesis.effects), *map(str, theta)))
        gain = (
            0.0 if not hypothesis.effects else 5.0 if hypothesis.effects == (friction,) else -1e4 * theta[0]
        )
        return SimpleNamespace(theta=theta, log_evidence=gain)

    fitter = SimpleNamespace(fit=fit)
    fitter.select = lambda _: fitter
    either = SimpleNamespace(select=lambda _: None)
    scored = SimpleNamespace(
        residual_noise=either, system=either,
        fit=SimpleNamespace(trajectory=np.zeros((1, 20, 4)), hypothesis=Hypothesis(rig), theta=np.zeros(0)),
    )  # fmt: skip
    problem = SimpleNamespace(segments=segments, fitter=fitter)
    ranked = _preselect(
        Step(problem, scored, None), [(friction, np.array([0.1])), (delay, np.array([0.004]))]
    )
    assert [effect.key for effect, *_ in ranked] == [delay.key, friction.key]
    assert ranked[0][1] == np.array([-0.004])
    assert ranked[0][2] == 40.0
    assert sorted(begun) == sorted([(), (friction.key, "0.1"), (delay.key, "0.004"), (delay.key, "-0.004")])


def test_a_link_that_stands_a_radian_from_where_its_encoder_says_is_told():
    """As where a joint was zeroed in another pose: ten standard deviations of what is usual."""
    rng, t, offset = np.random.default_rng(4), np.arange(0, 2, 0.01), 1.0
    angles, torques = [], []
    for _ in range(6):
        torque = 1.5 * np.sin(2 * np.pi * rng.uniform(0.5, 1.5) * t)[:, None]
        qpos, *_ = simulate(PENDULUM, t, torque, [rng.uniform(-1, 1)], [0.0], finer=1)
        angles.append(qpos[:, 0] + offset + rng.normal(0, 2e-3, len(t)))
        torques.append(torque[:, 0])
    channels = {"angle": (joint("swing"), angles), "torque": (control_channel(actuator="drive"), torques)}
    made = recording([t] * 6, channels)
    found = diagnose(made, bind(mujoco.MjSpec.from_string(PENDULUM), made.channels), seed=1).verdict
    (zero,) = found.effects
    assert zero.name == "joint_offset"
    (value,) = zero.parameters
    assert value.value == pytest.approx(offset, abs=3e-3)
    assert not found.unknown.flagged


def test_an_encoder_that_is_off_by_ten_standard_deviations_is_incredible():
    """A shift or a multiple of the readings explains any motion that a model does not make."""
    of = arm_situation(20)[2]
    offsets = {effect.variant: effect for effect in JointOffset.instances(of) if effect.part == "shoulder"}
    assert is_incredible(offsets["of the encoder that is recorded alone"], np.array([10.0]))
    assert not is_incredible(offsets["of the geometry"], np.array([10.0]))
    assert all(is_incredible(effect, np.array([-10.0])) for effect in EncoderScale.instances(of))


@pytest.mark.parametrize("seed", [2, 5])
def test_errors_of_a_law_at_rare_speeds_and_torques_are_no_pushes(seed):
    """A motor errs by a random function of both, 10 %, which a few shapes do not describe."""
    rng, t = np.random.default_rng(seed), np.arange(0, 2, 0.005)
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    waves, phases, heights = rng.normal(0, 1 / 0.6, (8, 2)), rng.uniform(0, 2 * np.pi, 8), rng.normal(size=8)
    heights *= 0.1 * np.sqrt(2 / np.sum(heights**2))
    angles, torques = [], []
    for _ in range(8):
        tones = zip(rng.normal(0, 2.5, 3), (0.4, 0.9, 1.7), rng.uniform(0, 6, 3), strict=True)
        torque = np.sum([a * np.sin(2 * np.pi * f * t + phase) for a, f, phase in tones], axis=0)

        def error(time: float, qpos: np.ndarray, qvel: np.ndarray, torque: np.ndarray = torque) -> np.ndarray:
            now = torque[min(int(time / 0.005 + 1e-9), len(torque) - 1)]
            return now * heights @ np.cos(waves @ [qvel[0] / 4, now / 2.5] + phases)[:, None]

        qpos, *_ = simulate(model, t, torque[:, None], [rng.normal(0, 0.3)], [0.0], law=error)
        angles.append(qpos[:, 0] + rng.normal(0, 5e-4, len(t)))
        torques.append(torque)
    channels = {"angle": (joint("swing"), angles), "torque": (control_channel(actuator="drive"), torques)}
    made = recording([t] * 8, channels)
    rig = bind(mujoco.MjSpec.from_string(PENDULUM), made.channels)
    problem = Problem.of(rig, made.channels, segment_recording(made, rig))
    nominal = nominal_step(nominal_motion(problem, ()), np.random.default_rng(0))
    assert nominal.scored.noise.set_aside is None
    assert nominal.test.push_p_value > 0.05
    assert nominal.scored.noise.law_error == pytest.approx(0.1, rel=0.3)


@pytest.mark.parametrize(
    ("p_value", "gain", "left"),
    [(0.005, 9.0, True), (0.005, 1.0, False), (0.05, 1.0, True), (0.2, 9.0, False)],
)
def test_hidden_states_are_fitted_where_laws_leave_something_or_it_is_open(p_value, gain, left):
    scored = SimpleNamespace(gains=[SimpleNamespace(log_evidence=gain)], effects=[None])
    assert _much_is_left(Step(None, scored, SimpleNamespace(p_value=p_value))) is left
