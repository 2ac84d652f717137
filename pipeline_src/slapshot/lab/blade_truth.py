"""Parameters of a flexible striker."""

from dataclasses import dataclass


@dataclass(frozen=True)
class BladeTruth:
    """Parameters of a flexible striker.

    Attributes:
        segments: number of rigid segments along its height, the first of which is fixed to the stick.
        stiffness: N m/rad, of all hinges in series, for bending about the blade's long axis.
        twist_stiffness: N m/rad, of all hinges in series, about the stick's axis; None for no twist.
        damping_ratio: of the free vibration of the blade on all hinges together.
    """

    segments: int
    stiffness: float
    twist_stiffness: float | None
    damping_ratio: float
