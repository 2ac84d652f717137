"""When something pushes: two masses on rails, simulated as linear systems, with and without pushes."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy import stats
from slapshot.diagnosis.fit.filter import Linear, innovations
from slapshot.diagnosis.fit.noise import FORCE_HOLD_S, Noise
from slapshot.diagnosis.model.segments import Segments
from slapshot.diagnosis.selection.pulses import (
    Scan,
    log_pushes,
    push_error,
    pushes,
    pushes_set_aside,
    scan,
    windows_set_aside,
)
from slapshot.diagnosis.selection.push_search import _joined_while_held
from slapshot.effects.joints.effect import Joint, RigMotion, State
from slapshot.effects.joints.external_pulse import ExternalPulse, Pulse

JOINTS, SEGMENTS, WHITE, FORCE = 2, 6, 1e-4, 0.1
NONE = np.zeros(0)
MOVING = np.ones((SEGMENTS, 50, JOINTS))


def rig(interval: float) -> RigMotion:
    joints = tuple(
        Joint(
            name=f"rail {k}", q=k, v=k, unit="N", actuators=(), torque=1.0, largest=(), speed=1.0, travel=1.0,
            middle=0.0, inertia=1.0,
        )
        for k in range(JOINTS)
    )  # fmt: skip
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    return RigMotion(model, joints, (), (), interval, 2)


def segments(interval: float = 0.01) -> Segments:
    """Two episodes, each three segments of half a second side by side."""
    L = round(0.5 / interval)
    y = np.zeros((SEGMENTS, L, JOINTS))
    episode = np.arange(SEGMENTS) // 3
    first = np.arange(SEGMENTS) % 3 * L
    return Segments(
        interval=interval, substeps=1, y=y, shift=0 * y, shift_square=0 * y,
        inside=np.ones(y.shape[:2], bool),
        time=(first[:, None] + np.arange(L)) * interval, episode=episode, first=first,
        order=episode - 0.5, controls=(), ids=np.array([7, 9]), quantisation=np.zeros(JOINTS),
    )  # fmt: skip


def noise(of: Segments) -> Noise:
    return Noise(
        white=np.full(JOINTS, WHITE), coloured=np.zeros(JOINTS), correlation_s=np.ones(JOINTS), force=FORCE,
        torque=np.ones(JOINTS), initial=np.repeat([0.05**2, 1.0], JOINTS), weight=np.ones_like(of.y),
    )  # fmt: skip


def masses(
    of: Segments, rng: np.random.Generator, push: tuple[int, int, float, float, float] | None = None
) -> Linear:
    """Masses of 1 kg, of which the places are seen.

    Args:
        of: times.
        rng: of first states, process force and noise.
        push: episode, joint, begin and end in s, force in N.
    """
    h, (S, L), n = of.interval, of.shape, 2 * JOINTS
    one = np.eye(JOINTS)
    A = np.block([[one, h * one], [0 * one, one]])
    B = np.concatenate([h**2 * one, h * one])
    C = np.concatenate([one, 0 * one], axis=1)
    r = np.empty((S, L, JOINTS))
    for s in range(S):
        x = np.repeat([0.05, 1.0], JOINTS) * rng.standard_normal(n)
        for t in range(L):
            r[s, t] = C @ x + WHITE * rng.standard_normal(JOINTS)
            f = FORCE * np.sqrt(FORCE_HOLD_S / h) * rng.standard_normal(JOINTS)
            if push is not None and of.episode[s] == push[0]:
                f[push[1]] += push[4] * (push[2] - 1e-9 <= of.time[s, t] < push[3] - 1e-9)
            x = A @ x + B @ f
    shape = (S, L)
    return Linear(
        *(np.broadcast_to(part, (*shape, *part.shape)).copy() for part in (A, B)),
        np.zeros((*shape, n)), np.broadcast_to(C, (*shape, *C.shape)).copy(), r,
        np.zeros((*shape, n, 0)), np.zeros((*shape, JOINTS, 0)),
    )  # fmt: skip


def scanned(
    seed: int, push: tuple[int, int, float, float, float] | None = None, interval: float = 0.01
) -> tuple[Scan, Segments]:
    of = segments(interval)
    system = masses(of, np.random.default_rng(seed), push)
    return scan(system, NONE, noise(of), of, rig(interval)), of


def test_without_pushes_p_values_are_uniform():
    """Though windows side by side are not independent."""
    rng = np.random.default_rng(5)
    p = np.array([scanned(seed)[0].p_value(rng, 99) for seed in range(100)])
    # p-values are hundredths; half a step makes them uniform on average.
    assert stats.kstest(p - 0.005, "uniform").pvalue > 1e-3


def test_ratios_without_pushes_are_standard_normal():
    ratio = np.concatenate([scanned(seed)[0].ratio.ravel() for seed in range(20)])
    # Scaled by the spread of all where that is more than one, so a little less than one.
    assert 0.8 < np.std(ratio) < 1 + 4 / np.sqrt(2 * len(ratio))
    assert abs(np.mean(ratio)) < 4 / np.sqrt(len(ratio))


def test_without_pushes_none_is_told():
    """A level of 1 % a recording: 3 or more of 40 have a chance of 0.7 %."""
    observable = 0
    for seed in range(40):
        found, of = scanned(1000 + seed)
        observable += bool(pushes(found, of, rig(0.01)))
    assert observable < 3


@pytest.mark.parametrize(("joint", "begin", "force"), [(0, 0.2, 1.5), (1, 0.67, -1.5), (1, 1.13, 1.5)])
def test_a_push_is_located(joint: int, begin: float, force: float):
    found, of = scanned(3, (1, joint, begin, begin + 0.1, force))
    assert found.p_value(np.random.default_rng(6), 99) == 0.01
    ((effect, _),) = pushes(found, of, rig(0.01))
    assert effect.part == f"rail {joint}"
    (pulse,) = effect.pulses
    assert (pulse.episode, pulse.order) == (9, 0.5)  # as recorded, not an index
    # The windows that it touches, and at most one before and after.
    first, last = np.floor(begin / 0.05 + 1e-6) * 0.05, np.ceil((begin + 0.1) / 0.05 - 1e-6) * 0.05
    assert -0.05 - 1e-9 <= pulse.begin - first <= 1e-9
    assert -1e-9 <= pulse.end - last <= 0.05 + 1e-9
    s, w, j = np.unravel_index(np.abs(found.ratio).argmax(), found.ratio.shape)
    assert (s, j, np.sign(found.ratio[s, w, j])) == (3 + int(begin / 0.5), joint, np.sign(force))
    # It acts on its joint, in its time and episode alone.
    times = np.array([pulse.begin, pulse.end, pulse.begin])
    order = np.array([0.5, 0.5, -0.5])
    state = State(np.zeros((3, 2)), np.zeros((3, 2)), np.zeros((3, 2)), times, order)
    acting = effect.force(state, np.array([2.0]))
    np.testing.assert_array_equal(acting[:, joint], [2, 0, 0])
    np.testing.assert_array_equal(acting[:, 1 - joint], 0)


@pytest.mark.parametrize("interval", [0.01, 0.004])  # at 0.004 s no whole number of windows fills a segment
def test_a_push_over_the_border_of_segments_is_one(interval: float):
    found, of = scanned(4, (0, 1, 0.3, 0.7, 2.0), interval)
    ((effect, _),) = pushes(found, of, rig(interval))
    (pulse,) = effect.pulses
    assert pulse.episode == 7
    assert abs(pulse.begin - 0.3) <= 0.06
    assert abs(pulse.end - 0.7) <= 0.06


def test_pushes_to_and_fro_are_two():
    """Forward in 0.3 to 0.5 s, back in 0.5 to 0.7 s, with the border of segments between."""
    of = segments()
    system, back = masses(of, np.random.default_rng(7), (0, 0, 0.3, 0.5, 2.0)), [0, 0, 0.5, 0.7, -2.0]
    other = masses(of, np.random.default_rng(7), tuple(back))
    system.r[1] = other.r[1]  # the second segment is pushed back
    ((effect, _),) = pushes(scan(system, NONE, noise(of), of, rig(0.01)), of, rig(0.01))
    first, second = effect.pulses
    assert first.end == pytest.approx(0.5)
    assert second.begin == pytest.approx(0.5)


def test_what_always_acts_is_no_push():
    """A force that the model lacks everywhere raises the spread of all windows."""
    found, _ = scanned(5, (0, 0, 0.0, 9.0, 3.0))
    one, _ = scanned(5, (0, 0, 0.2, 0.3, 3.0))
    assert np.abs(found.ratio[..., 0]).max() < 0.5 * np.abs(one.ratio[..., 0]).max()


def test_values_of_columns_are_taken_off_first():
    """A column that is the push itself, at its value, leaves nothing."""
    of = segments()
    system = masses(of, np.random.default_rng(6), (1, 0, 0.2, 0.3, 3.0))
    W = np.zeros((*system.d.shape, 1))
    during = (of.episode[:, None] == 1) & (of.time > 0.2 - 1e-9) & (of.time < 0.3 - 1e-9)
    W[during, :, 0] = system.B[during][..., 0]
    own = system.with_columns(W, np.zeros((*system.r.shape, 1)))
    assert scan(own, np.array([0.0]), noise(of), of, rig(0.01)).p_value(np.random.default_rng(7), 99) == 0.01
    left = scan(own, np.array([3.0]), noise(of), of, rig(0.01))
    nothing, _ = scanned(6)
    np.testing.assert_allclose(left.ratio, nothing.ratio, atol=1e-6)


def test_the_shape_of_a_named_push_is_no_mismatch():
    """A push twice as long as the real one and half as large: innovations about it stay of unit size."""
    of = segments()
    begin, end, force = 0.65, 0.75, 6.0
    system = masses(of, np.random.default_rng(6), (1, 0, begin, end, force))
    push = ExternalPulse(rig(0.01).joints[0], [Pulse(9, 0.5, 0.6, 0.8)])
    W = np.zeros((*system.d.shape, 1))
    during = (of.episode[:, None] == 1) & (of.time > 0.6 - 1e-9) & (of.time < 0.8 - 1e-9)
    W[during, :, 0] = system.B[during][..., 0]
    named = system.with_columns(W, np.zeros((*system.r.shape, 1))).moved(np.array([force / 2]))
    error = push_error([(push, np.array([force / 2]))], np.ones(JOINTS), of, rig(0.01))
    assert error is not None
    near = (of.episode == 1)[:, None] & (of.time > 0.55 - 1e-9) & (of.time < 0.85 + 1e-9)
    np.testing.assert_array_equal(error > 0, near)
    sizes = []
    for known in (noise(of), replace(noise(of), push_error=error)):
        e = innovations(named.without_columns(), known.covariances(of.interval)).e[..., 0]
        sizes.append(np.mean(e[near] ** 2))
    assert sizes[0] > 5
    assert sizes[1] < 1.5


def test_one_long_push_may_be_set_aside_beside_laws():
    """Of half a second, over two segments: a sixth of all windows, too much to be pushed where laws lack."""
    of = segments()
    system = masses(of, np.random.default_rng(8), (1, 1, 0.7, 1.2, 60.0))
    covering = replace(noise(of), force=3.0)
    for longest, found in ((0.0, False), (0.05, False), (0.2, True)):
        windows = windows_set_aside(system, NONE, MOVING, covering, of, rig(0.01), longest)
        assert (windows is not None) == found
    assert windows is not None
    pushed = (of.episode == 1)[:, None] & (of.time > 0.7 - 1e-9) & (of.time < 1.2 - 1e-9)
    assert (windows[pushed] > 0).all()
    assert np.mean(windows > 0) <= 0.2  # and a window before and after
    # Twice as many in two pushes are too many again.
    twice = masses(of, np.random.default_rng(8), (1, 1, 0.7, 1.2, 60.0)).r
    both = replace(system, r=np.concatenate([twice[3:], twice[3:]]))
    assert windows_set_aside(both, NONE, MOVING, covering, of, rig(0.01), 0.2) is None


def test_a_push_with_knots_errs_by_less_than_a_constant_one():
    """By an interval between knots of its largest force; in the unit of a force held for `FORCE_HOLD_S`."""
    of, joint = segments(), rig(0.01).joints[0]
    both = []
    for knots, values in ((1, np.array([2.0])), (5, np.array([0.0, 1.0, -2.0, 1.0, 0.0]))):
        push = ExternalPulse(joint, [Pulse(9, 0.5, 0.3, 0.8, knots)])
        both.append(push_error([(push, values)], np.ones(JOINTS), of, rig(0.01)))
    assert both[0] is not None
    assert both[1] is not None
    assert both[0].max() == pytest.approx(0.4 * 2.0 * np.sqrt(0.05 / FORCE_HOLD_S))
    assert both[1] == pytest.approx(both[0] / 4)


def test_pushes_are_one_where_friction_holds_the_joint_between_them():
    """Where it could have moved, another direction is pushed, or nothing was recorded, they are two."""
    of, joint = segments(), rig(0.01).joints[0]
    parts = Pulse(9, 0.5, 0.3, 0.5), Pulse(9, 0.5, 0.6, 0.9)
    push, held = ExternalPulse(joint, parts), np.zeros(of.shape, bool)
    gap = (of.episode == 1)[:, None] & (of.time > 0.495) & (of.time < 0.595)
    for there, force, expected in (
        (held | gap, [3.0, 5.0], [Pulse(9, 0.5, 0.3, 0.9)]),
        (held | gap, [3.0, -5.0], list(parts)),
        (held, [3.0, 5.0], list(parts)),
    ):
        whole, sizes = _joined_while_held(push, np.array(force), there, of)
        assert list(whole.pulses) == expected
        assert sizes == pytest.approx([5.0] if len(expected) == 1 else force)
    some = np.flatnonzero(of.time[:, 0] < 0.4)
    lost = of.select(some)  # from 0.5 s on
    assert list(_joined_while_held(push, np.array([3.0, 5.0]), (held | gap)[some], lost)[0].pulses) == list(
        parts
    )


def with_push_set_aside(system: Linear, of: Segments, force: float) -> Noise:
    """As the process force, which covers the push at first, is fitted to what is left."""
    known = noise(of)
    for size in np.geomspace(abs(force) / 5, FORCE, 6):
        known = replace(known, force=float(size))
        known = replace(known, set_aside=windows_set_aside(system, NONE, MOVING, known, of, rig(0.01)))
    return known


@pytest.mark.parametrize(
    ("begin", "end", "force"),
    [(0.6, 0.8, 60.0), (0.6, 0.8, -600.0), (0.62, 0.78, 600.0), (0.48, 0.63, 600.0)],
)
def test_an_enormous_push_is_set_aside(begin: float, end: float, force: float):
    """Windows begin at multiples of 0.05 s; where the push begins or ends within one is found to a node."""
    push = (1, 1, begin, end, force)
    of = segments()
    system = masses(of, np.random.default_rng(8), push)
    known = with_push_set_aside(system, of, force)
    assert known.set_aside is not None
    inside = (of.episode == 1)[:, None] & (of.time > begin - 1e-9) & (of.time < end - 1e-9)
    assert (known.set_aside[inside] > 0).all()
    # A window before or after may be touched by it.
    near = (of.episode == 1)[:, None] & (of.time > begin - 0.05 - 1e-9) & (of.time < end + 0.05 - 1e-9)
    np.testing.assert_array_equal(known.set_aside[~near], 0)
    ((effect, size),) = pushes_set_aside(system, known, of, rig(0.01), ())
    assert effect.part == "rail 1"
    # A window's force is taken for about as large as it was known to be.
    assert size == pytest.approx([force], rel=0.3)
    (pulse,) = effect.pulses
    assert pulse.episode == 9
    assert abs(pulse.begin - begin) <= of.interval + 1e-9
    assert abs(pulse.end - end) <= of.interval + 1e-9
    assert not pushes_set_aside(system, known, of, rig(0.01), effect.pulses)


def test_a_push_goes_on_while_friction_holds_its_joint():
    """From 0.7 to 0.8 s the joint hardly feels a force: motion tells no size, which stays as it was."""
    push = (1, 1, 0.6, 0.8, 60.0)
    of = segments()
    system = masses(of, np.random.default_rng(8), push)
    known = with_push_set_aside(system, of, push[-1])
    assert known.set_aside is not None
    held, speed = (of.episode == 1)[:, None] & (of.time > 0.7 - 1e-9) & (of.time < 0.8 - 1e-9), MOVING.copy()
    assert (known.set_aside[held] > 0).all()
    speed[held] = 0.0
    holds = replace(system, B=np.where(held[..., None, None], 1e-6 * system.B, system.B), process=system.B)
    found = windows_set_aside(holds, NONE, speed, known, of, rig(0.01))
    assert found is not None
    np.testing.assert_array_equal(found[held], known.set_aside[held])
    # Alone, without a push beside it, it does not stay.
    known = replace(known, set_aside=np.where(held, known.set_aside, 0.0))
    assert windows_set_aside(replace(holds, r=0 * holds.r), NONE, speed, known, of, rig(0.01)) is None
    ((effect, _),) = pushes_set_aside(holds, replace(known, set_aside=found), of, rig(0.01), ())
    (pulse,) = effect.pulses
    assert abs(pulse.begin - push[2]) <= of.interval + 1e-9


def test_without_an_enormous_push_nothing_is_set_aside():
    """Of 2,400 normal numbers in all, one beyond 5 standard deviations has a chance of 0.1 %."""
    of = segments()
    for seed in range(20):
        system = masses(of, np.random.default_rng(100 + seed))
        assert windows_set_aside(system, NONE, MOVING, noise(of), of, rig(0.01)) is None


def test_pushes_that_could_be_are_windows_joints_and_edges():
    """60 windows of 5 nodes, two joints, either edge at any of 10 nodes."""
    assert log_pushes(segments(), rig(0.01)) == pytest.approx(np.log(60 * 2 * 10**2))


def test_many_pushed_windows_are_not_set_aside():
    """What acts in a fifth of the time is what the model lacks."""
    of = segments()
    system = masses(of, np.random.default_rng(9), (1, 1, 0.3, 1.2, 100.0))
    assert windows_set_aside(system, NONE, MOVING, noise(of), of, rig(0.01)) is None


def test_windows_of_known_pushes_are_not_judged():
    found, of = scanned(3, (1, 0, 0.2, 0.3, 1.5))
    ((effect, _),) = pushes(found, of, rig(0.01))
    system = masses(of, np.random.default_rng(3), (1, 0, 0.2, 0.3, 1.5))
    again = scan(system, NONE, noise(of), of, rig(0.01), effect.pulses)
    begin, end = (round(t / 0.05) for t in (effect.pulses[0].begin, effect.pulses[0].end))
    assert not again.observable[3, begin:end].any()
    assert again.observable.sum() == found.observable.sum() - JOINTS * (end - begin)


@pytest.mark.parametrize(("torque", "pushed"), [(230.0, True), (250.0, False)])
def test_where_joints_turn_around_a_weak_force_is_no_push(torque: float, pushed: bool):
    """At 0.7 s of the second episode, within a push of 60 N."""
    of = segments()
    system = masses(of, np.random.default_rng(8), (1, 1, 0.65, 0.75, 60.0))
    moved = replace(rig(0.01), joints=tuple(replace(j, torque=torque) for j in rig(0.01).joints))
    known, speed = replace(noise(of), force=12.0), MOVING.copy()
    speed[4, 20:] = -1
    # Its force is told within a few per cent, and the limit is a quarter of the torque.
    found = windows_set_aside(system, NONE, speed, known, of, moved)
    assert (found is not None) == pushed
    assert windows_set_aside(system, NONE, MOVING, known, of, moved) is not None


def test_where_a_joint_with_friction_turns_around_weak_forces_are_not_judged():
    """Nor blamed on the windows after it."""
    of = segments()
    speed = MOVING[..., 0].copy()
    speed[3, 22:] = -1  # at 0.22 s of the second episode
    system = masses(of, np.random.default_rng(3), (1, 0, 0.2, 0.25, 1.5))
    plain = scan(system, NONE, noise(of), of, rig(0.01))
    assert np.abs(plain.ratio[3, 4:6, 0]).max() > 4
    for torque, judged in ((1.0, True), (10.0, False)):
        moved = replace(rig(0.01), joints=tuple(replace(j, torque=torque) for j in rig(0.01).joints))
        found = scan(system, NONE, noise(of), of, moved, (), {"rail 0": speed})
        assert found.observable[3, 4, 0] == judged
        assert judged or np.abs(found.ratio[3, :, 0][found.observable[3, :, 0]]).max() < 3
