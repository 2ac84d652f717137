"""`python -m slapshot.blind_validation.lists FILE`: draw a list of cases under seeds of the system.

The conditions of the proof, and how the cases of a list are drawn for them.
"""

import secrets
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from slapshot.blind_validation.cases import Case, write_cases
from slapshot.case_list import draw_command, write_new
from slapshot.lab.concealed.hidden_effect import HiddenEffect
from slapshot.lab.concealed.registry import HIDDEN_EFFECTS

Conceals = tuple[tuple[str, float], ...]  # kind and displacement

PLAIN = (0.5, 2.0)  # displacement over the hit-to-hit scatter
WEAK = (0.2, 0.5)


def _slides(kind: HiddenEffect) -> bool:
    return kind.catalogued and kind.phase in ("slide", "across hits", "camera")


def _launches(kind: HiddenEffect) -> bool:
    return kind.catalogued and kind.phase in ("swing", "contact")


def _uncatalogued(kind: HiddenEffect) -> bool:
    return not kind.catalogued


@dataclass(frozen=True)
class Condition:
    """A kind of case.

    Attributes:
        name: as in proof.csv.
        count: of cases for each kind, or of all where nothing is concealed or two kinds are.
        among: kinds that are concealed in turn; None for nothing.
        sizes: lowest and highest displacement, between which one is drawn on a logarithmic scale.
        together: kinds concealed in one case.
        kinds: how many of them, drawn by chance; None for all.
        how: how the case is recorded, where it is not as usual.
    """

    name: str
    count: int
    among: Callable[[HiddenEffect], bool] | None = None
    sizes: tuple[float, float] = PLAIN
    together: int = 1
    kinds: int | None = None
    how: Mapping[str, Any] = field(default_factory=dict)

    def conceals(self, rng: np.random.Generator) -> Iterator[Conceals]:
        """What each case conceals."""
        if self.among is None:
            yield from ((),) * self.count
            return
        kinds = [name for name, kind in HIDDEN_EFFECTS.items() if self.among(kind)]
        if self.kinds is not None:
            kinds = rng.permutation(kinds)[: self.kinds].tolist()
        if self.together == 1:
            chosen = [[name] for name in kinds for _ in range(self.count)]
        else:
            chosen = [rng.choice(kinds, self.together, replace=False).tolist() for _ in range(self.count)]
        low, high = np.log(self.sizes)
        for names in chosen:
            sizes = np.exp(rng.uniform(low, high, len(names)))
            yield tuple((n, round(float(s), 3)) for n, s in zip(names, sizes, strict=True))


TRACKS_ONLY = {"keep": "tracks only"}
RESTS_ONLY = {"keep": "rest points only"}
_FULL = (
    Condition("null", 200),
    Condition("null, 400 hits", 20, how={"hits": 400}),
    Condition("null, 1 % mistracks", 20, how={"mistracks": 0.01}),
    Condition("null, coloured noise", 20, how={"noise_time": 0.04}),
    Condition("null, tracks only", 20, how=TRACKS_ONLY),
    Condition("null, rest points only", 50, how=RESTS_ONLY),
    Condition("plain", 4, _slides),
    Condition("weak", 3, _slides, WEAK),
    Condition("launch", 3, _launches, how={"hits": 100}),
    Condition("launch, no encoders", 2, _launches, how={"hits": 100, "keep": "no encoders"}),
    Condition("pairs", 30, lambda kind: kind.catalogued, together=2),
    Condition("uncatalogued", 5, _uncatalogued),
    Condition("plain, 25 hits", 1, _slides, how={"hits": 26}),
    Condition("plain, 50 hits", 1, _slides, how={"hits": 50}),
    Condition("plain, 100 hits", 1, _slides, how={"hits": 100}),
    Condition("plain, 400 hits", 1, _slides, how={"hits": 400}),
    Condition("plain, tracks only", 1, _slides, how=TRACKS_ONLY),
    Condition("plain, rest points only", 2, _slides, how=RESTS_ONLY),
)


_SMALL = (
    Condition("null", 5),
    Condition("plain", 1, _slides, kinds=6),
    Condition("weak", 1, _slides, WEAK, kinds=2),
    Condition("launch", 1, _launches, how={"hits": 100}, kinds=3),
    Condition("pairs", 1, lambda kind: kind.catalogued, together=2),
    Condition("uncatalogued", 1, _uncatalogued, kinds=1),
    Condition("plain, tracks only", 1, _slides, how=TRACKS_ONLY, kinds=1),
    Condition("plain, rest points only", 1, _slides, how=RESTS_ONLY, kinds=1),
)
_TINY = (
    Condition("null", 1, how={"hits": 16}),
    Condition("plain", 1, lambda kind: kind.name == "tilt", how={"hits": 16}),
)
LISTS: Mapping[str, Sequence[Condition]] = {"full": _FULL, "small": _SMALL, "tiny": _TINY}


def draw_list(conditions: Sequence[Condition], prefix: str) -> list[Case]:
    """Cases under new seeds of the operating system, in random order and called by their numbers."""
    rng = np.random.default_rng(secrets.randbits(128))
    rows = [(c, conceals) for c in conditions for conceals in c.conceals(rng)]
    cases = []
    for number, i in enumerate(rng.permutation(len(rows))):
        condition, conceals = rows[i]
        name = f"{prefix}{number:04d}"
        cases.append(Case(name, condition.name, secrets.randbits(48), conceals, **condition.how))
    return cases


def draw_file(which: str, file: Path) -> None:
    """Draw a list into a file that does not exist yet.

    Raises:
        InputError: the file exists, or cannot be written.
    """
    write_new(file, lambda aside: write_cases(draw_list(LISTS[which], which[0]), aside))


if __name__ == "__main__":
    draw_command("slapshot.blind_validation.lists", LISTS, draw_file)
