"""What a case is to be; apart from what makes it, so that lists are read without MuJoCo."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

Colour = Literal["white", "ou20", "ou100"]


@dataclass(frozen=True)
class Condition:
    """How a session is recorded.

    Attributes:
        noise: its colour; the standard deviation is the same.
        cluttered: whether times jitter, noise has outliers and grows or shrinks, and encoders drift (and
            whether the rig's laws are off, see `clutter`).
        quantised: rad or m, step of the encoders; None for fine ones.
    """

    noise: Colour = "white"
    cluttered: bool = False
    quantised: float | None = None


@dataclass(frozen=True)
class Order:
    """What a case is to be.

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
    condition: Condition = field(default_factory=Condition)
    episodes: int = 20
    seconds: float = 3.0

    def to_config(self) -> dict[str, Any]:
        """As a recipe holds it; `of_config` reads it."""
        return asdict(self) | {"conceals": [list(one) for one in self.conceals]}

    @classmethod
    def of_config(cls, config: Mapping[str, Any]) -> "Order":
        """From a recipe."""
        values = dict(config)
        conceals = tuple((kind, size) for kind, size in values.pop("conceals"))
        return cls(**values | {"conceals": conceals, "condition": Condition(**values["condition"])})
