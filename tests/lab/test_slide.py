import numpy as np
import pytest
from slapshot.arrays import GRAVITY
from slapshot.errors import InputError
from slapshot.lab.board import draw_height, draw_log_friction, gradient, value
from slapshot.lab.slide import STEP, _run, slide
from slapshot.lab.surface import Ground
from slapshot.rollouts.slide import slide as nominal_slide

RADIUS = 0.0381
UNEVEN = draw_height(0.01, (0.3, 1.5), 24, np.random.default_rng(0))
PATCHY = draw_log_friction(0.1, (0.3, 1.5), 12, np.random.default_rng(1))
STATE = np.array([0.1, 0.2, 0.3, 1.5, 0.4, 8.0])
FRICTION = (0.3, 0.4, 0.005)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("friction", [(0.15, 0.19, 0.001), (0.5, 0.35, 0.02), (0.95, 0.7, 0.05)])
def test_stopping_distance_along_both_axes(axis, friction):
    # v^2 / (2 mu g): the midpoint rule is exact under constant deceleration, and so is the last part of
    # a step; what keeps s from 0 adds 1e-12 of v.
    speed = 1.7
    state = np.zeros(6)
    state[3 + axis] = speed
    result = slide(state, friction, RADIUS, 0.01)
    assert result.rest[axis] == pytest.approx(speed**2 / (2 * friction[axis] * GRAVITY), rel=1e-7)
    assert result.duration == pytest.approx(speed / (friction[axis] * GRAVITY), rel=1e-7)
    assert abs(result.rest[1 - axis]) < 1e-9


@pytest.mark.parametrize("torsional", [0.0, 0.02])
def test_pure_spin(torsional):
    # Every point slips with R w, so that its torque is N sqrt(mu^2 R^2 + mu_t^2). With inertia m R^2 / 2
    # the spin falls at 2 g sqrt(mu^2 R^2 + mu_t^2) / R^2; without mu_t it ends after R w / (2 mu g).
    mu, spin = 0.4, 20.0
    result = slide(np.array([0, 0, 0, 0, 0, spin]), (mu, mu, torsional), RADIUS, 0.01)
    slowing = 2 * GRAVITY * np.hypot(mu * RADIUS, torsional) / RADIUS**2
    assert result.duration == pytest.approx(spin / slowing, rel=1e-7)
    assert result.rest[2] == pytest.approx(spin**2 / (2 * slowing), rel=1e-7)
    assert np.abs(result.rest[:2]).max() < 1e-9


def test_order_of_convergence():
    # Second order, as the midpoint rule is. The last instants, when the direction of motion turns faster
    # than any step, cost up to half an order.
    def rest(step):
        return slide(STATE, FRICTION, RADIUS, 0.01, Ground(UNEVEN, PATCHY), step=step).rest[:2]

    exact = rest(1e-5)
    steps = np.array([8e-3, 4e-3, 2e-3, 1e-3])
    errors = [np.linalg.norm(rest(step) - exact) for step in steps]
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert 1.5 < order < 2.7
    assert np.linalg.norm(rest(2e-4) - exact) < 1e-6


@pytest.mark.parametrize(
    "concealed",
    [
        {},
        {"fades": [[3.0, 0.15, 1.4]]},
        {"drags": [[3.0, 2.2]]},
        {"grooves": [[0.5, 0.7]]},
        {"curls": [[1.0, 1.0]]},
        {"centres": [[0.008, 0.009, 1.3]]},
        {"slopes": [[0.07, -0.07, 0.03, 1.0, 0.0, 0.8]]},
        {"lanes": [[0.8, 0.2, 1.0, 0.0, 0.15, 0.15, 0.03, 1.0]]},
        {"magnets": [[0.8, 0.25, 0.12, 1.8, 1.5]]},
        {"tethers": [[0.1, 0.2, 0.4, 60.0, 0.5]]},
        {"fans": [[0.0, 1.0, -0.8, 0.12, 0.9, 1.0, 2.0, 0.3]]},
    ],
    ids=lambda concealed: next(iter(concealed), "waves"),
)
def test_the_step_is_finer_than_the_camera_sees(concealed):
    # At rest a camera of 30 Hz with 3 mm of noise sees an object for half a second: 3 mm / sqrt(15) = 0.8 mm.
    # A tenth of that, on top of it, is half a percent. On its way an object is seen once, to 3 mm.
    ground = Ground(UNEVEN, PATCHY).plus(**{name: np.array(rows) for name, rows in concealed.items()})
    rng = np.random.default_rng(3)
    for _ in range(4):
        state = rng.uniform([0, 0, -3, 0.7, -0.5, -8], [0.2, 0.3, 3, 2.2, 0.5, 8])
        fine, found = (slide(state, FRICTION, RADIUS, 1e-3, ground, step=s) for s in (2e-4, STEP))
        assert np.linalg.norm(found.rest[:2] - fine.rest[:2]) < 0.8e-3 / 10
        rows = min(len(found.track), len(fine.track))
        assert np.abs(found.track[:rows, :2] - fine.track[:rows, :2]).max() < 3e-3 / 10


def test_energy_is_conserved_without_friction():
    # v from central differences of the track, off by period^2 / 6 times the third derivative of x:
    # with |k| < 21 rad/m, slopes of 0.03 and 1.6 m/s about g 0.03 (21 * 1.6) = 10 m/s^3, so 2e-6 m/s.
    period = 1e-3
    track = np.empty((30_000, 3))
    _run(STATE, 0.0, 0.0, 0.0, RADIUS, 12, Ground(UNEVEN, PATCHY), 0.0, 2e-4, period, track)
    path = track[:2000]
    velocity = (path[2:, :2] - path[:-2, :2]) / (2 * period)
    height = np.array([value(UNEVEN, x, y) for x, y, _ in path[1:-1]])
    energy = (velocity**2).sum(1) / 2 + GRAVITY * height
    assert np.ptp(GRAVITY * height) > 1e-2  # there was something to exchange
    assert np.ptp(energy) < 2 * 1.6 * 2e-6 * 5
    assert np.allclose(np.diff(path[:, 2]), STATE[5] * period)  # and nothing stops the spin


def test_it_rests_only_where_it_is_held():
    # One long wave whose steepest slope is 0.5, at x = 0; friction holds up to 0.3.
    wave = np.array([[2.0, 0.0, 0.25, np.pi / 2]])
    friction = (0.3, 0.3, 0.005)
    slope, _ = gradient(wave, 0.0, 0.0)
    assert slope == pytest.approx(-0.5)
    gentle = np.array([0.7, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert abs(gradient(wave, gentle[0], 0.0)[0]) < 0.3
    stayed = slide(gentle, friction, RADIUS, 0.01, Ground(wave))
    assert stayed.duration == 0.0
    assert stayed.rest == pytest.approx(gentle[:3])
    # Let go where it is steep, or sent uphill from there: down it goes, and comes to rest further down.
    for velocity in (0.0, -0.2):
        result = slide(np.array([0, 0, 0, velocity, 0, 0]), friction, RADIUS, 0.01, Ground(wave))
        assert result.rest[0] > 0.3
        assert abs(gradient(wave, *result.rest[:2])[0]) < 0.3
        assert result.rest[1] == pytest.approx(0.0, abs=1e-6)


def test_what_never_rests_is_refused():
    with pytest.raises(InputError, match="still slides"):
        slide(STATE, (0.0, 0.0, 0.0), RADIUS, 0.01)


def test_patches_act_on_the_part_of_the_disc_that_is_on_them():
    # Friction grows towards +y, so that this side of a disc moving along x is held back: it turns there.
    log_friction = np.array([[0.0, 1.0, 1.0, -np.pi / 2]])  # sin(y)
    result = slide(np.array([0, 0, 0, 1.5, 0, 0]), FRICTION, RADIUS, 0.01, Ground(log_friction=log_friction))
    assert result.rest[2] > 1e-3


def test_track_ends_at_rest():
    result = slide(STATE, FRICTION, RADIUS, 0.01, Ground(UNEVEN))
    assert len(result.track) == int(result.duration / 0.01) + 1
    assert result.track[0] == pytest.approx(STATE[:3])
    assert np.linalg.norm(result.track[-1] - result.rest) < 0.01 * 0.35 * GRAVITY * 0.01
    finer = slide(STATE, FRICTION, RADIUS, 0.005, Ground(UNEVEN))
    assert finer.track[::2][: len(result.track)] == pytest.approx(result.track)
    assert finer.rest == pytest.approx(result.rest)


def test_on_an_even_board_it_differs_from_the_nominal_slide_by_less_than_can_be_seen():
    # Twelve points against three, another step and another rule. The camera sees 3 mm, in some ten frames
    # at rest; spins at launch are below 2 rad/s.
    rng = np.random.default_rng(2)
    states = rng.uniform([-1, -1, -3, 0.8, -0.5, -2], [1, 1, 3, 2.2, 0.5, 2], (20, 6))
    frictions = np.tile(FRICTION, (20, 1))
    nominal, _ = nominal_slide(states, frictions, RADIUS)
    for state, expected in zip(states, nominal, strict=True):
        result = slide(state, FRICTION, RADIUS, 0.01)
        assert np.linalg.norm(result.rest[:2] - expected[:2]) < 5e-4
        assert result.duration == pytest.approx(expected[3], abs=2e-3)
