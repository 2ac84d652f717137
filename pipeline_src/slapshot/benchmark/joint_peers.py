"""`python -m slapshot.benchmark.joint_peers`: masses of an arm, fitted by mujoco.sysid and by the diagnosis.

Both get the same recordings of the stand-in arm, the same model, and the masses of two links to fit. In one
scenario a mass is wrong, so that fitting masses suffices; in the other, one joint has friction that the model
lacks, which no mass can explain. mujoco.sysid simulates whole episodes from given initial states, for which
the estimates of the diagnosis are used. The score is the prediction error on held-out windows, predicted from
data before them.
"""

import argparse
import os
import sys
import time
from collections.abc import Mapping
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pandas as pd

from slapshot.arrays import Array
from slapshot.benchmark.peers import need_sysid
from slapshot.diagnosis.diagnose import Diagnosis, diagnose
from slapshot.diagnosis.held_out_split import split
from slapshot.diagnosis.held_out_validation import predict_windows
from slapshot.diagnosis.model.rig import Rig, bind
from slapshot.diagnosis.model.segments import Segments, segment_recording
from slapshot.diagnosis.selection.problem import Problem
from slapshot.diagnosis.selection.steps import nominal_motion, nominal_step
from slapshot.effects.joints.catalogue import instances
from slapshot.errors import InputError, writing
from slapshot.lab.joints.record_case import make_case
from slapshot.lab.joints.rigs import nominal_model
from slapshot.progress import progress
from slapshot.recordings.signals import SignalRecording
from slapshot.text import markdown_table
from slapshot.whole_file import write_whole

RIG, LINKS = "arm", ("upper", "fore")
SCENARIOS = {"a mass is off": "link_mass", "friction is missing": "coulomb_friction"}
SEEDS = (11, 12, 13, 14, 15)
SIZE = 10.0  # of the hidden effect, relative to the encoders' noise
EPISODES, SECONDS = 10, 3.0
BOUNDS = (-0.9, 3.0)  # of the relative excess of a mass
LEVEL = 0.1  # significance level of 90 % intervals
NAME = "joint_peers"
_ROUNDING = 1e-12

INTRODUCTION = f"""# Beside mujoco.sysid

{len(SEEDS)} recordings a scenario of a stand-in arm of three joints (simulated; no real robot), {EPISODES}
episodes of {SECONDS:g} s, encoders with noise of 1 mrad. Both tools fit the masses of two links, {LINKS[0]}
and {LINKS[1]}. In the first scenario the mass of one is off (its inertia too, by another power than both
tools assume); in the second a joint has dry friction, which the model does not.

Held-out errors are of windows of 0.5 s that no fit has seen; the floor is what noise alone would leave.
Medians, lowest and highest of the recordings. Seconds are of one core, wall clock, in one run; slapshot's fit
includes noise levels and the test whether anything is missing, its diagnosis the search for what it is.
"""


def compare(scenario: str, seed: int) -> list[dict[str, Any]]:
    """Result rows of both tools on one recording.

    Args:
        scenario: of `SCENARIOS`.
        seed: of the recording.
    """
    recording, truth = make_case(
        RIG, (SCENARIOS[scenario],), seed, size=SIZE, episodes=EPISODES, seconds=SECONDS
    )
    free = tuple(f"link_mass@{link}" for link in LINKS)
    rig = bind(mujoco.MjSpec.from_string(nominal_model(RIG)), recording.channels, RIG, free)
    used, _ = split(segment_recording(recording, rig))
    began = time.perf_counter()
    problem = Problem.of(rig, recording.channels, used)
    masses = tuple(e for key in free for e in instances(problem.rig_motion) if e.key == key)
    trajectory = nominal_step(
        nominal_motion(problem, masses), np.random.default_rng(seed)
    ).scored.fit.trajectory
    fit_seconds = time.perf_counter() - began
    began = time.perf_counter()
    peer, half_widths = fit_by_sysid(recording, rig, used, trajectory[used.first == 0, 0])
    peer_seconds = time.perf_counter() - began
    began = time.perf_counter()
    found = diagnose(recording, rig, seed=seed)
    seconds = time.perf_counter() - began
    if found.search is None or found.windows is None or found.augmented is None or found.refitted is None:
        raise InputError(f"{scenario}, seed {seed}: the diagnosis cannot tell ({found.verdict.cannot_tell})")
    first = found.search.nominal
    by_peer = predict_windows(first, peer, first.problem, found.windows, fitted=False)
    columns, own = np.arange(len(rig.observations)), first.scored.fit
    common = {"scenario": scenario, "seed": seed, "truth": _told(truth)}
    common["floor_mrad"] = 1e3 * found.augmented.predictions.rms_floor(columns)
    rows = [
        {
            "tool": "mujoco.sysid", "seconds": peer_seconds, "values": peer, "half_widths": half_widths,
            "error_mrad": 1e3 * by_peer.predictions.rms(columns), "says": "",
        },
        {
            "tool": "slapshot, masses alone", "seconds": fit_seconds, "values": own.theta,
            "half_widths": 1.645 * own.sd,
            "error_mrad": 1e3 * found.refitted.predictions.rms(columns),
            "says": f"p = {first.test.p_value:.2g}",
        },
        {
            "tool": "slapshot, diagnosis", "seconds": seconds, **_final(found, free),
            "error_mrad": 1e3 * found.augmented.predictions.rms(columns), "says": _says(found),
        },
    ]  # fmt: skip
    flat = []
    for row in rows:
        values, widths = row.pop("values"), row.pop("half_widths")
        for link, value, width in zip(LINKS, values, widths, strict=True):
            row |= {f"{link}_excess": float(value), f"{link}_half_width": float(width)}
        flat.append(common | row)
    return flat


def fit_by_sysid(recording: SignalRecording, rig: Rig, used: Segments, starts: Array) -> tuple[Array, Array]:
    """Relative excess of link masses by least squares over episodes, and half-widths of 90 % intervals.

    Args:
        recording: all episodes.
        rig: nominal rig.
        used: segments of the episodes to fit.
        starts: (episodes, nq + nv) initial states, in the order of `used`.

    Raises:
        InputError: mujoco.sysid's extra is not installed.
    """
    sysid = need_sysid()
    spec = mujoco.MjSpec.from_string(nominal_model(RIG))
    for observation in rig.observations:
        spec.add_sensor(
            name=observation.channel,
            type=mujoco.mjtSensor.mjSENS_JOINTPOS,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            objname=observation.part,
        )
    model = spec.compile()
    names, states, controls, sensors = [], [], [], []
    for episode, x in zip(used.episode[used.first == 0], starts, strict=True):
        states.append(sysid.create_initial_state(model, x[: model.nq], x[model.nq : model.nq + model.nv]))
        u, step = used.controls[episode], model.opt.timestep
        # mujoco.sysid resamples to a whole number of steps: keep rounding from adding one.
        controls.append(sysid.TimeSeries(np.arange(len(u)) * step * (1 - _ROUNDING), u))
        table = recording.signals[recording.channels[rig.observations[0].channel].clock]
        own = table[table["episode"] == used.ids[episode]]
        y = own[[observation.channel for observation in rig.observations]].to_numpy(float)
        # mujoco.sysid stamps the readings at the beginning of a step with the time of its end.
        sensors.append(sysid.TimeSeries.from_names(own["t"].to_numpy(float) + step, y, model))
        names.append(f"episode {used.ids[episode]}")
    parameters = sysid.ParameterDict()
    for link in LINKS:
        parameters.add(sysid.Parameter(link, 0.0, *BOUNDS, modifier=_scaled(spec, link)))
    sequences = sysid.ModelSequences(RIG, spec, names, states, controls, sensors)
    residual = sysid.build_residual_fn(models_sequences=[sequences], n_threads=1)
    with redirect_stdout(StringIO()):  # it prints a line per iteration
        found, result = sysid.optimize(parameters, residual, optimizer="mujoco", verbose=False)
    residuals, *_ = residual(result.x, found)
    _, widths = sysid.calculate_intervals(residuals, result.jac, alpha=LEVEL)
    return np.array([found[link].value[0] for link in LINKS]), np.asarray(widths, float).ravel()


def _scaled(spec: mujoco.MjSpec, link: str) -> Any:
    """Function that scales mass and inertia of a link in a spec; the link has one geom, with a mass."""
    nominal = float(spec.body(link).first_geom().mass)

    def scale(changed: mujoco.MjSpec, parameter: Any) -> None:
        changed.body(link).first_geom().mass = nominal * (1 + parameter.value[0])

    return scale


def _final(found: Diagnosis, free: tuple[str, ...]) -> Mapping[str, Any]:
    """Values of the masses in the final fit of a diagnosis."""
    assert found.search is not None
    fit = found.search.final.scored.fit
    keys = [effect.key for effect in fit.hypothesis.effects]
    picked = [fit.hypothesis.slices[keys.index(key)].start for key in free]
    return {"values": fit.theta[picked], "half_widths": 1.645 * fit.sd[picked]}


def _says(found: Diagnosis) -> str:
    verdict = found.verdict
    named = ", ".join(f"{effect.name}@{effect.part}" for effect in verdict.effects)
    unknown = verdict.unknown is not None and verdict.unknown.flagged
    return verdict.headline + (f": {named}" if named else "") + (", something is left" if unknown else "")


def _told(truth: Mapping[str, Any]) -> str:
    return "; ".join(
        f"{one['kind']}@{one['joint'] or one['body']} "
        + ", ".join(f"{name} {p['value']:.3g}" for name, p in one["parameters"].items())
        for one in truth["concealed"]
    )


def write_comparison(rows: pd.DataFrame, folder: Path) -> None:
    """Write joint_peers.csv and joint_peers.md."""
    lines = []
    for (scenario, tool), own in rows.groupby(["scenario", "tool"], sort=False):
        error = own["error_mrad"] / own["floor_mrad"]
        lines.append((str(scenario), str(tool), _spread(own["seconds"]), _spread(error)))
    head = ("scenario", "tool", "seconds", "held-out error over the floor")
    each = ("scenario", "truth", "tool", "excess of the masses (half-width of 90 %)", "says")
    told = [
        (row["scenario"], row["truth"], row["tool"], _masses(row), row["says"])
        for row in rows.to_dict("records")
    ]
    text = [INTRODUCTION, markdown_table(head, lines), "\n## Each recording\n", markdown_table(each, told)]
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(folder / f"{NAME}.csv", rows.to_csv(index=False, float_format="%.6g"))
        write_whole(folder / f"{NAME}.md", "\n".join(text) + "\n")


def _masses(row: Mapping[Any, Any]) -> str:
    return "; ".join(
        f"{link} {row[f'{link}_excess']:+.3f} ({row[f'{link}_half_width']:.3f})" for link in LINKS
    )


def _spread(values: pd.Series) -> str:
    return f"{values.median():.3g} ({values.min():.3g} to {values.max():.3g})"


def main() -> None:
    """Command line that the workflow calls."""
    parser = argparse.ArgumentParser(prog="python -m slapshot.benchmark.joint_peers")
    parser.add_argument("--out", type=Path, default=Path("figures"))
    args = parser.parse_args()
    os.environ.setdefault("MUJOCO_GL", "disable")
    try:
        need_sysid()
        runs = [(scenario, seed) for scenario in SCENARIOS for seed in SEEDS]
        rows = [row for run in progress(runs, len(runs), "comparing") for row in compare(*run)]
        write_comparison(pd.DataFrame(rows), args.out)
    except InputError as error:
        print(f"joint_peers: {error}", file=sys.stderr)
        sys.exit(1)


if __name__ == "__main__":
    main()
