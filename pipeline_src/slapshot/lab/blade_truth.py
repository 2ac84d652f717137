"""A flexible striker, in numbers."""

from dataclasses import dataclass


@dataclass(frozen=True)
class BladeTruth:
    """A flexible striker.

    Attributes:
        segments: rigid pieces across its height, the first of which sits on the stick.
        stiffness: N m/rad, of all hinges in series, bending backwards about the blade's long axis.
        twist_stiffness: N m/rad, of all hinges in series, about the stick's axis; None for none.
        damping_ratio: of the blade swinging freely on all its hinges as one.
    """

    segments: int
    stiffness: float
    twist_stiffness: float | None
    damping_ratio: float
