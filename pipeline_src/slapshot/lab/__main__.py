"""Stage `lab`: a recording of a stand-in rig, and apart from it the sealed truth about that rig."""

import hashlib
import json
import logging
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from slapshot.command import Run, stage_command
from slapshot.errors import InputError
from slapshot.lab.camera import Sighting, observe
from slapshot.lab.commands import Session, draw_session
from slapshot.lab.hit import Bench, Chance, Hit, draw_chance
from slapshot.lab.rig import Rig, draw_rig, truth_dict
from slapshot.progress import progress
from slapshot.recordings.format import ObjectInfo, Recording
from slapshot.recordings.write import write_recording
from slapshot.scenes.scene import Scene
from slapshot.trajectories.motion import Motion
from slapshot.trajectories.safety import SafetyCheck
from slapshot.trajectories.vae import TrajectoryVae

log = logging.getLogger("slapshot")
Array = NDArray[np.float64]

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
    model = TrajectoryVae.load(run.inputs["trajectory_model"])
    record(
        Scene.load(run.inputs["scene"]),
        model.motion,
        model.sizes.latent,
        run.config["lab"],
        [run.config["seed"], run.config["rig"]],
        run.config.get("trajectory_model_id"),
        run.out,
    )


def record(
    scene: Scene,
    motion: Callable[[Array], Motion],
    latent: int,
    settings: Mapping[str, Any],
    seed: int | list[int],
    trajectory_model: str | None,
    out: Path,
) -> None:
    """Draw a rig and a session, execute it, write recording/ and truth/truth.json in folder `out`.

    Args:
        scene: of the rig as everybody believes it to be.
        motion: decodes a latent (latent,).
        latent: its dimensions.
        settings: block `lab` of the configuration.
        seed: of everything that is drawn.
        trajectory_model: version of the model behind `motion`; None leaves the latents out.
        out: exists already.

    Raises:
        InputError: the settings contradict each other or the scene.
    """
    rig_rng, session_rng, scale_rng, hits_rng = np.random.default_rng(seed).spawn(4)
    rig = draw_rig(settings, rig_rng)
    if len(rig.scatter.joint_offset_sd) != len(scene.info.joints):
        raise InputError(
            f"lab.scatter.joint_offset_sd_rad: {len(rig.scatter.joint_offset_sd)} values for "
            f"{len(scene.info.joints)} joints; give one for each joint"
        )
    session = draw_session(settings, list(rig.objects), motion, latent, SafetyCheck(scene), session_rng)
    motions = [motion(z) for z in session.latents]
    bench = Bench(scene, rig)
    count = len(session.command)
    chances: list[Chance] = []
    hits: list[Hit] = []
    sightings: list[Sighting] = []
    encoders: list[Array] = []
    for i, rng in progress(enumerate(hits_rng.spawn(count)), count, "lab hits"):
        # Three streams, so that another camera leaves what happens as it is.
        chance_rng, camera_rng, encoder_rng = rng.spawn(3)
        chances.append(draw_chance(rig.scatter, chance_rng))
        hits.append(bench.hit(motions[session.command[i]], session.object_ids[i], chances[i]))
        sightings.append(observe(hits[i].track, rig.camera, camera_rng))
        encoders.append(_read_encoders(hits[i].joints, settings["joints"], encoder_rng))

    (out / "truth").mkdir(parents=True)
    sealed = _sealed(rig, chances, hits)
    (out / "truth" / "truth.json").write_bytes(sealed)
    commands = [_commands(m, settings["joints"]["rate_hz"]) for m in motions]
    tables = _tables(scene, session, sightings, trajectory_model is not None)
    recording = Recording(
        rig=RIG,
        objects=_weigh(scene, rig, settings["scale_sd_kg"], scale_rng),
        camera_rate_hz=rig.camera.rate,
        frame_note=FRAME_NOTE,
        stand_in=True,
        trajectory_model=trajectory_model,
        note=NOTE,
        sealed_truth_sha256=hashlib.sha256(sealed).hexdigest(),
        hits=tables[0],
        tracks=tables[1],
        commands=_joint_table([commands[i] for i in session.command]),
        joints=_joint_table(encoders),
    )
    write_recording(recording, out / "recording")


def _tables(
    scene: Scene, session: Session, sightings: list[Sighting], with_latents: bool
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Tables of hits and of tracks; hits are numbered in the order of execution."""
    number = np.arange(len(session.command))
    unseen = np.full(2, np.nan)
    rests = np.array([unseen if s.rest is None else s.rest for s in sightings])
    hits = pd.DataFrame(
        {
            "hit": number,
            "object_id": session.object_ids,
            "order": number,
            "recorded_at": pd.Series(pd.NaT, index=number, dtype="datetime64[us, UTC]"),
            "command_id": session.command,
            "start_x": scene.info.start[0],
            "start_y": scene.info.start[1],
            "rest_x": rests[:, 0],
            "rest_y": rests[:, 1],
        }
    )
    if with_latents:
        hits["latent"] = list(session.latents[session.command])
    frames = np.concatenate([s.frames for s in sightings])
    tracks = pd.DataFrame(frames, columns=["t", "x", "y"])
    tracks.insert(0, "hit", np.repeat(number, [len(s.frames) for s in sightings]))
    return hits, tracks


def _joint_table(rows: list[Array]) -> pd.DataFrame:
    """Table of joint angles; an array (n, 1 + joints) of t (s) and angles (rad) a hit."""
    stacked = np.concatenate(rows)
    columns = ["t", *(f"q{j}" for j in range(stacked.shape[1] - 1))]
    table = pd.DataFrame(stacked, columns=columns)
    table.insert(0, "hit", np.repeat(np.arange(len(rows)), [len(part) for part in rows]))
    return table


def _commands(motion: Motion, rate: float) -> Array:
    """(n, 1 + joints): t in s and the joint positions in rad that were asked for, `rate` a second."""
    times = np.arange(round(motion.duration * rate) + 1) / rate
    return np.column_stack([times, motion.position(times)])


def _read_encoders(joints: Array, settings: Mapping[str, Any], rng: np.random.Generator) -> Array:
    """(n, 1 + joints): t in s and joint positions in rad as read, from those as they were."""
    times = np.arange(0.0, joints[-1, 0], 1 / settings["rate_hz"])
    read = [np.interp(times, joints[:, 0], joints[:, j]) for j in range(1, joints.shape[1])]
    noise = rng.normal(0, settings["noise_sd_rad"], (len(times), len(read)))
    return np.column_stack([times, np.stack(read, axis=1) + noise])


def _weigh(scene: Scene, rig: Rig, scale_sd: float, rng: np.random.Generator) -> dict[str, ObjectInfo]:
    """Objects as measured: all have the shape of the scene's own, their mass is off by the scale's error."""
    size = (2 * scene.info.object_radius, scene.info.object_height)
    return {
        name: ObjectInfo("cylinder", size, float(truth.mass + rng.normal(0, scale_sd)), scale_sd)
        for name, truth in rig.objects.items()
    }


def _sealed(rig: Rig, chances: list[Chance], hits: list[Hit]) -> bytes:
    """truth.json: the rig, and of every hit what chance did and what really happened (SI units)."""
    of_hits = [
        {
            "hit": i,
            "start_error_m": chance.start_error.tolist(),
            "pace": chance.pace,
            "joint_offset_rad": chance.joint_offset.tolist(),
            "friction_factor": chance.friction,
            "launch_time_s": hit.launch_time,
            "launch": hit.launch.tolist(),
            "rest": hit.rest.tolist(),
            "end_s": hit.end,
        }
        for i, (chance, hit) in enumerate(zip(chances, hits, strict=True))
    ]
    truth = {"stand_in": True, "rig": truth_dict(rig), "hits": of_hits}
    return (json.dumps(truth, indent=1, sort_keys=True) + "\n").encode()


if __name__ == "__main__":
    stage_command("lab", produce)
