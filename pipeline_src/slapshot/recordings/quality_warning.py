"""A quality warning about a valid recording."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

_NAMED = 6  # hits or episodes that a text lists individually


# Programs rely on these slugs: a kind keeps its name when its text changes.
WarningKind = Literal[
    "few_hits",
    # how the object moves
    "never_moves",
    "moving_at_start",
    "moving_at_end",
    "second_push",
    "moves_again",
    "start_point",
    "rest_point",
    "alike_headings",
    "alike_speeds",
    "not_slowing",
    "scatter",
    "friction_changes",
    # hits
    "far_places",
    "implausible_slides",
    "order_repeats",
    "order_dates",
    # commands and joints
    "few_rows",
    "joint_units",
    "joint_jumps",
    "no_joints",
    "no_commands",
    "joints_reversed",
    "joints_late",
    "joints_astray",
    # frames
    "no_clock",
    "frame_rate",
    "moving_noise",
    "gaps",
    "frozen_frames",
    "repeated_frames",
    "mistracks",
    "place_changes",
    "uneven_noise",
    "correlated_noise",
    "coarse_numbers",
    # signals: their clocks
    "uneven_clock",
    "controls_end",
    "late_channel",
    "clock_drift",
    # signals: samples
    "constant_control",
    "constant_channel",
    "repeated_samples",
    "stuck_samples",
    "outliers",
    "jumps",
    "wraps",
    "saturated",
    "coarse_sampling",
    "noise_differs",
    "unsigned",
    # signals: channels and episodes that say the same
    "no_own_velocity",
    "scale_differs",
    "same_episodes",
]


@dataclass(frozen=True)
class QualityWarning:
    """A quality warning, the hits or episodes concerned, and the consequence for a diagnosis.

    Attributes:
        kind: slug of the type of warning.
        what: one sentence with numbers.
        hits: numbers of the hits or episodes; empty for the whole recording.
        why: consequence for a diagnosis, or remedy.
        of: whether `hits` are hits or episodes.
    """

    kind: WarningKind
    what: str
    hits: tuple[int, ...]
    why: str
    of: Literal["hit", "episode"] = "hit"

    def __str__(self) -> str:
        """What, which hits or episodes, and why, in one line."""
        return f"{self.what}{_named(self.hits, self.of)} - {self.why}"


def _named(hits: Iterable[int], of: str) -> str:
    numbers = list(hits)
    if not numbers:
        return ""
    named = ", ".join(map(str, numbers[:_NAMED]))
    more = f" and {len(numbers) - _NAMED} more" if len(numbers) > _NAMED else ""
    return f" ({of}{'s' if len(numbers) > 1 else ''} {named}{more})"
