"""Recordings with commands, made with the simulator itself: effects of the contact, there and not there."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import mujoco
import numpy as np
import pandas as pd
import pytest
from slapshot.arrays import GRAVITY
from slapshot.command import Run
from slapshot.diagnosis.pucks.diagnose import diagnose
from slapshot.diagnosis.pucks.launch import signatures as signatures_module
from slapshot.diagnosis.pucks.launch.approach import (
    SAME_START,
    Approaches,
    CommandedArms,
    resting_height,
)
from slapshot.diagnosis.pucks.launch.rig_model import RigModel
from slapshot.diagnosis.pucks.launch.signatures import LOOK, make_signatures
from slapshot.diagnosis.pucks.launch.strikes import (
    TIMESTEP,
    Striker,
    _as_if_sliding,
    commands_through,
)
from slapshot.diagnosis.pucks.launch.swing_error import LATENESS, JointLateness
from slapshot.diagnosis.pucks.report import REST_FIGURES, write_report
from slapshot.diagnosis.pucks.result import Setting
from slapshot.diagnosis.pucks.slide.slide_model import Point
from slapshot.diagnosis.pucks.slide.tracks import hit_tracks
from slapshot.effects.catalogue import catalogue
from slapshot.effects.slide_law import slide
from slapshot.lab.commands import Pool
from slapshot.recordings.format import ObjectInfo, Recording
from slapshot.trajectories import demonstrations

HITS, DURATION, RATE = 40, 0.6, 50.0
FRICTION = (0.35, 0.32, 0.005)
CAMERA = np.array([1.65, 0.0])
NAMES = ("blade_yaw", "restitution", "tilt")
KNOWN = {name: catalogue()[name] for name in NAMES}
DELAY = catalogue()["command_delay"]
TRUE_YAW = 0.05  # rad
READ_AT = np.array([0.0, 0.3, 0.7])  # s, when joints are looked at: at first, on the way, after the hit
POOL = {
    "domain": "hockey", "seed": 5, "count": HITS, "heading_rad": 1.2, "speed_m_s": [0.8, 2.0],
    "contact_offset_m": 0.04, "duration_s": DURATION, "waypoints": 17,
}  # fmt: skip


@pytest.fixture(scope="module")
def commands(scene, tmp_path_factory):
    """Tables of t and joint positions, one a hit."""
    folder = tmp_path_factory.mktemp("pool")
    (folder / "scene").mkdir()
    scene.save(folder / "scene")
    demonstrations.produce(Run(POOL, {"scene": folder / "scene"}, folder, 2))
    pool = Pool.load(folder / "demonstrations.parquet", HITS, DURATION, len(scene.info.joints))
    times = np.arange(round(DURATION * 100) + 1) / 100
    return [np.column_stack([times, motion.position(times)]) for motion in pool.motions]


@pytest.fixture(scope="module")
def signatures(scene, commands):
    end = DURATION + 0.1
    return make_signatures(scene, commands_through(commands, scene, end), KNOWN, 2)


@pytest.fixture(scope="module")
def record(scene, commands):
    """Effects and seed -> a recording of the hits that the simulator makes of the commands."""

    def made(effects, seed):
        rng = np.random.default_rng(seed)
        acting = [(KNOWN[name], values) for name, values in effects.items()]
        held = commands_through(commands, scene, DURATION + 0.6)
        start = np.tile(np.array(scene.info.start), (HITS, 1))
        mass, friction = np.full(HITS, 0.1), np.tile(FRICTION, (HITS, 1))

        def strike(releases):
            return Striker(scene, held, releases, mass, friction, np.zeros(1), 2).strike(start, acting)

        contact = strike(np.full(HITS, DURATION + 0.5)).contact
        release = contact + 0.08
        released = strike(release).released
        released[:, 2:4] *= 1 + rng.normal(0, 0.01, (HITS, 1))
        launches = np.column_stack([released[:, :2], np.zeros(HITS), released[:, 2:]])
        tracks = slide(launches, friction, scene.info.object_radius, 6.0)
        frames = []
        for i in range(HITS):
            t = np.arange(0.01, release[i] + tracks.durations[i] + 0.5, 1 / RATE)
            places = tracks.at(np.tile(t - release[i], (HITS, 1)))[i]
            share = np.clip((t - contact[i]) / (release[i] - contact[i]), 0, 1)[:, None]
            before = start[i] + share * (launches[i, :2] - start[i])
            seen = np.where((t < release[i])[:, None], before, places) + rng.normal(0, 0.003, (len(t), 2))
            frames.append(pd.DataFrame({"hit": i, "t": t, "x": seen[:, 0], "y": seen[:, 1], "yaw": np.nan}))
        hits = pd.DataFrame(
            {
                "hit": np.arange(HITS),
                "object_id": "puck",
                "order": np.arange(HITS),
                "recorded_at": pd.Series(pd.NaT, index=range(HITS), dtype="datetime64[us, UTC]"),
                "command_id": pd.array(np.arange(HITS), dtype="Int64"),
                "start_x": start[:, 0],
                "start_y": start[:, 1],
                "rest_x": tracks.rests[:, 0],
                "rest_y": tracks.rests[:, 1],
                "latent": None,
            }
        )
        columns = ["t", *(f"q{j}" for j in range(len(scene.info.joints)))]
        told = pd.concat(
            [pd.DataFrame(c, columns=columns).assign(hit=i) for i, c in enumerate(commands)],
            ignore_index=True,
        )
        objects = {"puck": ObjectInfo(shape="cylinder", size_m=(0.07, 0.0254), mass_kg=0.1, mass_sd_kg=0.001)}
        table = pd.concat(frames, ignore_index=True)
        return Recording(
            "rig", objects, RATE, "here", True, None, "", None, hits, table, told[["hit", *columns]], None
        )

    return made


@pytest.fixture(scope="module")
def verdict_of(scene, signatures):
    setting = Setting(scene.info.object_radius, CAMERA, (0.5, 0.5, 0.01), scene)

    def told(recording):
        return diagnose(recording, setting, effects=KNOWN, threads=2, signatures=signatures)

    return told


@pytest.fixture(scope="module")
def turned(record):
    return record({"blade_yaw": {"angle": TRUE_YAW}}, 1)


def test_changes_about_a_slug_are_central_differences_without_the_scatter_of_contact():
    """Launches that bend with a value, and scatter from simulation to simulation: the slope comes out."""
    rng, count, sd = np.random.default_rng(2), 300, 0.1
    simulated = np.column_stack(
        [rng.normal(size=(count, 2)), rng.uniform(1, 2, count), rng.normal(0, 0.3, count)]
    )
    simulated = np.column_stack([simulated, np.zeros(count)])
    slope = simulated[:, 2:3] * np.array([0.1, 0.2, 0.3, 0.4, 0.5])
    parameter = next(p for p in catalogue()["offcentre_mass"].parameters if p.name == "log_inertia")

    def released_at(owner, name, value):
        return slope * (value + 2 * value**2) + rng.normal(0, sd, (count, 5))

    rig = SimpleNamespace(
        _base={"offcentre_mass": {"log_inertia": 0.0}},
        _struck=SimpleNamespace(released=simulated),
        _approach=rng.normal(size=(count, 2)),
        _released_at=released_at,
    )
    rig._smoothed = partial(RigModel._smoothed, rig)
    found = RigModel._local_change(rig, "offcentre_mass", parameter)
    step = found.there - found.here
    # Of 14 features 300 hits leave a share of 14 / 300 of the variance, of half a difference of two.
    error = sd / np.sqrt(2) * np.sqrt(14 / count)
    assert np.sqrt(np.mean((found.change - step * slope) ** 2)) < 1.5 * error
    assert np.sqrt(np.mean((step * slope) ** 2)) > 5 * error


def test_how_far_an_object_has_turned_is_what_it_spun_since(scene, commands):
    """Between two moments of free sliding: the integral of the spin, by the trapezium rule."""
    held = commands_through(commands, scene, DURATION + 0.6)
    start, friction = np.tile(np.array(scene.info.start), (HITS, 1)), np.tile(FRICTION, (HITS, 1))
    slug = [(catalogue()["offcentre_mass"], {"offset_x": -0.005, "offset_y": 0.006, "log_inertia": -0.4})]

    def strike(releases):
        striker = Striker(scene, held, releases, np.full(HITS, 0.1), friction, np.zeros(1), 2)
        return striker.strike(start, slug)

    contact = strike(np.full(HITS, DURATION + 0.5)).contact
    assert np.abs(strike(contact - 0.02).turned).max() < 1e-3
    moments = 0.08 + 0.005 * np.arange(9)
    struck = [strike(contact + moment) for moment in moments]
    spun = np.trapezoid([one.released[:, 4] for one in struck], moments, axis=0)
    # Contacts with the board change the spin within some milliseconds.
    np.testing.assert_allclose(struck[-1].turned - struck[0].turned, spun, atol=0.03 * np.abs(spun).max())
    assert np.abs(struck[0].turned).max() > 0.05


def test_near_a_slug_launches_change_with_its_inertia_as_simulated(scene, commands, record, monkeypatch):
    """What inertia does to a launch depends on where the centre of mass is: alone it does nothing."""
    monkeypatch.setattr(signatures_module, "TWO_SIDED", (-1.5, 1.5))  # few sizes are simulated faster
    known = {"offcentre_mass": catalogue()["offcentre_mass"]}
    pool = make_signatures(scene, commands_through(commands, scene, DURATION + 0.1), known, 2)
    recording = record({}, 4)
    friction = np.array([FRICTION])
    rig = RigModel(recording, hit_tracks(recording), scene, known, CAMERA, friction, pool, 2)
    rows = np.arange(len(hit_tracks(recording)))
    slug = {"offset_x": -0.012, "offset_y": 0.006, "log_inertia": -0.4}

    def launches(values, fitted=False):
        return rig.about({"offcentre_mass": values}).launches(rows, fitted=fitted)

    def means(model, values):
        effects = {"offcentre_mass": values} if values else {}
        return model.means(Point(np.zeros((len(rows), 6)), np.log(friction), effects))

    # The derivative is of a step the other way: what is left is curvature and the scatter of contact.
    lighter = slug | {"log_inertia": -0.8}
    simulated = means(launches(lighter), lighter)

    def along(change):
        """Root mean square of changes (n, 5) in the velocity along x."""
        return np.sqrt((change[:, 2] ** 2).mean())

    change = along(simulated - means(launches(slug), slug))
    assert along(means(launches(slug, fitted=True), lighter) - simulated) < 0.6 * change
    assert along(means(launches(slug), lighter) - simulated) > 0.9 * change
    # A point without the slug has the launch of the nominal scene, wherever hits were simulated.
    np.testing.assert_allclose(
        means(launches(slug, fitted=True), None), means(launches(slug), None), atol=1e-12
    )


def test_joints_that_are_late_by_times_of_their_own_are_simulated_so(scene, commands, record, signatures):
    """Encoders with 1 mrad of noise fit to it about the true times, and nearly so to first order."""
    late = {f"late_{j}": float(t) for j, t in enumerate(np.linspace(-0.01, 0.01, len(scene.info.joints)))}
    held = commands_through(commands, scene, DURATION + 0.6)
    times = np.arange(round(DURATION * 100) + 1) / 100
    start, friction = np.tile(np.array(scene.info.start), (HITS, 1)), np.tile(FRICTION, (HITS, 1))
    striker = Striker(scene, held, np.full(HITS, DURATION), np.full(HITS, 0.1), friction, times, 2)
    read = striker.strike(start, [(JointLateness(), late)]).joints
    read = read + np.random.default_rng(3).normal(0, 1e-3, read.shape)
    columns = [f"q{j}" for j in range(read.shape[2])]
    joints = pd.concat(
        [pd.DataFrame(q, columns=columns).assign(hit=i, t=times) for i, q in enumerate(read)],
        ignore_index=True,
    )
    recording = replace(record({}, 4), joints=joints[["hit", "t", *columns]])
    known = {"blade_yaw": KNOWN["blade_yaw"], LATENESS: JointLateness()}
    tracks = hit_tracks(recording)
    rows = np.arange(len(tracks))
    rig = RigModel(recording, tracks, scene, known, CAMERA, np.array([FRICTION]), signatures, 2)
    there = rig.about({LATENESS: late}).launches(rows)
    nominal = rig.launches(rows, there.execution)  # whose own would take the times for scatter

    def squares(model, effects):
        residual, _ = model.encoder_rows([], Point(np.zeros((len(rows), 6)), np.log([FRICTION]), effects))
        return (residual**2).sum() / model.encoders.readings / len(rows)

    nothing, told = squares(nominal, {}), squares(nominal, {LATENESS: late})
    assert squares(there, {LATENESS: late}) == pytest.approx(1, abs=0.1)
    assert told < 1.5
    assert nothing > 3


def test_an_object_that_is_struck_late_is_looked_at_late(scene, commands):
    """A delay of whole control periods shifts the swing: the launch is the one without it, told earlier.

    It is longer than LOOK after the contact, so that at the nominal moment nothing was struck yet.
    """
    period = scene.info.control_period
    delay = round(1.4 * LOOK / period) * period
    held = commands_through(commands, scene, DURATION + 4 * LOOK)
    start = np.tile(np.array(scene.info.start), (HITS, 1))
    mass, friction = np.full(HITS, 0.1), np.tile(FRICTION, (HITS, 1))

    def striker(releases):
        return Striker(scene, held, releases, mass, friction, np.zeros(1), 2)

    contact = striker(np.full(HITS, DURATION + 0.1)).strike(start).contact
    at = striker(contact + LOOK)
    nominal, late = (at.strike(start, effects, contact) for effects in ([], [(DELAY, {"delay": delay})]))
    assert late.contact == pytest.approx(contact + delay, abs=period)
    slowing = GRAVITY * np.mean(FRICTION[:2])
    speed = np.linalg.norm(nominal.released[:, 2:4], axis=1)
    told = np.linalg.norm(late.released[:, 2:4], axis=1)
    # Contact doubles what rounding makes of the same swing: the median of hits is what counts.
    assert np.median(np.abs(told - speed - slowing * delay)) < 0.01
    way = np.linalg.norm(late.released[:, :2] - nominal.released[:, :2], axis=1)
    assert np.median(np.abs(way - (speed * delay + slowing * delay**2 / 2))) < 0.002


def test_a_launch_is_the_same_whenever_it_is_looked_at(scene, commands):
    """But for what friction does in between, though simulated objects hop all the time."""
    held = commands_through(commands, scene, DURATION + 4 * LOOK)
    contact = _striker(scene, held, np.full(HITS, DURATION + 0.1)).strike(_starts(scene, HITS)).contact
    early, later = 0.06, 0.14
    first, last = (
        _striker(scene, held, contact + after).strike(_starts(scene, HITS)).released
        for after in (early, later)
    )
    between = later - early
    speed = np.linalg.norm(first[:, 2:4], axis=1)
    along = first[:, 2:4] / speed[:, None]
    slowing = GRAVITY * np.linalg.norm(np.array(FRICTION[:2]) * along, axis=1)
    # Friction that differs along x and y turns the way a little, which counts in no length.
    assert np.linalg.norm(last[:, 2:4], axis=1) == pytest.approx(speed - slowing * between, abs=1e-3)
    way = np.einsum("nd,nd->n", last[:, :2] - first[:, :2], along)
    assert way == pytest.approx(speed * between - slowing * between**2 / 2, abs=2e-4)


@pytest.fixture
def some(scene, commands):
    """Effects or approaches that are there already -> a striker of a few hits; what it strikes."""
    few = commands_through(commands[:3], scene, DURATION + 0.2)
    contact = _striker(scene, few, np.full(3, DURATION + 0.1)).strike(_starts(scene, 3)).contact

    def struck(effects=(), approaches=None, shift=0.0):
        striker = _striker(scene, few, contact + LOOK, approaches)
        return striker.strike(_starts(scene, 3) + shift, effects)

    return few, contact, struck


def _striker(scene, held, releases, approaches=None):
    count = len(releases)
    hits = releases, np.full(count, 0.1), np.tile(FRICTION, (count, 1))
    return Striker(scene, held, *hits, READ_AT, 1, approaches)


def _starts(scene, count):
    return np.tile(np.array(scene.info.start), (count, 1))


def test_an_arm_that_first_moves_alone_strikes_as_in_one_simulation_of_both(scene, some):
    few, contact, struck = some
    hits = struck()
    info = scene.info
    for i in range(3):
        model = scene.compile(TIMESTEP)
        pair = model.pair(info.object_pair)
        pair.friction[:3] = FRICTION[1], FRICTION[0], FRICTION[2]
        data = mujoco.MjData(model)
        arm, puck = ([data.joint(name) for name in names] for names in (info.joints, info.object_joints))
        for joint, angle in zip(arm, few.positions[i, 0], strict=True):
            joint.qpos = angle
        begin, substeps = np.array(info.start), round(few.period / TIMESTEP)
        read, states = [], []
        for tick in range(round(READ_AT[-1] / few.period) + 1):
            read.append([float(joint.qpos[0]) for joint in arm])
            x, y, turn = (puck[k] for k in (0, 1, 3))
            hop = puck[2].qpos[0] - resting_height(model, info), puck[2].qvel[0]
            states.append([x.qpos[0], y.qpos[0], x.qvel[0], y.qvel[0], turn.qvel[0], *hop])
            data.ctrl[: len(arm)] = few.targets[i, min(tick, few.targets.shape[1] - 1)]
            mujoco.mj_step(model, data, substeps)
        ticks = np.arange(len(states)) * few.period
        looked = np.array([np.interp(contact[i] + LOOK, ticks, column) for column in np.array(states).T])
        launch = np.array([[*(begin + looked[:2]), *looked[2:5]]])
        hop = looked[5:6], looked[6:]
        # Rounding, which a contact enlarges.
        told = _as_if_sliding(launch, *hop, np.array([FRICTION[:2]]))
        np.testing.assert_allclose(hits.released[i], told[0], atol=1e-8)
        at = np.round(READ_AT / few.period).astype(int)
        np.testing.assert_allclose(hits.joints[i], np.array(read)[at], atol=1e-9)


def test_what_leaves_the_arm_alone_shares_its_approach(some, monkeypatch):
    made = []

    def counted(arms):
        made.append(approach(arms))
        return made[-1]

    approach = CommandedArms.approach
    monkeypatch.setattr(CommandedArms, "approach", counted)
    _, _, struck = some
    approaches, effects = Approaches(), catalogue()
    for name, values in (
        ("blade_friction", {"log_factor": 0.5}),
        ("restitution", {"log_damping": 0.5}),
        ("offcentre_mass", {"offset_x": 0.005, "offset_y": 0.0, "log_inertia": -0.3}),
    ):
        acting = [(effects[name], values)]
        apart, shared = struck(acting), struck(acting, approaches)
        np.testing.assert_allclose(shared.released, apart.released, atol=1e-9)
    near, far = 0.5 * SAME_START, 2 * SAME_START
    np.testing.assert_allclose(
        struck((), approaches, near).released, struck((), None, near).released, atol=1e-9
    )
    made.clear()
    struck((), approaches)
    assert not made
    struck((), approaches, far)
    struck([(effects["servo_gain"], {"log_gain": 0.2})], approaches)
    assert len(made) == 2


def test_a_turned_blade_is_named_with_its_angle_and_better_rest_points(turned, verdict_of):
    found = verdict_of(turned)
    verdict = found.verdict
    (effect,) = verdict.effects
    assert effect.name == "blade_yaw"
    assert (verdict.location.phase, verdict.location.variable) == ("contact", effect.variable)
    (angle,) = effect.parameters
    assert angle.value == pytest.approx(TRUE_YAW, abs=0.01)
    refitted, augmented = (verdict.fit[name].command_rest_rmse_m for name in ("refitted", "augmented"))
    assert augmented.high < refitted.low
    assert found.signatures is not None
    assert all(hit.like_hit in set(turned.hits["hit"]) for hit in verdict.next_hits)


def test_nothing_is_named_where_the_contact_is_as_believed(record, verdict_of):
    verdict = verdict_of(record({}, 2)).verdict
    assert not verdict.mismatch.found
    assert verdict.effects == ()


def test_rest_points_and_commands_alone_tell_a_turned_blade(turned, verdict_of, tmp_path):
    found = verdict_of(replace(turned, tracks=None))
    verdict = found.verdict
    assert verdict.kind == "rest points only"
    assert "blade_yaw" in verdict.effects[0].members
    assert verdict.fit["augmented"].track_rmse_m is None
    assert any("record" in note or "tracks" in note for note in verdict.notes)
    write_report(found, {}, tmp_path)
    assert {file.stem for file in tmp_path.glob("*.png")} == {module.NAME for module in REST_FIGURES}
    rests = pd.read_csv(tmp_path / "D1-rests.csv")
    apart = np.hypot(rests["x_m"] - rests["predicted_x_m"], rests["y_m"] - rests["predicted_y_m"])
    before, after = (apart[rests["scene"] == scene].mean() for scene in ("refitted", "augmented"))
    assert after < before
    told = (tmp_path / "verdict.md").read_text()
    assert "rest from command RMSE" in told
    assert "track RMSE" not in told


def test_signatures_without_a_parameter_of_today_are_made_again(signatures):
    """As those of an older catalogue, whose launches would silently not follow it."""
    assert signatures.holds(KNOWN)
    kept = {name: sizes for name, sizes in dict(signatures.values).items() if "yaw" not in name}
    older = replace(signatures, values=kept)
    assert not older.holds(KNOWN)
    assert older.holds({name: e for name, e in KNOWN.items() if name != "blade_yaw"})
