"""A whole diagnosis of flights of a ball, integrated apart from MuJoCo, from gravity alone."""

import numpy as np
import pytest
from mujoco import MjSpec
from scipy.integrate import solve_ivp
from slapshot.diagnosis.diagnose import diagnose
from slapshot.diagnosis.model.rig import bind

from .mechanisms import place, recording

BALL = """<mujoco><option timestep="0.002" integrator="RK4"/><worldbody><body name="ball"><freejoint/>
<geom type="sphere" size=".02" mass=".0027" contype="0" conaffinity="0"/></body></worldbody></mujoco>"""
MASS, DRAG, NOISE, FLIGHTS = 0.0027, 3.4e-4, 0.002, 10  # of a table tennis ball; drag in N s^2/m^2


def flights(seed: int) -> tuple[np.ndarray, list[np.ndarray]]:
    """Times in s, and a (n, 3) array in m of each flight, too short for two windows of half a second."""
    rng, t = np.random.default_rng(seed), np.arange(70) * 0.01

    def change(_: float, state: np.ndarray) -> np.ndarray:
        v = state[3:]
        return np.concatenate([v, [0, 0, -9.81] - DRAG / MASS * np.linalg.norm(v) * v])

    found = []
    for _ in range(FLIGHTS):
        start = [0, 0, 0.3, rng.uniform(4, 7), rng.uniform(-0.7, 0.7), rng.uniform(1.5, 3)]
        known = solve_ivp(change, (0, t[-1]), start, t_eval=t, rtol=1e-10, atol=1e-10).y[:3].T
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
