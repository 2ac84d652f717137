"""Stage `lab`: a recording of a stand-in rig and, in a separate folder, its sealed ground truth."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from slapshot.command import Run, stage_command
from slapshot.config.lab import DiverseCommands, LabSettings, StandIns
from slapshot.errors import InputError
from slapshot.json_types import JsonObject
from slapshot.lab.camera import observe
from slapshot.lab.commands import Diverse, Latents, Pool, Session, Source, draw_session
from slapshot.lab.hidden_effects.draw import draw_concealed
from slapshot.lab.hidden_effects.effect_size_calibration import EffectSizeCalibration
from slapshot.lab.hit import RigSimulator
from slapshot.lab.hit_types import Hit, HitNoise, HitSpec, draw_hit_noise
from slapshot.lab.rig import Rig, draw_rig, truth_dict
from slapshot.lab.rig_batch import BATCH_SIZE
from slapshot.lab.rng_streams import recording_streams, stream_for
from slapshot.lab.tables import commanded, hits_table, joint_table, read_encoders, tracks_table
from slapshot.progress import progress
from slapshot.recordings.format import ObjectInfo, Recording
from slapshot.recordings.write import write_recording
from slapshot.scenes.domain import load_domain
from slapshot.scenes.scene import Scene
from slapshot.trajectories.safety import SafetyCheck

RIG = "stand-in lab"
NOTE = (
    "STAND-IN: this recording was simulated by slapshot's lab; no real robot was involved. The rig's "
    "physics is concealed in a sealed file whose digest is given. start_x and start_y are where "
    "the object was meant to lie; the camera saw where it lay. recorded_at is null."
)
FRAME_NOTE = (
    "stand-in: the frame of the scene; x and y on the board, z up, origin where the arm's first axis "
    "meets the board"
)


def produce(run: Run) -> None:
    """Write recording/ in the recording format, and truth/truth.json."""
    scene = Scene.load(run.inputs["scene"])
    told = run.settings(LabSettings)
    settings = told.lab
    source: Source
    if told.pool is not None:
        file = run.inputs["demonstrations"] / "demonstrations.parquet"
        source = Pool.load(file, told.pool.count, told.pool.duration_s, len(scene.info.joints))
    elif isinstance(settings.commands, DiverseCommands):
        source = Diverse(scene, load_domain(told.scene.domain), settings.commands.diverse)
    else:
        # Imported here: the import takes longer than all the work for a rig without a trajectory model.
        from slapshot.trajectories.vae import TrajectoryVae

        model = TrajectoryVae.load(run.inputs["trajectory_model"])
        source = Latents(model.motion, model.sizes.latent, told.trajectory_model_id)
    record(scene, source, settings, [told.seed, told.rig], run.out, run.cores)


def record(
    scene: Scene,
    source: Source,
    settings: StandIns,
    seed: int | list[int],
    out: Path,
    cores: int = 1,
) -> None:
    """Draw a rig and a session, execute it, write recording/ and truth/truth.json in folder `out`.

    Args:
        scene: nominal model of the rig.
        source: draws the commands.
        settings: block `lab` of the configuration.
        seed: seeds every random draw.
        out: an existing folder.
        cores: number of cores; the output does not depend on it.

    Raises:
        InputError: the settings contradict each other or the scene.
    """
    rig_rng, session_rng, scale_rng, hits_rng, concealed_rng = recording_streams(seed)
    rig = draw_rig(settings, rig_rng)
    if len(rig.scatter.joint_offset_sd) != len(scene.info.joints):
        raise InputError(
            f"lab.scatter.joint_offset_sd_rad: {len(rig.scatter.joint_offset_sd)} values for "
            f"{len(scene.info.joints)} joints; give one for each joint"
        )
    session = draw_session(settings, list(rig.objects), source, SafetyCheck(scene), session_rng)
    count = len(session.command)
    # Separate random streams per hit, so that changing the camera does not change the hits.
    streams = [rng.spawn(4) for rng in hits_rng.spawn(count)]
    strokes = [_stroke(rig, session, i, streams[i][0]) for i in range(count)]
    truths: list[JsonObject] = []
    if settings.concealed:
        size_calibration = EffectSizeCalibration(
            scene, rig, strokes, stream_for(concealed_rng, "scatter"), cores
        )
        concealed = draw_concealed(settings.concealed, size_calibration, concealed_rng)
        rig = replace(rig, concealed=concealed)
        strokes = [_with_quirks(strokes[i], rig, streams[i][3]) for i in range(count)]
        truths = [c.truth() | {"scatter_m": size_calibration.scatter} for c in concealed]

    keep, bench = settings.keep, RigSimulator(scene, rig, cores=cores)
    hits: list[Hit] = []
    for first in progress(range(0, count, BATCH_SIZE), -(-count // BATCH_SIZE), "lab, parts of a session"):
        hits += bench.hits(strokes[first : first + BATCH_SIZE], arm=keep == "full")
    sightings = [
        observe(hit.track, rig.camera, streams[i][1], rig.seen(hit.track, strokes[i].place))
        for i, hit in enumerate(hits)
    ]

    (out / "truth").mkdir(parents=True)
    sealed = _sealed(rig, truths, session, strokes, hits)
    (out / "truth" / "truth.json").write_bytes(sealed)
    joints = settings.joints
    commands = [commanded(command.motion, joints.rate_hz) for command in session.commands]
    # Recordings with tracks only hold no commands. Those with rest points only need the commands in one form:
    # as latents, or else as joint trajectories.
    trajectory_model = None if keep == "tracks only" else source.trajectory_model
    with_commands = keep in ("full", "no encoders") or (
        keep == "rest points only" and trajectory_model is None
    )
    recording = Recording(
        rig=RIG,
        objects=_weigh(scene, rig, settings.scale_sd_kg, scale_rng),
        camera_rate_hz=rig.camera.rate,
        frame_note=FRAME_NOTE,
        stand_in=True,
        trajectory_model=trajectory_model,
        note=NOTE,
        sealed_truth_sha256=hashlib.sha256(sealed).hexdigest(),
        hits=hits_table(scene, session, sightings, trajectory_model is not None),
        tracks=None if keep == "rest points only" else tracks_table(sightings),
        commands=joint_table([commands[i] for i in session.command]) if with_commands else None,
        joints=None
        if keep != "full"
        else joint_table([read_encoders(h.joints, joints, streams[i][2]) for i, h in enumerate(hits)]),
    )
    write_recording(recording, out / "recording")


def _stroke(rig: Rig, session: Session, i: int, rng: np.random.Generator) -> HitSpec:
    """Specification of hit `i` of the session, with its noise drawn."""
    command = session.commands[session.command[i]]
    place = i / max(1, len(session.command) - 1)
    return HitSpec(command.motion, session.object_ids[i], draw_hit_noise(rig.scatter, rng), place)


def _with_quirks(stroke: HitSpec, rig: Rig, rng: np.random.Generator) -> HitSpec:
    """Add a random number for each hidden effect; it does not depend on which other effects there are."""
    quirk = {c.effect.name: float(stream_for(rng, c.effect.name).normal()) for c in rig.concealed}
    return replace(stroke, chance=replace(stroke.chance, quirk=quirk))


def _weigh(scene: Scene, rig: Rig, scale_sd: float, rng: np.random.Generator) -> dict[str, ObjectInfo]:
    """Objects as measured: the shape is that of the scene's object, the mass has the scale's error."""
    size = (2 * scene.info.object_radius, scene.info.object_height)
    return {
        name: ObjectInfo(
            shape="cylinder",
            size_m=size,
            mass_kg=float(truth.mass + rng.normal(0, scale_sd)),
            mass_sd_kg=scale_sd,
        )
        for name, truth in rig.objects.items()
    }


def _sealed(
    rig: Rig, concealed: list[JsonObject], session: Session, strokes: list[HitSpec], hits: list[Hit]
) -> bytes:
    """Contents of truth.json: the rig and, for every hit, its noise and its true outcome (SI units)."""
    of_hits = [
        {"hit": i} | _chance_dict(stroke.chance) | _hit_dict(hit)
        for i, (stroke, hit) in enumerate(zip(strokes, hits, strict=True))
    ]
    truth: JsonObject = {
        "stand_in": True,
        "rig": truth_dict(rig),
        "concealed": concealed,
        "hits": of_hits,
    }
    tasks = [command.task for command in session.commands]
    if any(task is not None for task in tasks):
        truth["tasks"] = tasks
    return (json.dumps(truth, indent=1, sort_keys=True) + "\n").encode()


def _chance_dict(chance: HitNoise) -> JsonObject:
    known = {
        "start_error_m": chance.start_error.tolist(),
        "pace": chance.pace,
        "joint_offset_rad": chance.joint_offset.tolist(),
        "friction_factor": chance.friction,
    }
    return known | ({"quirk": dict(chance.quirk)} if chance.quirk else {})


def _hit_dict(hit: Hit) -> JsonObject:
    return {
        "launch_time_s": hit.launch_time,
        "launch": hit.launch.tolist(),
        "rest": hit.rest.tolist(),
        "end_s": hit.end,
    }


if __name__ == "__main__":
    stage_command("lab", produce)
