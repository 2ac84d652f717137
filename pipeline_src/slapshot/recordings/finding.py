"""A finding: something odd in a recording that is valid all the same."""

from collections.abc import Iterable
from dataclasses import dataclass

_NAMED = 6  # hits that a text names one by one


@dataclass(frozen=True)
class Finding:
    """What is odd, where, and why a diagnosis should know.

    Attributes:
        what: one sentence with numbers.
        where: numbers of the hits; empty where the whole recording is meant.
        why: what a diagnosis may take it for, or cannot tell because of it.
    """

    what: str
    where: tuple[int, ...]
    why: str

    def __str__(self) -> str:
        """What, which hits, and why, in one line."""
        return f"{self.what}{_hits(self.where)} - {self.why}"


def _hits(where: Iterable[int]) -> str:
    numbers = list(where)
    if not numbers:
        return ""
    named = ", ".join(map(str, numbers[:_NAMED]))
    more = f" and {len(numbers) - _NAMED} more" if len(numbers) > _NAMED else ""
    return f" (hit{'s' if len(numbers) > 1 else ''} {named}{more})"
