"""For every effect a case whose outcome is known: a closed form where there is one, else a direction."""

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hitting import FRICTION, PADDLE, RADIUS, SOLREF, SPEED, addresses, arm_swing, edited, execute, push, slid
from slapshot.arrays import GRAVITY
from slapshot.effects import slide_law
from slapshot.effects.bases import BOARD
from slapshot.effects.catalogue import catalogue
from slapshot.effects.effect import Effect
from slapshot.errors import InputError
from slapshot.scenes.scene import Scene

MU = 0.3
_ANSWERED: set[str] = set()


def answers(name: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Marks the test that gives an effect's known answer."""
    _ANSWERED.add(name)
    return lambda test: test


def effect(name: str) -> Effect:
    return catalogue()[name]


def straight(name: str, speed: float = 1.5, heading: float = 0.0, x: float = 0.0, **values: float) -> float:
    """m that a disc slides without spin."""
    launch = [x, 0, 0, speed * np.cos(heading), speed * np.sin(heading), 0]
    return float(np.hypot(*(slid(effect(name), [launch], MU, **values).rests[0] - (x, 0))))


def changed_paddle(old: str, new: str) -> Scene:
    """PADDLE with another text in its MJCF."""
    assert PADDLE.xml.count(old) == 1
    return replace(PADDLE, xml=PADDLE.xml.replace(old, new))


def settled(model: mujoco.MjModel, joint: str, force: float, seconds: float = 1.0) -> mujoco.MjData:
    """The state after a force (N or N m) has pushed one joint for a while (s)."""
    data = mujoco.MjData(model)
    (address,) = addresses(model, [joint])[1]
    for _ in range(round(seconds / model.opt.timestep)):
        data.qfrc_applied[address] = force
        mujoco.mj_step(model, data)
    return data


def test_every_effect_has_one():
    assert set(catalogue()) == _ANSWERED


# --- Swing


@answers("command_delay")
@pytest.mark.parametrize("delay", [0.003, 0.0104])
def test_a_delay_shifts_targets_by_itself(delay):
    times = np.arange(200) * 1e-3
    ramp = np.stack([2 * times, -times], axis=1)
    expected = np.maximum(times - delay, 0)
    late = effect("command_delay").command({"delay": delay}, ramp, 1e-3)
    assert late == pytest.approx(np.stack([2 * expected, -expected], axis=1), abs=1e-12)


@answers("tracking_lag")
def test_a_low_pass_follows_a_ramp_by_its_time_constant():
    times = np.arange(400) * 1e-3
    lag = effect("tracking_lag")
    behind = times - lag.command({"time": 0.012}, times[:, None], 1e-3)[:, 0]
    # Of the differential equation: T (1 - exp(-t / T)) behind, from steady at the first target.
    assert behind == pytest.approx(0.012 * (1 - np.exp(-times / 0.012)), abs=1e-12)
    assert lag.command({"time": 0.05}, np.full((9, 1), 0.7), 1e-3) == pytest.approx(0.7, abs=1e-12)
    assert lag.command({"time": 1e-9}, times[:, None], 1e-3)[:, 0] == pytest.approx(times, abs=2e-9)


@answers("servo_gain")
def test_a_servo_yields_to_a_force_by_its_gain(scene):
    gain = scene.compile().actuator("q1").gainprm[0]
    for log_gain in (0.0, 0.5, -0.5):
        model = edited(scene, effect("servo_gain"), {"log_gain": log_gain})
        data = settled(model, "q1", 20.0)
        assert data.joint("q1").qpos[0] == pytest.approx(20 / (gain * np.exp(log_gain)), rel=1e-3)


def test_a_stiffer_servo_lags_less(scene):
    swing = arm_swing(scene)
    long_ago = execute(swing, effect("servo_gain"), log_gain=2.0).arm[:600]
    errors = [
        np.abs(execute(swing, effect("servo_gain"), log_gain=g).arm[:600] - long_ago).max()
        for g in (-0.5, 0.0, 0.5)
    ]
    assert errors[0] > errors[1] > errors[2]


@answers("joint_elasticity")
def test_links_twist_by_torque_and_motors_do_not_feel_it(scene):
    elastic = effect("joint_elasticity")
    model = edited(scene, elastic, {**elastic.neutral(), "twist_2": 0.02, "twist_6": 0.01})
    twisting = {model.joint(i).name for i in range(model.njnt) if model.joint(i).name.endswith("_twist")}
    assert twisting == {"q1_twist", "q5_twist"}
    for joint, at_limit, limit in (("q1", 0.02, 176), ("q5", 0.01, 38)):
        data = settled(model, f"{joint}_twist", 10.0)
        assert data.joint(f"{joint}_twist").qpos[0] == pytest.approx(10 * at_limit / limit, rel=1e-3)
        assert abs(data.joint(joint).qpos[0]) < 1e-5


@answers("backlash")
def test_a_link_can_be_moved_by_the_gap(scene):
    gap = 0.004
    model = edited(scene, effect("backlash"), {"gap": gap})
    for joint in ("q1", "q6"):
        ends = [settled(model, f"{joint}_play", torque).joint(f"{joint}_play").qpos[0] for torque in (-1, 1)]
        # Flanks yield a little: a fifth of the gap at most under this torque.
        assert ends[1] - ends[0] == pytest.approx(gap, rel=0.05)
        assert ends[0] == pytest.approx(-ends[1], rel=1e-3)


# --- Contact


@answers("compliant_blade")
def test_a_blade_turns_by_moment_and_swings_back_with_its_damping():
    compliance = 0.02
    model = edited(PADDLE, effect("compliant_blade"), {"compliance": compliance})
    model.opt.timestep = 1e-4
    data = mujoco.MjData(model)
    hinge, turns = model.joint("paddle_bend"), []
    for step in range(4000):
        data.qfrc_applied[hinge.dofadr[0]] = 0.5 if step < 2000 else 0.0
        mujoco.mj_step(model, data)
        turns.append(data.qpos[hinge.qposadr[0]])
    # Gravity pulls a bent paddle back with m g l = 0.1 9.81 0.03 of 50 N m/rad.
    assert turns[1999] == pytest.approx(0.5 * compliance, rel=2e-3)
    ratio = -min(turns[2000:]) / turns[1999]
    assert ratio == pytest.approx(np.exp(-np.pi * 0.2 / np.sqrt(1 - 0.2**2)), rel=0.01)


def test_a_blade_yields_backwards_at_its_lower_edge_and_gives_energy_back():
    blade = effect("compliant_blade")
    model = edited(PADDLE, blade, {"compliance": 0.02})
    data = mujoco.MjData(model)
    data.joint("paddle_bend").qpos[0] = 0.1
    mujoco.mj_kinematics(model, data)
    moved = data.geom("paddle").xpos - data.site("face").xpos
    assert moved[0] == pytest.approx(-0.03 * np.sin(0.1), rel=1e-9)
    assert moved[1] == pytest.approx(0, abs=1e-12)
    assert moved[2] == pytest.approx(0.03 * (1 - np.cos(0.1)), rel=1e-9)
    # The spring is less damped than the contact: the softer it is, the more it takes of the impact.
    speeds = [execute(push(), blade, 1e-4, compliance=c).speed for c in (0, 0.002, 0.005, 0.01, 0.02)]
    assert (np.diff(speeds) > 0).all()


def test_a_striker_that_points_straight_ahead_has_no_upper_edge():
    ahead = changed_paddle('name="face" pos', 'name="face" euler="0 1.5708 0" pos')
    with pytest.raises(InputError, match="points straight ahead"):
        edited(ahead, effect("compliant_blade"), {"compliance": 0.01})


@pytest.mark.parametrize("name", ["compliant_blade", "restitution", "blade_friction", "blade_yaw"])
def test_a_scene_without_striker_is_refused(name):
    alone = replace(PADDLE, info=replace(PADDLE.info, striker_pair=""))
    with pytest.raises(InputError, match="no contact pair"):
        edited(alone, effect(name), {p.name: p.scale for p in effect(name).parameters})


@answers("restitution")
@pytest.mark.parametrize("log_damping", [-1.0, -0.3, 0.0, 0.3, 0.7])
def test_the_rebound_is_that_of_spring_and_damper(log_damping):
    # The cart is heavy: the disc leaves at (1 + e) times its speed. MuJoCo's softness d = 0.9 to 0.95 takes
    # 1 - sqrt(d) of the damping ratio.
    z = SOLREF[1] * np.exp(log_damping) * np.sqrt(0.93)
    expected = np.exp(-2 * z * np.arccos(z) / np.sqrt(1 - z**2))
    speed = execute(push(), effect("restitution"), 1e-4, log_damping=log_damping).speed
    assert speed / SPEED - 1 == pytest.approx(expected, abs=0.02)


@answers("blade_friction")
def test_an_oblique_hit_spins_in_proportion_to_friction():
    # On a smooth board the disc slides along the turned paddle: its spin is mu J R / I, J the impulse across
    # the face and I = m R^2 / 2.
    quat = f"{np.cos(0.25)} 0 0 {np.sin(0.25)}"
    turned = push(changed_paddle('name="paddle"', f'name="paddle" quat="{quat}"'))
    spins = [execute(turned, effect("blade_friction"), log_factor=f).spin for f in (-0.4, 0.0, 0.4)]
    assert spins[1] != 0
    assert spins[0] / spins[1] == pytest.approx(np.exp(-0.4), rel=0.02)
    assert spins[2] / spins[1] == pytest.approx(np.exp(0.4), rel=0.02)


@answers("blade_yaw")
@pytest.mark.parametrize("angle", [0.5, -0.5])
def test_a_turned_blade_launches_along_its_normal_less_the_angle_of_friction(angle):
    # While the disc slides along the face, force and face normal make the angle of friction.
    course = execute(push(), effect("blade_yaw"), 1e-4, angle=angle)
    assert course.heading == pytest.approx(angle - np.sign(angle) * np.arctan(FRICTION), rel=0.02)
    assert course.model.site("face").quat == pytest.approx([1, 0, 0, 0])


def test_a_slightly_turned_blade_grips():
    # Disc and face stick: of the speed along the face V sin(a) the disc takes a third, the rest becoming spin
    # (I = m R^2 / 2), and across it (1 + e) V.
    angle = 0.04
    straight_on = execute(push(), effect("blade_yaw"), 1e-4)
    course = execute(push(), effect("blade_yaw"), 1e-4, angle=angle)
    share = SPEED / straight_on.speed / 3
    assert course.heading == pytest.approx(angle * (1 - share), rel=0.05)
    # MuJoCo's friction is soft: the face creeps along the disc before it holds it.
    assert course.spin == pytest.approx(2 / 3 * SPEED * angle / RADIUS, rel=0.15)


@answers("offcentre_mass")
def test_a_hit_beside_the_centre_of_mass_makes_it_spin():
    # J d = I w with I = m R^2 / 2 and J = m (speed of the centre of mass); the middle moves by w d more.
    d = 0.004
    smooth = changed_paddle(f'friction="{FRICTION} {FRICTION} ', 'friction="1e-5 1e-5 ')
    course = execute(push(smooth), effect("offcentre_mass"), 1e-4, offset_y=d)
    centre = course.velocity[-1, 0] - course.spin * d
    assert course.spin == pytest.approx(2 * centre * d / RADIUS**2, rel=0.03)


# --- Slide


@answers("linear_drag")
def test_linear_drag_shortens_a_slide_as_integrated():
    # dv/dt = -mu g - r v
    r, v, a = 0.8, 1.5, MU * GRAVITY
    assert straight("linear_drag", v, rate=r) == pytest.approx(
        v / r - a / r**2 * np.log1p(r * v / a), rel=1e-4
    )


@answers("quadratic_drag")
def test_quadratic_drag_shortens_a_slide_as_integrated():
    # v dv/dx = -mu g - k v^2
    k, v = 0.7, 1.5
    expected = np.log1p(k * v**2 / (MU * GRAVITY)) / (2 * k)
    assert straight("quadratic_drag", v, per_length=k) == pytest.approx(expected, rel=1e-4)


@answers("stribeck_friction")
def test_stribeck_friction_shortens_a_slide_as_integrated():
    # v dv/dx = -mu g (1 + r exp(-(v / s)^2))
    r, s, v = 0.8, 0.5, 1.5
    expected = s**2 / (2 * MU * GRAVITY) * np.log((np.exp((v / s) ** 2) + r) / (1 + r))
    distance = straight("stribeck_friction", v, rise=r, log_speed=np.log(s))
    assert distance == pytest.approx(expected, rel=1e-3)


@answers("tilt")
@pytest.mark.parametrize("axis", ["x", "y"])
def test_a_tilt_pushes_downhill(axis):
    slope, v = 0.04, 1.2
    heading = {"x": 0.0, "y": np.pi / 2}[axis]
    for sign in (1, -1):
        distance = straight("tilt", v, heading, **{f"slope_{axis}": sign * slope})
        assert distance == pytest.approx(v**2 / (2 * GRAVITY * (MU + sign * slope)), rel=1e-4)


@answers("turned_anisotropy")
def test_friction_is_larger_along_the_diagonal():
    for heading, sign in ((np.pi / 4, 1), (-np.pi / 4, -1)):
        distance = straight("turned_anisotropy", 1.2, heading, cross=0.2)
        assert distance == pytest.approx(1.2**2 / (2 * GRAVITY * MU * np.exp(0.2 * sign)), rel=1e-4)


@answers("curl")
@pytest.mark.parametrize(
    ("spin", "log_spin", "rate"),
    [
        pytest.param(2.0, 4.0, 0.25 * 2.0, id="in proportion to the angle spun"),
        pytest.param(50.0, -0.5, 0.25 * np.exp(-0.5), id="no faster beyond the spin where it levels off"),
    ],
)
def test_curl_turns_the_path(monkeypatch, spin, log_spin, rate):
    monkeypatch.setattr(slide_law, "LONGEST", 0.5)
    # Friction hardly acts: heading' = strength spin, or strength w_s where spin is far larger than w_s.
    tracks = slid(
        effect("curl"), [[0, 0, 0, 1.0, 0, spin]], 1e-4, duration=0.4, strength=0.25, log_spin=log_spin
    )
    step = np.diff(tracks.places[0], axis=0)
    rows = np.flatnonzero(tracks.times[:-1] < 0.4)
    heading = np.arctan2(step[rows, 1], step[rows, 0])
    middle = tracks.times[rows] + (tracks.times[1] - tracks.times[0]) / 2
    assert heading == pytest.approx(rate * middle, abs=2e-3)


MIDDLE = len(BOARD) // 2


def middle_bump(x: np.ndarray) -> np.ndarray:
    """The bump in the middle of the board, along y = 0."""
    return np.exp(-((x - BOARD.axes[0][BOARD.counts[0] // 2]) ** 2) / (2 * BOARD.width**2))


@answers("uneven_board")
def test_a_hill_takes_the_energy_that_its_height_costs():
    height, v = 0.03, 1.6
    x = BOARD.axes[0][BOARD.counts[0] // 2] - 0.5
    d = straight("uneven_board", v, x=x, **{f"height_{MIDDLE}": height})
    begin, end = height * middle_bump(np.array([x, x + d]))
    assert GRAVITY * (MU * d + end - begin) == pytest.approx(v**2 / 2, rel=1e-3)
    assert abs(end - begin) > 0.005


@answers("place_friction")
def test_a_rough_place_takes_energy_along_the_path():
    amount, v = 0.8, 1.6
    x = BOARD.axes[0][BOARD.counts[0] // 2] - 0.3
    d = straight("place_friction", v, x=x, **{f"log_friction_{MIDDLE}": amount})
    along = np.linspace(x, x + d, 4001)
    factor = np.exp(amount * middle_bump(along))
    assert MU * GRAVITY * np.trapezoid(factor, along) == pytest.approx(v**2 / 2, rel=1e-3)


@answers("friction_drift")
def test_the_last_hit_has_the_factor_more_friction_than_the_first():
    launches = [[0, 0, 0, 1.2, 0, 0]] * 3
    rests = slid(effect("friction_drift"), launches, MU, (-0.5, 0, 0.5), log_change=0.4).rests[:, 0]
    assert rests[0] / rests[2] == pytest.approx(np.exp(0.4), rel=1e-4)
    assert rests[1] == pytest.approx(1.2**2 / (2 * MU * GRAVITY), rel=1e-4)
    bent = slid(effect("friction_drift"), launches, MU, (-0.5, 0, 0.5), log_change=0.4, bend=0.1).rests[:, 0]
    np.testing.assert_allclose(rests / bent, [1, np.exp(0.1), 1], rtol=1e-4)


def test_an_offcentre_disc_turns_about_its_centre_of_mass(monkeypatch):
    monkeypatch.setattr(slide_law, "LONGEST", 0.5)
    # Friction hardly acts, and the centre of mass stays where it is.
    offset = (0.004, -0.003)
    launch = [0, 0, 0, 10.0 * offset[1], -10.0 * offset[0], 10.0]
    tracks = slid(
        effect("offcentre_mass"), [launch], 1e-5, duration=0.3, offset_x=offset[0], offset_y=offset[1]
    )
    assert np.hypot(*(tracks.places[0] - offset).T) == pytest.approx(0.005, rel=1e-3)


# --- Camera

FOOT = np.array([1.0, -0.5])
PLACES = np.array([[[1.5, -0.5], [1.0, 0.5]]])


def seen(name: str, **values: float) -> np.ndarray:
    """Where the camera sees PLACES, from its foot."""
    given = {**effect(name).neutral(), **values}
    return effect(name).see({k: np.array([v]) for k, v in given.items()}, PLACES, FOOT)[0] - FOOT


@answers("camera_rotation")
def test_places_turn_about_the_foot():
    c, s = np.cos(0.1), np.sin(0.1)
    assert seen("camera_rotation", angle=0.1) == pytest.approx(np.array([[0.5 * c, 0.5 * s], [-s, c]]))
    # About another point: the turn of that point about the foot is a shift.
    pivot, turn = np.array([0.12, -0.07]), np.array([[c, -s], [s, c]])
    shift = pivot - turn @ pivot
    about_pivot = pivot + (PLACES[0] - FOOT - pivot) @ turn.T
    assert seen("camera_rotation", angle=0.1, shift_x=shift[0], shift_y=shift[1]) == pytest.approx(
        about_pivot
    )


@answers("camera_scale")
def test_places_move_away_from_the_foot():
    assert seen("camera_scale", log_scale=0.2) == pytest.approx(np.exp(0.2) * (PLACES[0] - FOOT))
    assert seen("camera_scale", shift_x=0.01) == pytest.approx(PLACES[0] - FOOT + [0.01, 0])


@answers("lens_distortion")
def test_far_places_move_by_the_cube_of_their_distance():
    assert seen("lens_distortion", radial=0.02) == pytest.approx(
        np.array([[0.5 + 0.02 * 0.5**3, 0], [0, 1.02]])
    )
    # About a middle of its own, which itself is seen where it is.
    assert seen("lens_distortion", radial=0.02, middle_x=0.5)[0] == pytest.approx([0.5, 0])


@answers("camera_time")
def test_the_clock_is_late_by_the_delay():
    assert effect("camera_time").camera_delay({"delay": np.array([0.01, -0.02])}) == pytest.approx(
        [0.01, -0.02]
    )
    assert seen("camera_time", delay=0.1) == pytest.approx(PLACES[0] - FOOT)
