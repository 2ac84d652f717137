"""The same parameters of the same scene, fitted to the same hits by mujoco.sysid and by the diagnosis.

A stand-in rig on a tilted board is recorded; both fit the friction of one puck and the two slopes to its
slides. mujoco.sysid is given the parameters to fit and the initial state of each slide, which is estimated
from the first frames and which it assumes to be exact. The score is the error on held-out slides.
"""

import tempfile
import time
from collections.abc import Mapping
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from slapshot.arrays import GRAVITY
from slapshot.benchmark.measures import Measure
from slapshot.config.configuration import Configuration
from slapshot.config.lab import ConcealedEffect, StandIns
from slapshot.dag import make_plan
from slapshot.diagnosis.pucks.fit.hit_fit import HitFitter
from slapshot.diagnosis.pucks.held_out import first_frames, predict_held_out, split_hits
from slapshot.diagnosis.pucks.slide.noise import estimate_noise
from slapshot.diagnosis.pucks.slide.slide_model import Point, SlideModel
from slapshot.diagnosis.pucks.slide.tracks import HitTracks, hit_tracks
from slapshot.effects.tilt import Tilt
from slapshot.errors import InputError
from slapshot.lab.__main__ import record
from slapshot.lab.commands import Pool
from slapshot.recordings.read import read_recording
from slapshot.scenes.scene import Scene
from slapshot.store.folder import Store

Parameters = Mapping[str, float]  # friction_x, friction_y, friction_torsional (m), slope_x, slope_y

SLOPES = ConcealedEffect(kind="tilt", displacement=1.5)
HITS = 80  # of each puck
START = {"friction_x": 0.5, "friction_y": 0.5, "friction_torsional": 0.01, "slope_x": 0.0, "slope_y": 0.0}
BOUNDS = {
    "friction_x": (0.05, 2.0),
    "friction_y": (0.05, 2.0),
    "friction_torsional": (1e-4, 0.1),
    "slope_x": (-0.1, 0.1),
    "slope_y": (-0.1, 0.1),
}


def peer_measures(config: Configuration, store: Store, cores: int, seed: int = 0) -> list[Measure]:
    """Wall time and held-out error of both.

    Raises:
        InputError: mujoco.sysid's extra is not installed, or the pool of commands has not been made.
    """
    scene, tracks, truth = _recorded(config, store, seed)
    kept, held = split_hits(tracks, np.random.default_rng(seed))
    train, test = (_fitter(tracks.take(rows), scene, cores) for rows in (kept, held))
    began = time.perf_counter()
    nominal = train.fit(train.start())
    train.drop_jumps(nominal.point)
    fit = train.fit(nominal.point, nominal.scatter, ["tilt"])
    own_seconds = time.perf_counter() - began
    began = time.perf_counter()
    peer = fit_by_sysid(scene, train.model.tracks, train.valid, cores)
    peer_seconds = time.perf_counter() - began
    test.drop_jumps(replace(test.start(), nuisance=nominal.point.nuisance))
    tilted = fit.point.effects["tilt"]
    as_point = Point(
        fit.point.latents,
        np.log([[peer[f"friction_{k}"] for k in ("x", "y", "torsional")]]),
        {"tilt": {name: peer[name] for name in ("slope_x", "slope_y")}},
    )
    points = {"slapshot": fit.point, "mujoco_sysid": as_point}
    rows = [
        Measure("peer_fit_seconds_slapshot", own_seconds, "s"),
        Measure("peer_fit_seconds_mujoco_sysid", peer_seconds, "s"),
        Measure("peer_fit_seconds_ratio", peer_seconds / own_seconds, "1"),
    ]
    for name, point in points.items():
        scored = predict_held_out(test, replace(fit, point=point))
        error = 1e3 * float(np.sqrt(scored.track_square.mean()))
        rows.append(Measure(f"peer_held_out_track_error_{name}", error, "mm"))
    floor = predict_held_out(test, fit).expected_track
    rows.append(Measure("peer_held_out_noise_floor", 1e3 * float(np.sqrt(floor.mean())), "mm"))
    for name in ("slope_x", "slope_y"):
        rows += [
            Measure(f"peer_{name}_true", 1e3 * truth[name], "mm/m"),
            Measure(f"peer_{name}_slapshot", 1e3 * tilted[name], "mm/m"),
            Measure(f"peer_{name}_mujoco_sysid", 1e3 * peer[name], "mm/m"),
        ]
    return rows


def _recorded(config: Configuration, store: Store, seed: int) -> tuple[Scene, HitTracks, Parameters]:
    """Slides of the first puck of a rig on a tilted board, and the true slopes."""
    name, pool = config.cases.domain, config.cases.pool
    recipe = make_plan(config).recipes[f"demonstrations/{name}/pool"]
    inputs = store.inputs(recipe)
    if not store.is_whole(recipe.stage, recipe.id):
        raise InputError("benchmark: the pool of commands is not made: run `snakemake signatures` first")
    scene = Scene.load(inputs["scene"])
    file = store.folder(recipe.stage, recipe.id) / "demonstrations.parquet"
    source = Pool.load(file, pool.count, pool.duration_s, len(scene.info.joints))
    settings = StandIns.from_parts(config.lab_of_cases, hits=HITS, concealed=[SLOPES], commands="pool")
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        record(scene, source, settings, seed, out)
        tracks = hit_tracks(read_recording(out / "recording"))
        truth = pd.read_json(out / "truth" / "truth.json", typ="series")["concealed"][0]["parameters"]
    mine = tracks.take(np.flatnonzero(tracks.object == 0))
    return scene, replace(mine, objects=mine.objects[:1]), truth


def _fitter(tracks: HitTracks, scene: Scene, cores: int) -> HitFitter:
    camera = np.array(scene.info.start)  # no effect of the camera is fitted
    model = SlideModel(tracks, {"tilt": Tilt()}, scene.info.object_radius, camera, cores)
    return HitFitter(model, estimate_noise(*tracks.resting))


def fit_by_sysid(scene: Scene, tracks: HitTracks, valid: NDArray[np.bool_], cores: int) -> dict[str, float]:
    """Parameters by least squares over all frames of all slides, fitted by mujoco.sysid.

    Raises:
        InputError: its extra is not installed.
    """
    sysid = need_sysid()
    spec = object_alone(scene)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    height = float(data.sensordata[2])
    names, states, controls, sensors = [], [], [], []
    shown = first_frames(valid)
    for i in range(len(tracks)):
        times, places = tracks.times[i][valid[i]], tracks.places[i][valid[i]]
        begin = np.polynomial.polynomial.polyfit(times[: shown[i].sum()], places[: shown[i].sum()], 2)
        qpos, qvel = np.zeros(model.nq), np.zeros(model.nv)
        qpos[:2], qvel[:2] = begin[0] - np.array(scene.info.start), begin[1]
        grid = np.arange(0.0, times[-1] + model.opt.timestep, model.opt.timestep)
        seen = np.column_stack([places, np.full(len(times), height)])
        names.append(f"hit {tracks.hit[i]}")
        states.append(sysid.create_initial_state(model, qpos, qvel))
        controls.append(sysid.TimeSeries(grid, np.zeros((len(grid), model.nu))))
        sensors.append(sysid.TimeSeries.from_names(times, seen, model))
    sequences = sysid.ModelSequences("puck", spec, names, states, controls, sensors)
    parameters = sysid.ParameterDict()
    for name, value in START.items():
        low, high = BOUNDS[name]
        parameters.add(sysid.Parameter(name, value, low, high, modifier=_modifier(scene, name)))
    residual = sysid.build_residual_fn(models_sequences=[sequences], n_threads=cores)
    found, _ = sysid.optimize(parameters, residual, optimizer="mujoco", verbose=False)
    return {name: float(found[name].value[0]) for name in START}


def need_sysid() -> Any:
    """The module mujoco.sysid.

    Raises:
        InputError: its extra is not installed.
    """
    sysid = import_module("mujoco.sysid")
    if not hasattr(sysid, "optimize"):
        install = "pip install --require-hashes --requirement requirements/benchmark.txt"
        raise InputError(f"benchmark: mujoco.sysid is not installed; run: {install}")
    return sysid


def object_alone(scene: Scene) -> mujoco.MjSpec:
    """The scene without its arm, with a sensor of the object's position, and a motor that is never used."""
    spec = mujoco.MjSpec.from_string(scene.xml)
    for body in list(spec.worldbody.bodies):
        if body.name != scene.info.object_body:
            spec.delete(body)
    spec.add_sensor(
        name="place",
        type=mujoco.mjtSensor.mjSENS_FRAMEPOS,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        objname=scene.info.object_body,
    )
    motor = spec.add_actuator(name="none", target=scene.info.object_joints[0])
    motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
    return spec


def _modifier(scene: Scene, name: str) -> Any:
    """Function that sets a parameter in a spec."""
    # Tangent 1 of a horizontal contact is world y.
    place = {"friction_y": 0, "friction_x": 1, "friction_torsional": 2}

    def friction(spec: mujoco.MjSpec, parameter: Any) -> None:
        pair = next(p for p in spec.pairs if p.name == scene.info.object_pair)
        values = np.array(pair.friction)
        values[place[name]] = parameter.value[0]
        pair.friction = values

    def slope(spec: mujoco.MjSpec, parameter: Any) -> None:
        gravity = np.array(spec.option.gravity)
        gravity["xy".index(name[-1])] = -GRAVITY * parameter.value[0]
        spec.option.gravity = gravity

    return slope if name.startswith("slope") else friction
