"""A whole diagnosis of flights of a ball, integrated apart from MuJoCo, from gravity alone."""

import numpy as np
import pytest
from mujoco import MjSpec
from scipy.integrate import solve_ivp
from slapshot.diagnosis.diagnose import diagnose
from slapshot.diagnosis.impacts import impacts, without_impacts
from slapshot.diagnosis.model.rig import bind
from slapshot.diagnosis.selection.free_forms import FreeForceAcross, FreeForceAlong
from slapshot.effects.joints.effect import State

from .mechanisms import place, recording

BALL = """<mujoco><option timestep="0.002" integrator="RK4"/><worldbody><body name="ball"><freejoint/>
<geom type="sphere" size=".02" mass=".0027" contype="0" conaffinity="0"/><site name="middle"/>
</body></worldbody></mujoco>"""
MASS, DRAG, NOISE, FLIGHTS = 0.0027, 3.4e-4, 0.002, 10  # of a table tennis ball; drag in N s^2/m^2


def flights(
    seed: int, lift: float = 0.0, buoyancy: float = 0.0, slow: float = 0.0
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Times in s, and a (n, 3) array in m of each flight, too short for two windows of half a second.

    Each has a spin of its own, which lifts it by a multiple (1/s) of its speed. The air carries a share of
    the weight, and the drag of a slow ball is larger than the square of its speed says by another share.
    """
    rng, t = np.random.default_rng(seed), np.arange(70) * 0.01

    def change(_: float, state: np.ndarray, spin: np.ndarray) -> np.ndarray:
        v = state[3:]
        speed = np.linalg.norm(v)
        air = np.cross(spin, v) - DRAG / MASS * (1 + slow * np.exp(-speed / 3)) * speed * v
        return np.concatenate([v, np.array([0, 0, -9.81 * (1 - buoyancy)]) + air])

    found = []
    for _ in range(FLIGHTS):
        spin = lift * rng.normal(size=3) if lift else np.zeros(3)
        start = [0, 0, 0.3, rng.uniform(4, 7), rng.uniform(-0.7, 0.7), rng.uniform(1.5, 3)]
        known = solve_ivp(change, (0, t[-1]), start, t_eval=t, args=(spin,), rtol=1e-10, atol=1e-10).y[:3].T
        found.append(known + rng.normal(0, NOISE, known.shape))
    return t, found


def test_air_drag_is_named_from_short_flights():
    t, found = flights(4)
    channels = {c: (place("body", "ball", c), [one[:, i] for one in found]) for i, c in enumerate("xyz")}
    made = recording([t] * FLIGHTS, channels)
    told = diagnose(made, bind(MjSpec.from_string(BALL), made.channels), seed=1).verdict
    assert told.headline == "found"
    assert [effect.name for effect in told.effects] == ["quadratic_drag"]
    (drag,) = told.effects[0].parameters
    sd = (drag.high - drag.low) / (2 * 1.645)
    assert abs(drag.value - DRAG) < 4 * sd
    assert sd < 0.1 * DRAG
    assert told.fit is not None
    assert told.fit.window_s == pytest.approx(0.35)
    rms = {arm: getattr(told.fit, arm).rms["body position"].value for arm in ("nominal", "augmented")}
    floor = told.fit.noise_floor.rms["body position"].value
    assert rms["augmented"] < 2 * floor < rms["nominal"]


def test_spins_that_differ_from_flight_to_flight_are_a_force_across_the_motion():
    """One spin of all flights is in the catalogue; many are unknown, but it is told how they act."""
    t, found = flights(4, lift=0.4)
    channels = {c: (place("site", "middle", c), [one[:, i] for one in found]) for i, c in enumerate("xyz")}
    made = recording([t] * FLIGHTS, channels)
    told = diagnose(made, bind(MjSpec.from_string(BALL), made.channels), seed=1).verdict
    assert "spin_lift" not in [effect.name for effect in told.effects]
    assert told.unknown.flagged
    assert "across the motion of ball, another one in each episode" in told.unknown.description


def bouncing(rate: float, noise: float) -> tuple[np.ndarray, list[np.ndarray], list[float]]:
    """Times, places (n, 3) of balls that fall in air and bounce, and when each did."""
    rng, t = np.random.default_rng(2), np.arange(round(1.0 * rate)) / rate
    found, when = [], []
    for _ in range(5):
        start = np.array([0, 0, 0.3, *rng.uniform([4, -0.7, 1.5], [7, 0.7, 3.0])])

        def change(_: float, state: np.ndarray) -> np.ndarray:
            v = state[3:]
            return np.concatenate([v, np.array([0, 0, -9.81]) - DRAG / MASS * np.linalg.norm(v) * v])

        def landed(_: float, state: np.ndarray) -> float:
            return float(state[2])

        landed.terminal, landed.direction = True, -1
        first = solve_ivp(change, (0, t[-1]), start, events=landed, dense_output=True, rtol=1e-9, atol=1e-9)
        at, state = float(first.t_events[0][0]), first.y_events[0][0].copy()
        state[3:] *= [0.7, 0.7, -0.8]
        second = solve_ivp(change, (at, t[-1]), state, dense_output=True, rtol=1e-9, atol=1e-9)
        places = np.where(t[:, None] < at, first.sol(t)[:3].T, second.sol(np.maximum(t, at))[:3].T)
        found.append(places + rng.normal(0, noise, places.shape))
        when.append(at)
    return t, found, when


@pytest.mark.parametrize(("rate", "noise"), [(60.0, 0.002), (120.0, 0.003), (240.0, 0.002), (240.0, 1e-4)])
def test_flights_end_where_a_ball_bounces(rate, noise):
    t, found, when = bouncing(rate, noise)
    channels = {c: (place("body", "ball", c), [one[:, i] for one in found]) for i, c in enumerate("xyz")}
    made = recording([t] * 5, channels)
    cut, (note,) = without_impacts(made, bind(MjSpec.from_string(BALL), made.channels))
    assert "5 of 5 episodes have impacts" in note
    for (_, rows), at in zip(cut.signals["encoder"].groupby("episode"), when, strict=True):
        times = rows["t"].to_numpy()
        longer = times.max() < at if at > t[-1] / 2 else times.min() > at
        assert longer
        assert len(times) > rate * max(at, t[-1] - at) - 6


def test_a_ball_that_lies_for_long_flies_before():
    """Half a second of flight and two of rest; in the flight nobody saw it for a quarter of a second."""
    t = np.arange(300) / 120
    fall = 1.226 - 9.81 / 2 * t**2  # it lands after half a second
    places = np.stack([3 * np.minimum(t, 0.5), 0 * t, np.maximum(fall, 0.0)], axis=1)
    places += np.random.default_rng(0).normal(0, 1e-3, places.shape)
    channels = {c: (place("body", "ball", c), [places[:, i]] * 2) for i, c in enumerate("xyz")}
    made = recording([t] * 2, channels)
    rig = bind(MjSpec.from_string(BALL), made.channels)
    cut, _ = without_impacts(made, rig)
    assert 0.45 < cut.signals["encoder"]["t"].max() < 0.5
    # A gap is none: gravity alone has changed the velocity there.
    flight = np.stack([3 * t, 0 * t, 20 * t - 9.81 / 2 * t**2], axis=1)
    seen = (t < 0.3) | (t > 0.6)
    assert impacts(t[seen], flight[seen]) == []


def test_of_two_balls_neither_may_hit_anything():
    t = np.arange(240) / 120
    two = BALL.replace('<body name="ball">', '<body name="other"><freejoint/><geom size=".02" contype="0" '
                       'conaffinity="0"/></body><body name="ball">')  # fmt: skip
    ways = {}
    for name, at in (("ball", 0.5), ("other", 1.5)):
        turned = np.where(t < at, 4 * t, 4 * at - 2 * (t - at))
        ways[name] = np.stack([turned, 0 * t, 5 + 9 * t - 9.81 / 2 * t**2], axis=1)
    channels = {
        f"{name}_{c}": (place("body", name, c), [way[:, i]] * 2)
        for name, way in ways.items()
        for i, c in enumerate("xyz")
    }
    made = recording([t] * 2, channels)
    cut, _ = without_impacts(made, bind(MjSpec.from_string(two), made.channels))
    for _, rows in cut.signals["encoder"].groupby("episode"):
        assert 0.5 < rows["t"].min() < 0.55
        assert 1.45 < rows["t"].max() < 1.5


def test_flights_without_impacts_are_left_as_they_are():
    """A wrong reading of 5 cm is no impact, nor is what air and gravity do."""
    t, found = flights(4, lift=0.4)
    found[3][30, 2] += 0.05
    channels = {c: (place("body", "ball", c), [one[:, i] for one in found]) for i, c in enumerate("xyz")}
    made = recording([t] * FLIGHTS, channels)
    rig = bind(MjSpec.from_string(BALL), made.channels)
    assert without_impacts(made, rig) == (made, [])
    # Where something may be touched, impacts are the model's own.
    floor = BALL.replace('contype="0" conaffinity="0"', "").replace(
        "<worldbody>", '<worldbody><geom type="plane" size="9 9 1"/>'
    )
    t, found, _ = bouncing(120.0, 0.002)
    channels = {c: (place("body", "ball", c), [one[:, i] for one in found]) for i, c in enumerate("xyz")}
    made = recording([t] * 5, channels)
    assert without_impacts(made, bind(MjSpec.from_string(floor), made.channels)) == (made, [])


@pytest.mark.slow
def test_a_light_ball_has_buoyancy_and_a_drag_that_holds_to_some_per_cent():
    """A table tennis ball in air, whose drag is a little more than the square of its speed says."""
    t, found = flights(6, buoyancy=0.0145, slow=0.15)
    channels = {c: (place("body", "ball", c), [one[:, i] for one in found]) for i, c in enumerate("xyz")}
    made = recording([t] * FLIGHTS, channels)
    told = diagnose(made, bind(MjSpec.from_string(BALL), made.channels), seed=1).verdict
    assert [effect.name for effect in told.effects] == ["quadratic_drag", "buoyancy"]
    drag, lift = (effect.parameters[0] for effect in told.effects)
    assert DRAG < drag.value < 1.15 * DRAG
    assert not told.unknown.flagged
    assert lift.low < 0.0145 * 9.81 * MASS < lift.high


def test_a_force_of_each_flight_is_across_its_own_motion():
    body, orders, rng = "ball", np.array([-0.5, 0.0, 0.5]), np.random.default_rng(0)
    across = FreeForceAcross(body, 0, 0.0265, 5.0, orders)
    values, v = rng.normal(size=9), rng.normal(size=(6, 6))
    order = np.array([-0.5, 0.0, 0.5, 0.5, 0.25, -0.5])
    state = State(np.zeros((6, 7)), v, np.zeros((6, 6)), np.zeros(6), order)
    force = across.force(state, values)
    assert np.einsum("ni,ni->n", force[:, :3], v[:, :3]) == pytest.approx(0, abs=1e-12)
    assert force[2] == pytest.approx(np.append(np.cross(values[6:], v[2, :3]) / 5.0, np.zeros(3)))
    assert not force[4].any()  # of an episode that has none


def test_a_force_along_the_motion_brakes_by_what_its_bumps_say():
    along = FreeForceAlong("ball", 0, 0.0265, 5.0)
    v = np.random.default_rng(1).normal(size=(5, 6)) * 3
    force = along.force(State(np.zeros((5, 7)), v, np.zeros((5, 6)), np.zeros(5), np.zeros(5)), np.ones(6))
    assert np.cross(force[:, :3], v[:, :3]) == pytest.approx(0, abs=1e-12)
    assert (np.einsum("ni,ni->n", force[:, :3], v[:, :3]) < 0).all()
