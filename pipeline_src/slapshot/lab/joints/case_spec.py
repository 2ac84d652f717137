"""Specification of a case of joints, apart from its recording, so that lists are read without MuJoCo."""

from dataclasses import dataclass, field
from typing import Literal

from slapshot.validation import Model

Colour = Literal["white", "ou20", "ou100"]


@dataclass(frozen=True)
class MeasurementCondition:
    """Measurement conditions of a session.

    Attributes:
        noise: its colour, at equal standard deviation.
        cluttered: whether times jitter, noise has outliers and grows or shrinks, and encoders drift (and
            whether the rig's laws have model errors, see `clutter`).
        quantised: rad or m, step of the encoders; None for fine ones.
    """

    noise: Colour = "white"
    cluttered: bool = False
    quantised: float | None = None


@dataclass(frozen=True)
class CaseSpec:
    """Specification of a case.

    Attributes:
        rig: by name.
        seed: of everything that is drawn.
        conceals: kind and size over the noise of each piece of physics; None where the size is drawn.
        condition: how it is recorded.
        episodes: of the session.
        seconds: of an episode.
    """

    rig: str
    seed: int
    conceals: tuple[tuple[str, float | None], ...] = ()
    condition: MeasurementCondition = field(default_factory=MeasurementCondition)
    episodes: int = 20
    seconds: float = 3.0


class JointCaseSettings(Model):
    """What the stage `joint_case` is told."""

    spec: CaseSpec
