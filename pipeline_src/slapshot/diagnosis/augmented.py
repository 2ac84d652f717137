"""A user's model with effects written into it; what MJCF cannot represent, as notes and as a function.

spec, notes = augmented_model(rig, effects, theta)
model = spec.compile()
law = forces(rig, effects, theta)
data = mujoco.MjData(model)
for command in commands:
    data.ctrl[:] = command
    data.qfrc_applied[:] = law(model, data)
    mujoco.mj_step(model, data)
"""

import copy
from collections.abc import Callable, Sequence
from pathlib import Path

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.model.hypothesis import Hypothesis, actuator_torque
from slapshot.diagnosis.model.rig import Rig
from slapshot.diagnosis.model.sensors import OWN
from slapshot.effects.joints.effect import JointEffect, State, overrides
from slapshot.effects.joints.split import resolve_files
from slapshot.errors import InputError, writing
from slapshot.text import reason_of
from slapshot.whole_file import write_whole

MODEL_FILE, NOTES_FILE = "model.xml", "NOTES.md"
_PASSES = 2  # what compiling derives from changed numbers, such as damping ratios, is pinned in the second


def augmented_model(
    rig: Rig, effects: Sequence[JointEffect], theta: Array
) -> tuple[mujoco.MjSpec, list[str]]:
    """The user's own model with all numbers that effects change, and notes on what it cannot represent.

    Args:
        rig: of the hypothesis: where effects change the model's structure, one that has it.
        effects: present.
        theta: their values, in order.

    Returns:
        The specification, which compiles to the numbers of `Hypothesis.compiled` (at the user's time step),
        and one note for each effect on forces, controls or readings: formulas in SI units.

    Raises:
        InputError: the model cannot hold a change; one line.
    """
    hypothesis, values = Hypothesis(rig, tuple(effects)), np.asarray(theta, float)
    parts = list(zip(hypothesis.effects, hypothesis.slices, strict=True))
    spec = rig.spec.copy()
    changed = [(effect, values[part]) for effect, part in parts if overrides(effect, "edit")]
    if changed:
        _write_numbers(rig, spec, changed)
    # XML as the user wrote it: with their default classes, units and shortcuts, in all digits.
    spec.compiler.savecompiled = spec.compiler.savecanonical = False
    spec.compile()
    notes = [effect.note(values[part]) for effect, part in parts]
    return spec, [note for note in notes if note]


def write_augmented(rig: Rig, effects: Sequence[JointEffect], theta: Array, folder: Path) -> None:
    """Write the model with effects to model.xml and what it cannot represent to NOTES.md.

    Motors that were added for recorded torques bear the names of their joints, and added joints plain ones.
    Files of meshes and textures stay where they are.

    Args:
        rig: as in `augmented_model`.
        effects: present.
        theta: their values.
        folder: made where it is missing; both files are replaced.

    Raises:
        InputError: the model cannot hold a change, or the folder cannot be written; one line.
    """
    spec, notes = augmented_model(rig, effects, theta)
    motors = _strip_names(spec)
    resolve_files(spec)
    spec.compile()
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(folder / MODEL_FILE, spec.to_xml())
        write_whole(folder / NOTES_FILE, _notes_file(rig, effects, theta, motors, notes))


def forces(
    rig: Rig, effects: Sequence[JointEffect], theta: Array, order: float = 0.0
) -> Callable[[mujoco.MjModel, mujoco.MjData], Array]:
    """The sum of all force laws, to be set as `data.qfrc_applied[:]` before every step.

    Args:
        rig: as in `augmented_model`.
        effects: present; those without a force law add nothing.
        theta: their values.
        order: place in the session, from -1/2 at its first episode to 1/2 at its last.

    Returns:
        A function of the model of `augmented_model`, compiled, and its data, with controls set: (nv,) in N m
        or N. Time is counted from the episode's start. Its data is left as it is.
    """
    hypothesis, values = Hypothesis(rig, tuple(effects)), np.array(theta, float)

    def law(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        x = np.concatenate([data.qpos, data.qvel, data.act])[None]
        load = actuator_torque(model, x, data.ctrl[None], rig.load)
        q, v = x[:, : model.nq], x[:, model.nq : model.nq + model.nv]
        total = hypothesis.force(State(q, v, load, np.array([data.time]), np.array([order])), values)
        return np.zeros(model.nv) if total is None else total[0]

    return law


def _write_numbers(rig: Rig, spec: mujoco.MjSpec, changed: Sequence[tuple[JointEffect, Array]]) -> None:
    """Apply edits of compiled numbers, and write those that changed into the specification."""
    movable = {rig.model.body(b).name for b in range(rig.model.nbody) if not rig.model.body_simple[b]}
    simple = [(body, body.simple) for body in spec.bodies if body.name in movable]
    for body, _ in simple:
        body.simple = False  # as the rig has it, so that a load can move its centre
    edited = copy.copy(spec.compile())
    for effect, values in changed:
        effect.edit(edited, values)
    mujoco.mj_setConst(edited, mujoco.MjData(edited))
    inferred = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    if spec.compiler.settotalmass > 0 or spec.compiler.inertiafromgeom == inferred:
        # Masses that the compiler infers or scales would not stay: what then differs is made explicit.
        spec.compiler.settotalmass = -1
        spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
        spec.compile()
    means = spec.stat.meaninertia, spec.stat.meanmass
    try:
        for _ in range(_PASSES):
            spec.copy_back(edited)
            spec.stat.meaninertia, spec.stat.meanmass = means  # deprecated
            spec.compile()
    except ValueError as error:
        raise InputError(
            f"model: cannot represent the result ({reason_of(error)}); write that part with numbers of its "
            "own"
        ) from None
    for body, was in simple:
        body.simple = was


def _strip_names(spec: mujoco.MjSpec) -> list[str]:
    """Name what was added plainly, motors like their joints, and leave added sensors out; names of motors."""
    before = {actuator.name for actuator in spec.actuators}
    for sensor in spec.sensors:
        if sensor.name.startswith(OWN):
            spec.delete(sensor)
    for parts in (spec.bodies, spec.joints, spec.sites, spec.tendons, spec.actuators):
        taken = {part.name for part in parts}
        for part in parts:
            if part.name.startswith(OWN):
                name = part.name.removeprefix(OWN)
                part.name = name if name not in taken else f"{name} added"
    return [name for name in (a.name for a in spec.actuators) if name not in before]


def _notes_file(
    rig: Rig, effects: Sequence[JointEffect], theta: Array, motors: Sequence[str], notes: Sequence[str]
) -> str:
    hypothesis = Hypothesis(rig, tuple(effects))
    lines = [f"# {rig.name} with what was found", "", f"Values in {MODEL_FILE}:", ""]
    for effect, part in zip(hypothesis.effects, hypothesis.slices, strict=True):
        if overrides(effect, "edit"):
            variant = f" ({effect.variant})" if effect.variant else ""
            pairs = zip(effect.parameters, np.asarray(theta)[part], strict=True)
            numbers = "; ".join(f"{p.name} {v:.4g}{'' if p.unit == '1' else ' ' + p.unit}" for p, v in pairs)
            lines.append(f"- {effect.phrase.format(part=effect.part)}{variant}: {numbers}")
    if lines[-1] == "":
        lines.append("- none")
    if notes:
        lines += ["", "MJCF cannot hold the rest; add it to your simulation:", ""]
        lines += [f"- {note}" for note in notes]
    if motors:
        lines += ["", f"Motors that take the recorded torques were added: {', '.join(motors)}."]
    return "\n".join(lines) + "\n"
