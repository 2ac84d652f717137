"""A conclusive diagnosis, from which figures and the Rerun recording are made."""

from dataclasses import dataclass

import mujoco

from slapshot.arrays import Array
from slapshot.diagnosis.diagnose import Diagnosis
from slapshot.diagnosis.held_out import Predictions
from slapshot.diagnosis.held_out_validation import Prediction
from slapshot.diagnosis.model.rig import Rig
from slapshot.diagnosis.model.segments import Segments
from slapshot.diagnosis.selection.steps import Search, Step
from slapshot.diagnosis.verdict import Verdict
from slapshot.recordings.signals import SignalRecording


@dataclass(frozen=True)
class Outcome:
    """As `Diagnosis`, with all parts present.

    Attributes:
        verdict: with versions.
        by_model: predictions of the windows by the distinct models: nominal, refitted where the nominal model
            has free parameters, augmented where something was named.
        units: of the columns of the observations.
    """

    verdict: Verdict
    rig: Rig
    search: Search
    windows: Segments
    by_model: dict[str, Prediction]
    units: tuple[str, ...]

    @classmethod
    def of(cls, diagnosis: Diagnosis, verdict: Verdict, recording: SignalRecording) -> "Outcome | None":
        """The outcome of a diagnosis; None if inconclusive."""
        d = diagnosis
        if d.search is None or d.windows is None or not (d.nominal and d.refitted and d.augmented):
            return None
        by_model = {"nominal": d.nominal}
        if verdict.nominal_parameters:
            by_model["refitted"] = d.refitted
        if verdict.effects:
            by_model["augmented"] = d.augmented
        units = tuple(recording.channels[o.channel].unit for o in d.rig.observations)
        return cls(verdict, d.rig, d.search, d.windows, by_model, units)

    @property
    def best(self) -> str:
        """The model that explains most: augmented, else refitted, else nominal."""
        return list(self.by_model)[-1]

    def step(self, model_name: str) -> Step:
        """The step of the search that a model belongs to."""
        return self.search.final if model_name == "augmented" else self.search.nominal

    @property
    def half(self) -> int:
        """Node of a window at which prediction begins."""
        return self.windows.shape[1] // 2

    def predictions(self, model_name: str) -> Predictions:
        """Of one model."""
        return self.by_model[model_name].predictions

    @property
    def recorded(self) -> Array:
        """(W, nodes, ny) what was recorded in the predicted halves."""
        return self.windows.y[:, self.half :]


@dataclass(frozen=True)
class Coordinate:
    """One degree of freedom of the nominal model, for figures.

    Attributes:
        name: of the joint, with an axis where it has several.
        joint: its name.
        axis: which of the joint's degrees of freedom.
        q: index in qpos; None where that holds a quaternion.
        v: index in qvel.
        force, motion: units of its force and of its position.
    """

    name: str
    joint: str
    axis: int
    q: int | None
    v: int
    force: str
    motion: str


def coordinates(model: mujoco.MjModel) -> list[Coordinate]:
    """Hinges and slides, the three axes of ball joints, and the places of free bodies."""
    found = []
    kinds = mujoco.mjtJoint
    for j in range(model.njnt):
        kind, name = model.jnt_type[j], model.joint(j).name
        q, v = int(model.jnt_qposadr[j]), int(model.jnt_dofadr[j])
        if kind == kinds.mjJNT_HINGE:
            found.append(Coordinate(name, name, 0, q, v, "N m", "rad"))
        elif kind == kinds.mjJNT_SLIDE:
            found.append(Coordinate(name, name, 0, q, v, "N", "m"))
        elif kind == kinds.mjJNT_BALL:
            found += [
                Coordinate(f"{name} {a}", name, i, None, v + i, "N m", "rad") for i, a in enumerate("xyz")
            ]
        else:
            found += [Coordinate(f"{name} {a}", name, i, q + i, v + i, "N", "m") for i, a in enumerate("xyz")]
    return found
