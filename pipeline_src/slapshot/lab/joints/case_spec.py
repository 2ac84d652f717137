"""Specification of a case of joints, apart from its recording, so that lists are read without MuJoCo."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

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

    def to_config(self) -> dict[str, Any]:
        """As in a recipe; `of_config` reads it."""
        return asdict(self) | {"conceals": [list(one) for one in self.conceals]}

    @classmethod
    def of_config(cls, config: Mapping[str, Any]) -> "CaseSpec":
        """From a recipe."""
        values = dict(config)
        conceals = tuple((kind, size) for kind, size in values.pop("conceals"))
        return cls(
            **values | {"conceals": conceals, "condition": MeasurementCondition(**values["condition"])}
        )
