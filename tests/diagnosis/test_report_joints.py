"""The report of a diagnosis of joints, held to rules that are told from its files and from closed forms."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import mujoco
import numpy as np
import pandas as pd
import pytest
from rerun.chunk import RrdReader
from slapshot import plotting
from slapshot.diagnosis import outputs
from slapshot.diagnosis.diagnose import Diagnosis, diagnose
from slapshot.diagnosis.model.rig import bind
from slapshot.diagnosis.outputs import write_outputs
from slapshot.diagnosis.report.markdown import markdown
from slapshot.diagnosis.report.motion import Motion, predicted_motion, recorded_motion
from slapshot.diagnosis.report.outcome import Outcome, coordinates
from slapshot.diagnosis.report.presentation import (
    between,
    headline,
    noise_text,
    phrase_of,
    quantity,
    rivals_text,
    scaled,
)
from slapshot.diagnosis.report.residuals import added_force, binned, by_variable, misfit, variables
from slapshot.diagnosis.report.terminal import terminal_text
from slapshot.diagnosis.verdict import (
    ChannelNoise,
    Errors,
    Fits,
    Interval,
    Limit,
    Location,
    Mismatch,
    NamedEffect,
    NamedParameter,
    Unknown,
    Verdict,
    read_verdict,
    versioned,
)
from slapshot.plotting import STAND_IN
from slapshot.progress import Steps
from slapshot.recordings.signal_quality import quality_warning_lines, signal_warnings
from slapshot.recordings.signal_statistics import all_channel_statistics
from slapshot.recordings.signals import SignalRecording
from waiting import HANG_S

from .mechanisms import BRICK, PENDULUM, control_channel, joint, place, recording, simulate

FRICTION, PUSH = 0.25, 1.5  # N m
NOISE = 5e-4  # rad
EPISODES, SECONDS, INTERVAL = 6, 2.0, 0.01
VERSIONS = {"code": "abc", "model": "def"}
FIGURES = ("J1-predictions", "J2-residuals", "J3-errors", "J4-candidates")


class Made(NamedTuple):
    """A diagnosis and its report."""

    diagnosis: Diagnosis
    recording: SignalRecording
    folder: Path
    problems: tuple[str, ...]

    @property
    def verdict(self):
        return versioned(self.diagnosis.verdict, VERSIONS)

    @property
    def text(self):
        return (self.folder / "verdict.md").read_text()

    @property
    def outcome(self):
        return Outcome.of(self.diagnosis, self.verdict, self.recording)


def swings(friction: float, seed: int, pushed: int | None = None) -> SignalRecording:
    """A pendulum under a motor, with dry friction; in one episode it is pushed for a fifth of a second."""

    def push(time: float, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        return np.full(1, PUSH * (0.72 <= time < 0.92))

    rng = np.random.default_rng(seed)
    t = np.arange(0, SECONDS, INTERVAL)
    text = PENDULUM.replace('damping="0.05"', f'damping="0.05" frictionloss="{friction}"')
    model = mujoco.MjModel.from_xml_string(text)
    angles, torques = [], []
    for episode in range(EPISODES):
        waves = zip(rng.normal(0, 2.5, 3), (0.4, 0.9, 1.7), rng.uniform(0, 6, 3), strict=True)
        torque = np.sum([a * np.sin(2 * np.pi * f * t + phase) for a, f, phase in waves], axis=0)
        law = push if episode == pushed else None
        qpos, *_ = simulate(model, t, torque[:, None], [rng.normal(0, 0.3)], [0.0], law=law)
        angles.append(qpos[:, 0] + rng.normal(0, NOISE, len(t)))
        torques.append(torque)
    return recording(
        [t] * EPISODES,
        {"angle": (joint("swing"), angles), "torque": (control_channel(actuator="drive"), torques)},
    )


@pytest.fixture(scope="session")
def made(tmp_path_factory):
    """Reports of pendulums: with friction that the model lacks, pushed, as the model has it, and at rest."""
    found = {}
    still = np.arange(0, SECONDS, INTERVAL)
    rest = recording(
        [still] * EPISODES,
        {
            "angle": (joint("swing"), [0 * still] * EPISODES),
            "torque": (control_channel(actuator="drive"), [0 * still] * EPISODES),
        },
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(plotting._STYLE, "savefig.dpi", 50)  # pixels take longer than all the rest
        for name, recorded in {
            "friction": swings(FRICTION, 1),
            "pushed": swings(0.0, 3, pushed=1),
            "nothing": swings(0.0, 2),
            "rest": rest,
        }.items():
            rig = bind(mujoco.MjSpec.from_string(PENDULUM), recorded.channels, recorded.rig)
            diagnosis = diagnose(recorded, rig, findings=["a gap | in *time*"] if name == "nothing" else [])
            folder = tmp_path_factory.mktemp(name)
            problems = write_outputs(diagnosis, versioned(diagnosis.verdict, VERSIONS), recorded, folder)
            found[name] = Made(diagnosis, recorded, folder, problems)
    return found


# --- Rules that hold for any report


def numbers_of(value):
    """All numbers in a document of JSON."""
    if isinstance(value, dict):
        return [n for part in value.values() for n in numbers_of(part)]
    if isinstance(value, list):
        return [n for part in value for n in numbers_of(part)]
    return [float(value)] if isinstance(value, int | float) and not isinstance(value, bool) else []


def texts_of(value):
    """All texts in a document of JSON, keys among them."""
    if isinstance(value, dict):
        return [*value, *(t for part in value.values() for t in texts_of(part))]
    if isinstance(value, list):
        return [t for part in value for t in texts_of(part)]
    return [value] if isinstance(value, str) else []


CONSTANTS = {90, 95, 0.5, 0.01, 20}  # intervals, limits, windows, what counts as missing, rivals


def invented(text: str, verdict: dict) -> list[str]:
    """Numbers of a page that verdict.json does not hold, in any unit that a prefix or percent makes."""
    page = re.sub(r"\\(.)", r"\1", text.split("\n## Figures")[0].split("\n## Versions")[0]).lower()
    for said in sorted(texts_of(verdict), key=len, reverse=True):
        if re.search(r"[a-z].*\d|\d.*[a-z]", said):
            page = page.replace(said.lower(), "")
    known = np.array(numbers_of(verdict))
    wrong = []
    for match in re.finditer(r"(?<![\w.])[-−]?\d+(?:\.\d+)?(?:e[-+]\d+)?", page):
        shown = match[0].replace("−", "-")
        value = float(shown)
        mantissa, _, power = shown.partition("e")
        step = 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2]))
        if "." not in shown and abs(value) >= 1000:
            step = 10.0
        held = [np.abs(f * known - value) <= 0.501 * step for f in (1, 1e2, 1e3, 1e6)]
        if value not in CONSTANTS and not np.any(held):
            wrong.append(match[0])
    return wrong


@pytest.mark.parametrize("name", ["friction", "pushed", "nothing", "rest"])
def test_every_number_on_the_page_is_in_the_verdict(made, name):
    text, verdict = made[name].text, json.loads((made[name].folder / "verdict.json").read_text())
    assert invented(text, verdict) == []
    assert not re.search(r"\b(nan|inf|None)\b", text)


def test_an_invented_number_is_seen(made):
    text, verdict = made["friction"].text, json.loads((made["friction"].folder / "verdict.json").read_text())
    assert "| 0.25" in text or "| 0.24" in text
    assert invented(re.sub(r"\| 0\.2\d+", "| 0.3713", text), verdict) == ["0.3713"]


@pytest.mark.parametrize("name", ["friction", "nothing", "rest"])
def test_the_page_agrees_with_the_verdict(made, name):
    report = made[name]
    verdict, text = read_verdict(report.folder), report.text
    assert verdict == report.verdict
    starts = {
        "found": "# Something is missing: Coulomb friction at swing",
        "nothing_found": "# Nothing found",
        "cannot_tell": "# Cannot tell",
    }
    expected = {"friction": "found", "nothing": "nothing_found", "rest": "cannot_tell"}[name]
    assert verdict.headline == expected
    assert text.startswith(starts[expected])
    assert ("**Yes.**" in text) == (expected == "found")
    assert ("**No.**" in text) == (expected == "nothing_found")
    assert ("Upper limits of effects" in text) == bool(verdict.limits)
    assert STAND_IN in text
    assert STAND_IN not in markdown(verdict.model_copy(update={"stand_in": False}))
    for finding in verdict.findings:
        assert finding[1:] in re.sub(r"\\(.)", r"\1", text)
    for figure in re.findall(r"!\[[^]]*\]\(([^)]*)\)", text):
        assert (report.folder / figure).is_file()


@pytest.mark.parametrize("name", ["friction", "nothing", "rest"])
def test_the_terminal_gets_some_short_lines(made, name):
    verdict = made[name].verdict
    lines = terminal_text(verdict).splitlines()
    assert lines[0] == headline(verdict)
    assert 5 <= len(lines) <= 15
    assert max(map(len, lines)) < 110
    assert STAND_IN in lines[1]


@pytest.mark.parametrize("name", ["friction", "nothing"])
def test_figures_show_something_and_have_their_numbers_beside_them(made, name):
    assert made[name].problems == ()
    for figure in FIGURES:
        pixels = plt.imread(made[name].folder / f"{figure}.png")[..., :3]
        ink = np.mean(np.any(np.abs(pixels - pixels[0, 0]) > 0.1, axis=-1))
        assert ink > 0.02, figure
        table = pd.read_csv(made[name].folder / f"{figure}.csv")
        assert len(table)
        assert f"({figure}.png)" in made[name].text
        shown = set(table.get("model", []))
        assert ("augmented" in shown) == (name == "friction" and figure != "J4-candidates")


def test_what_cannot_be_told_has_no_figures(made):
    assert {file.name for file in made["rest"].folder.iterdir()} == {"verdict.json", "verdict.md"}


def test_a_part_that_fails_costs_nothing_else(made, tmp_path, monkeypatch):
    def fail(*_):
        raise ValueError("no ink\nleft")

    monkeypatch.setattr(outputs.error_figure, "draw", fail)
    monkeypatch.setattr(outputs, "write_augmented", fail)
    monkeypatch.setitem(plotting._STYLE, "savefig.dpi", 30)
    report = made["friction"]
    problems = write_outputs(report.diagnosis, report.verdict, report.recording, tmp_path)
    assert problems == tuple(
        f"{part} could not be written (ValueError: no ink left)" for part in ("J3-errors", "augmented")
    )
    kept = {file.name for file in tmp_path.iterdir()}
    assert {f"{figure}.png" for figure in FIGURES} - kept == {"J3-errors.png"}
    assert {"verdict.json", "recording.rrd"} <= kept
    assert "augmented" not in kept
    text = (tmp_path / "verdict.md").read_text()
    assert "J3-errors could not be written" in text
    assert "](J3-errors.png)" not in text
    assert "(augmented)" not in text


def test_the_augmented_model_has_the_friction(made):
    report = made["friction"]
    model = mujoco.MjModel.from_xml_path(str(report.folder / "augmented" / "model.xml"))
    (effect,) = report.verdict.effects
    np.testing.assert_allclose(model.dof_frictionloss, [effect.parameters[0].value], rtol=1e-6)
    assert "(augmented)" in report.text
    assert not (made["nothing"].folder / "augmented").exists()


# --- What figures and the Rerun recording are made from


def test_missing_torque_is_the_friction(made):
    outcome = made["friction"].outcome
    (swing,) = coordinates(outcome.rig.model)
    speed = variables(outcome, swing)["velocity"]
    found = misfit(outcome, "nominal")
    left = misfit(outcome, "augmented")
    added = added_force(outcome)
    (effect,) = outcome.verdict.effects
    value = effect.parameters[0].value
    for way in (-1, 1):
        own = way * speed > 0.5
        assert own.sum() > 50
        edges = np.sort(way * np.array([0.5, 50.0]))
        (row,) = binned(speed, found.force[:, 0], found.segment, edges).to_dict("records")
        # Twice the half-width of the 90 % interval: 3.3 standard errors.
        assert abs(row["value"] + way * FRICTION) < (row["high"] - row["low"])
        assert row["high"] - row["low"] < FRICTION
        (row,) = binned(speed, left.force[:, 0], left.segment, edges).to_dict("records")
        assert abs(row["value"]) < (row["high"] - row["low"]) + 0.02 * FRICTION
        # An interval of implicit steps has damping, inertia and gravity in it, too.
        np.testing.assert_allclose(np.median(added[own, 0]), -way * value, rtol=0.01)


def test_nothing_is_made_up_where_nothing_was_found(made):
    assert added_force(made["nothing"].outcome) is None


def test_binned_means_and_their_intervals():
    """Three segments of two samples: mean and standard error of three means by the textbook."""
    at = np.tile([0.2, 0.8], 3)
    value = np.array([1.0, 3.0, 2.0, 6.0, 6.0, 0.0])
    segment = np.repeat([0, 1, 2], 2)
    (row,) = binned(at, value, segment, np.array([0.0, 1.0])).to_dict("records")
    means = np.array([2.0, 4.0, 3.0])
    half = 1.645 * means.std(ddof=1) / np.sqrt(3)
    np.testing.assert_allclose([row["at"], row["value"]], [0.5, 3.0])
    np.testing.assert_allclose([row["low"], row["high"]], [3 - half, 3 + half])
    value[2] = np.nan
    assert binned(at[:4], value[:4], segment[:4], np.array([0.0, 1.0])).empty
    (row,) = binned(at[:4], value[:4], segment[:4], np.array([0.0, 1.0]), fewest=1).to_dict("records")
    np.testing.assert_allclose([row["value"], row["low"], row["high"]], [(1 + 3 + 6) / 3, np.nan, np.nan])


def test_over_the_time_of_a_single_episode_means_have_no_intervals(made):
    """No two of its segments meet in a bin; several episodes do."""
    outcome = made["friction"].outcome
    found = misfit(outcome, "nominal")
    (swing,) = coordinates(outcome.rig.model)
    segments = outcome.search.nominal.problem.segments
    one = np.flatnonzero(segments.episode == segments.episode[0])
    alone = replace(found, force=np.where(np.isin(found.segment, one)[:, None], found.force, np.nan))
    for of, spread in ((found, True), (alone, False)):
        table = by_variable(outcome, swing, "time", lambda one: one.force[:, 0], {"nominal": of})
        assert len(table) > 3
        assert np.isfinite(table["value"]).all()
        assert np.isfinite(table[["low", "high"]]).to_numpy().all() == spread


def test_refitted_values_that_predict_worse_are_said_to():
    said = (
        "Refitted, the nominal model's free parameters predict joint position worse than as they were given"
    )
    assert said not in markdown(FOUND)
    worse = fits(nominal=0.031, refitted=0.33, augmented=0.004, noise_floor=0.001)
    assert said in markdown(FOUND.model_copy(update={"fit": worse}))
    # Without free parameters nothing was refitted.
    assert said not in markdown(FOUND.model_copy(update={"fit": worse, "nominal_parameters": []}))


def test_motion_that_is_drawn_is_that_which_was_predicted_and_recorded(made):
    outcome = made["friction"].outcome
    every = np.arange(outcome.windows.shape[0])
    for model_name in outcome.by_model:
        motion = predicted_motion(outcome, model_name, every)
        # To a tenth of what can be seen at all, the noise.
        np.testing.assert_allclose(motion.seen, outcome.predictions(model_name).predicted, atol=0.1 * NOISE)
        np.testing.assert_allclose(motion.qpos, motion.seen, atol=1e-9)
        recorded = recorded_motion(motion, outcome.recorded)
        np.testing.assert_allclose(recorded.qpos, outcome.recorded, atol=1e-9)


def test_free_bodies_are_moved_to_where_they_were_recorded():
    """Places and quaternions of either sign; gaps are bridged."""
    t = np.arange(0, 0.5, 0.01)
    qpos, *_ = simulate(BRICK, t, np.zeros((50, 0)), [0, 0, 1, 1, 0, 0, 0], [1, 2, 3, 4, 5, 6], finer=1)
    axes = ("x", "y", "z", "qw", "qx", "qy", "qz")
    channels = {axis: (place("body", "brick", axis), qpos[:, k]) for k, axis in enumerate(axes)}
    rig = bind(mujoco.MjSpec.from_string(BRICK), recording(t, channels).channels)
    rng = np.random.default_rng(0)
    seen = qpos + rng.normal(0, 1e-3, qpos.shape)
    seen[:, 3:] /= np.linalg.norm(seen[:, 3:], axis=1, keepdims=True)
    model = Motion(rig, seen[None].copy(), seen[None])
    recorded = qpos.copy()
    recorded[20:, 3:] *= -1
    recorded[30] = np.nan
    found = recorded_motion(model, recorded[None]).qpos[0]
    there = np.arange(50) != 30
    np.testing.assert_allclose(found[there], qpos[there], atol=1e-9)
    # Between neighbours: the error that a gap may leave is that of the model, not of a missing value.
    assert np.abs(found[30] - qpos[30]).max() < 0.01


@pytest.mark.parametrize("name", ["friction", "pushed", "nothing"])
def test_the_rerun_recording_can_be_opened_and_holds_every_motion(made, name):
    assert made[name].problems == ()
    file = made[name].folder / "recording.rrd"
    command = [sys.executable, "-m", "rerun", "rrd", "verify", str(file)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=HANG_S, check=False)
    assert done.returncode == 0, done.stderr
    paths = {str(path) for path in RrdReader(file).store().schema().entity_paths()}
    for motion in ("recorded", "nominal", *(["augmented"] if name != "nothing" else [])):
        assert {f"/rig/{motion}/rod", f"/rig/{motion}/rod/inertia", f"/readings/angle/{motion}"} <= paths
    assert ("/errors/angle/augmented" in paths) == (name != "nothing")


def test_a_push_is_on_the_page_with_its_time(made):
    (effect,) = made["pushed"].verdict.effects
    assert (effect.name, effect.part) == ("external_pulse", "swing")
    assert "of episode 1" in effect.variant
    assert effect.variant in made["pushed"].text
    # Of windows of 50 ms, those at its ends hold parts of it; its impulse is that of 0.2 s.
    begin, end = map(float, re.findall(r"[0-9.]+(?= to| s of)", effect.variant))
    (size,) = effect.parameters
    assert size.value * (end - begin) == pytest.approx(0.2 * PUSH, rel=0.1)
    assert size.low < PUSH < size.high
    verdict = made["pushed"].verdict
    assert verdict.headline == "found"
    assert not verdict.unknown.flagged
    assert (verdict.location.part, verdict.location.follows) == ("swing", "time")
    assert "push" in verdict.mismatch.strongest


# --- Verdicts that are rare, made by hand


def fits(**values: float) -> Fits:
    def errors(value: float, likelihood: float | None) -> Errors:
        interval = Interval(value=value, low=0.9 * value, high=1.2 * value, unit="rad")
        return Errors(rms={"joint position": interval}, log_likelihood=likelihood)

    return Fits(**{name: errors(v, None if name == "noise_floor" else 12.5) for name, v in values.items()})


def parameter(name: str, value: float, unit: str, state: str = "moved") -> NamedParameter:
    return NamedParameter(name=name, value=value, low=0.9 * value, high=1.1 * value, unit=unit, state=state)


BACKLASH = NamedEffect(
    name="backlash",
    part="elbow",
    variant="read at the motor",
    phrase="backlash of joint elbow",
    gain_nats=41.3,
    rivals={"joint_elasticity@elbow (read at the motor)": 1.7, "viscous_friction@elbow": 2.9},
    parameters=[parameter("half_gap", 0.0123, "rad"), parameter("damping", 0.5, "N m s/rad", "flat")],
)
FOUND = Verdict(
    headline="found",
    reason="the named effects leave a mismatch that no effect explains",
    rig="arm | 7",
    stand_in=False,
    episodes=4,
    seconds=81.5,
    held_out_episodes=[1, 3],
    cannot_tell=None,
    findings=["clock main has gaps: 7.0% of samples are missing", *(f"odd thing {k}" for k in range(4))],
    mismatch=Mismatch(found=True, p_value=0.001, strongest="lag of motor"),
    location=Location(
        part="elbow", follows="load", size=Interval(value=0.37, low=0.37, high=0.37, unit="N m")
    ),
    effects=[BACKLASH],
    nominal_parameters=[
        BACKLASH.model_copy(
            update={
                "name": "link_mass",
                "phrase": "mass of lower",
                "variant": "",
                "rivals": {},
                "gain_nats": 0.0,
            }
            | {"part": "lower", "parameters": [parameter("excess", 0.0342, "1", "at a bound")]}
        )
    ],
    unknown=Unknown(flagged=True, p_value=0.002, description="best described as a force at wrist over time"),
    fit=fits(nominal=0.031, refitted=0.02, augmented=0.004, noise_floor=0.001),
    noise={
        f"q{k}": ChannelNoise(white=2.1e-4, coloured=8.7e-5 * k, correlation_s=0.041, unit="rad")
        for k in range(3)
    },
    limits=[],
    converged=True,
    cpu_s=77.0,
    versions={},
)
UNNAMED = FOUND.model_copy(
    update={
        "headline": "found_not_named",
        "effects": [],
        "reason": "something is missing, and no effect of the catalogue explains it",
    }
)
NOTHING = FOUND.model_copy(
    update={
        "headline": "nothing_found",
        "reason": "no test says that anything is missing",
        "effects": [],
        "location": None,
        "mismatch": Mismatch(found=False, p_value=0.4, strongest="lag of motor"),
        "unknown": Unknown(flagged=False, p_value=0.4, description=""),
        "limits": [
            Limit(effect="viscous_friction@elbow", parameter="coefficient", limit=0.0173, unit="N m s/rad")
        ],
    }
)
UNTOLD = FOUND.model_copy(
    update={
        "headline": "cannot_tell",
        "cannot_tell": "only 3 segments were recorded; record longer",
        "effects": [],
        "nominal_parameters": [],
        "noise": {},
        "seconds": 0.0,
        "held_out_episodes": [],
    }
    | dict.fromkeys(("mismatch", "location", "unknown", "fit"))
)


@pytest.mark.parametrize("verdict", [FOUND, UNNAMED, NOTHING, UNTOLD], ids=lambda v: v.headline)
def test_rare_verdicts_keep_the_rules(verdict):
    verdict = Verdict(**verdict.model_dump())  # still one
    text = markdown(verdict, {"J1-predictions": "Windows."})
    assert text.startswith(f"# {headline(verdict)}\n")
    assert invented(text, json.loads(verdict.model_dump_json())) == []
    assert "stand-in" not in text
    lines = terminal_text(verdict).splitlines()
    assert 5 <= len(lines) <= 20
    assert max(map(len, lines)) < 110
    said = verdict.headline
    assert ("**Yes.**" in text) == (said in ("found", "found_not_named"))
    assert ("**No.**" in text) == (said == "nothing_found")
    assert ("noise floor" in text) == (said != "cannot_tell")
    assert ("model with what was found" in text) == (said == "found")
    assert ("Nothing is named" in text) == (said == "found_not_named")
    assert ("no name explains" in text) == (said in ("found", "found_not_named"))


def test_rivals_states_and_free_parameters_are_told():
    text = re.sub(r"\\(.)", r"\1", markdown(FOUND))
    assert headline(FOUND) == (
        "Something is missing: backlash of joint elbow (read at the motor), and something that no name "
        "explains"
    )
    assert (
        "cannot distinguish it from elasticity of joint elbow (read at the motor) (1.7 nats worse) or "
        "viscous friction at elbow (2.9 nats worse)" in text
    )
    assert "| half gap | 12.3 mrad (11.1 to 13.5) |" in text
    assert "The data hardly narrow down damping" in text
    assert "| mass of lower | excess | 3.42 % (3.08 to 3.76) |" in text
    assert "At its physical bound: excess" in text
    assert "Parts of episodes 1 and 3 took no part" in text
    assert "| viscous friction at elbow | coefficient | 17.3 mN m s/rad |" in markdown(NOTHING)


def test_many_pushes_are_counted_in_the_headline():
    push = BACKLASH.model_copy(update={"name": "external_pulse", "phrase": "a push from outside at elbow"})
    few = FOUND.model_copy(update={"effects": [BACKLASH, push, push, push]})
    assert headline(few).count("a push from outside at elbow") == 3
    many = FOUND.model_copy(update={"effects": [push, BACKLASH, push, push, push]})
    assert headline(many).startswith(f"Something is missing: {BACKLASH.phrase}")
    assert "and 4 pushes" in headline(many)
    assert "from outside" not in headline(many)


def test_of_a_push_with_knots_the_largest_force_is_told():
    """The others are in verdict.json: on the page there would be dozens of rows."""
    own = [("push_0 at 1.20 s", 0.5), ("push_0 at 2.10 s", 9.0), ("push_0 at 3.00 s", 1.5), ("push_1", 4.0)]
    push = BACKLASH.model_copy(
        update={"name": "external_pulse", "parameters": [parameter(name, v, "N") for name, v in own]}
    )
    found = FOUND.model_copy(update={"effects": [push]})
    page, lines = re.sub(r"\\(.)", r"\1", markdown(found)), " ".join(terminal_text(found).split())
    assert "| push 0, largest at 2.10 s | 9.0 N (8.1 to 9.9) |" in page
    assert "push 0, largest at 2.10 s 9.0 N (8.1 to 9.9); push 1 4.00 N (3.60 to 4.40)" in lines
    assert "| push 1 | 4.00 N (3.60 to 4.40) |" in page
    assert "1.20 s" not in page + lines
    said = "comes and goes: `verdict.json` lists its force at evenly spaced times"
    assert said in page
    assert said not in markdown(FOUND)


def test_what_else_a_law_is_called_is_told():
    other = "Coulomb friction of 0.8 N m and a constant offset of -0.4 N m"
    found = FOUND.model_copy(update={"effects": [BACKLASH.model_copy(update={"same_as": other})]})
    assert f"This is the same as {other}." in re.sub(r"\\(.)", r"\1", markdown(found))
    assert f"same as    {other}" in terminal_text(found)
    assert "same as" not in terminal_text(FOUND) + markdown(FOUND)


def test_errors_above_the_noise_floor_are_explained_where_nothing_is_left():
    said = "still lie above the noise floor"
    assert said in markdown(NOTHING)
    assert said not in markdown(FOUND)  # something is left
    low = fits(nominal=0.0012, refitted=0.0012, augmented=0.0012, noise_floor=0.001)
    assert said not in markdown(NOTHING.model_copy(update={"fit": low}))


def test_names_from_outside_cannot_break_the_page():
    text = markdown(FOUND.model_copy(update={"rig": "a\x1b[31m | <b>", "findings": ["x\n# y"]}))
    assert "\x1b" not in text
    assert "<b>" not in text
    assert "\n# y" not in text
    assert "\x1b" not in terminal_text(FOUND.model_copy(update={"rig": "a\x1b[31m"}))


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.0123, "rad", "12.3 mrad"),
        (0.25, "N m", "0.25 N m"),
        (2.5e-5, "s", "25 µs"),
        (0.02, "kg", "20 g"),
        (0.02, "kg m^2", "20 g m²"),
        (0.031, "1", "3.1 %"),
        (0.002, "m/s", "2 mm/s"),
        (0.004, "rad/(N m)", "4 mrad/(N m)"),
        (0.05, "1/rad", "0.05 1/rad"),
        (0.0, "N m", "0 N m"),
        (12.0, "N s^2/m^2", "12 N s²/m²"),
    ],
)
def test_numbers_have_readable_units(value, unit, text):
    assert quantity(value, unit) == text
    readable, factor = scaled(unit, value)
    assert text == f"{factor * value:.3g} {readable}".rstrip()


def test_noise_that_grows_is_told():
    noise = ChannelNoise(white=2e-3, coloured=0.0, correlation_s=0.05, unit="rad", growth=1.46)
    assert noise_text(noise) == "2 mrad white, 1.46 times as much at the session's end as at its beginning"


def test_parts_of_quaternions_are_no_shares():
    noise = ChannelNoise(white=0.001, coloured=0.0, correlation_s=0.05, unit="1")
    assert noise_text(noise) == "0.001 white"
    unit = {"joint position": Interval(value=0.02, low=0.02, high=0.02, unit="1")}
    same = Errors(rms=unit, log_likelihood=None)
    fit = Fits(nominal=same, refitted=same, augmented=same, noise_floor=same)
    assert "| joint position |" in markdown(NOTHING.model_copy(update={"fit": fit}))


def test_windows_that_are_left_out_are_told_where_the_errors_are():
    said = ", without 3 further windows in which something pushes"
    few = FOUND.fit.model_copy(update={"windows": 37, "windows_left_out": 3})
    for written in (markdown, terminal_text):
        assert said in " ".join(written(FOUND.model_copy(update={"fit": few})).split())
        assert "further window" not in written(FOUND)


def test_intervals_have_the_digits_that_they_deserve():
    assert (
        between(Interval(value=0.2496, low=0.2485, high=0.2508, unit="N m"))
        == "0.2496 N m (0.2485 to 0.2508)"
    )
    assert between(Interval(value=0.02, low=-0.01, high=0.05, unit="s")) == "20 ms (-10 to 50)"
    assert between(Interval(value=3.0, low=3.0, high=3.0, unit="N")) == "3 N"


def test_keys_become_phrases():
    assert phrase_of("coulomb_friction@swing") == "Coulomb friction at swing"
    assert phrase_of("backlash@a b (read at the link)") == "backlash of joint a b (read at the link)"
    assert phrase_of("base_compliance") == "compliance of the base"
    assert phrase_of("my_effect@swing") == "my effect@swing"


# --- Progress and findings


def test_steps_are_lines_where_there_is_no_terminal(capsys):
    with Steps() as steps:
        steps("fitting")
        steps("pre\x1bdicting")
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(" s  ")[1] for line in lines] == ["fitting", "pre\\x1bdicting"]
    assert all(float(line.split(" s  ")[0]) >= 0 for line in lines)


def test_steps_are_one_line_on_a_terminal(monkeypatch, capsys):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    with Steps() as steps:
        steps("fitting [a]")
        assert steps._line.tasks[0].description == "fitting [a]"
    assert steps._line.finished is False
    assert not steps._line.live.is_started


def test_findings_are_those_of_the_check():
    good = swings(0.0, 3)
    table = good.signals["encoder"]
    gap = table[(table["t"] < 0.5) | (table["t"] > 1.2)]
    bad = SignalRecording(**{**vars(good), "signals": {"encoder": gap}})
    found = quality_warning_lines(bad)
    assert found == [str(finding) for finding in signal_warnings(bad, all_channel_statistics(bad))]
    assert any("gaps" in line for line in found)
    assert all("\n" not in line for line in found)


def test_a_rival_that_explains_more_by_more_parameters_is_not_called_worse():
    text = rivals_text({"friction_drift@elbow": -28.5, "viscous_friction@elbow": 0.1})
    assert "friction at elbow that drifts over the session (28.5 nats better, by more parameters)" in text
    assert "viscous friction at elbow (0.1 nats worse)" in text
