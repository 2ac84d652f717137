"""`python -m slapshot.blind_validation.lists FILE`: draw a list of cases under seeds of the system.

Conditions of the blind validation, and how the cases of a list are drawn for them.
"""

import secrets
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from slapshot.blind_validation.cases import Case, write_cases
from slapshot.case_list import draw_command, write_new
from slapshot.lab.hidden_effects.hidden_effect import HiddenEffect
from slapshot.lab.hidden_effects.registry import HIDDEN_EFFECTS

Conceals = tuple[tuple[str, float], ...]  # kind and displacement

TYPICAL_SIZES = (0.5, 2.0)  # displacement over the hit-to-hit scatter
WEAK_SIZES = (0.2, 0.5)


def _acts_on_slide(kind: HiddenEffect) -> bool:
    return kind.catalogued and kind.phase in ("slide", "across hits", "camera")


def _acts_on_launch(kind: HiddenEffect) -> bool:
    return kind.catalogued and kind.phase in ("swing", "contact")


def _uncatalogued(kind: HiddenEffect) -> bool:
    return not kind.catalogued


@dataclass(frozen=True)
class CaseGroup:
    """Cases of one condition.

    Attributes:
        name: as in proof.csv.
        count: cases for each hidden effect, or in total for nulls and pairs.
        candidates: hidden effects to choose from, in turn; None for nulls.
        sizes: lowest and highest displacement of a log-uniform draw.
        effects_per_case: number of hidden effects in one case.
        kinds: how many candidates are drawn; None for all.
        overrides: attributes of `Case` that differ from their defaults.
    """

    name: str
    count: int
    candidates: Callable[[HiddenEffect], bool] | None = None
    sizes: tuple[float, float] = TYPICAL_SIZES
    effects_per_case: int = 1
    kinds: int | None = None
    overrides: Mapping[str, Any] = field(default_factory=dict)

    def conceals(self, rng: np.random.Generator) -> Iterator[Conceals]:
        """Hidden effects of each case."""
        if self.candidates is None:
            yield from ((),) * self.count
            return
        kinds = [name for name, kind in HIDDEN_EFFECTS.items() if self.candidates(kind)]
        if self.kinds is not None:
            kinds = rng.permutation(kinds)[: self.kinds].tolist()
        if self.effects_per_case == 1:
            chosen = [[name] for name in kinds for _ in range(self.count)]
        else:
            chosen = [
                rng.choice(kinds, self.effects_per_case, replace=False).tolist() for _ in range(self.count)
            ]
        low, high = np.log(self.sizes)
        for names in chosen:
            sizes = np.exp(rng.uniform(low, high, len(names)))
            yield tuple((n, round(float(s), 3)) for n, s in zip(names, sizes, strict=True))


TRACKS_ONLY = {"keep": "tracks only"}
RESTS_ONLY = {"keep": "rest points only"}
CLUTTER = {"mistracks": 0.01, "noise_time": 0.04, "jitter": 0.1, "outliers": 0.05}
_FULL = (
    CaseGroup("null", 150),
    CaseGroup("null, cluttered", 100, overrides=CLUTTER),
    CaseGroup("null, 1 % mistracks", 10, overrides={"mistracks": 0.01}),
    CaseGroup("null, coloured noise", 10, overrides={"noise_time": 0.04}),
    CaseGroup("null, 400 hits", 6, overrides={"hits": 400}),
    CaseGroup("null, tracks only", 20, overrides=TRACKS_ONLY),
    CaseGroup("null, rest points only", 20, overrides=RESTS_ONLY),
    CaseGroup("plain", 4, _acts_on_slide),
    CaseGroup("weak", 1, _acts_on_slide, WEAK_SIZES),
    CaseGroup("launch", 3, _acts_on_launch, overrides={"hits": 100}),
    CaseGroup("launch, no encoders", 1, _acts_on_launch, overrides={"hits": 100, "keep": "no encoders"}),
    CaseGroup("pairs", 30, lambda kind: kind.catalogued, effects_per_case=2),
    CaseGroup("uncatalogued", 5, _uncatalogued),
    CaseGroup("plain, 25 hits", 1, _acts_on_slide, overrides={"hits": 26}),
    CaseGroup("plain, 50 hits", 1, _acts_on_slide, overrides={"hits": 50}),
    CaseGroup("plain, 100 hits", 1, _acts_on_slide, overrides={"hits": 100}),
    CaseGroup("plain, 400 hits", 1, _acts_on_slide, overrides={"hits": 400}, kinds=5),
    CaseGroup("plain, tracks only", 1, _acts_on_slide, overrides=TRACKS_ONLY),
    CaseGroup("plain, rest points only", 2, _acts_on_slide, overrides=RESTS_ONLY),
)


_SMALL = (
    CaseGroup("null", 5),
    CaseGroup("plain", 1, _acts_on_slide, kinds=6),
    CaseGroup("weak", 1, _acts_on_slide, WEAK_SIZES, kinds=2),
    CaseGroup("launch", 1, _acts_on_launch, overrides={"hits": 100}, kinds=3),
    CaseGroup("pairs", 1, lambda kind: kind.catalogued, effects_per_case=2),
    CaseGroup("uncatalogued", 1, _uncatalogued, kinds=1),
    CaseGroup("plain, tracks only", 1, _acts_on_slide, overrides=TRACKS_ONLY, kinds=1),
    CaseGroup("plain, rest points only", 1, _acts_on_slide, overrides=RESTS_ONLY, kinds=1),
)
_TINY = (
    CaseGroup("null", 1, overrides={"hits": 16}),
    CaseGroup("plain", 1, lambda kind: kind.name == "tilt", overrides={"hits": 16}),
)
LISTS: Mapping[str, Sequence[CaseGroup]] = {"full": _FULL, "small": _SMALL, "tiny": _TINY}


def draw_list(conditions: Sequence[CaseGroup], prefix: str) -> list[Case]:
    """Cases under new seeds of the operating system, in random order and called by their numbers."""
    rng = np.random.default_rng(secrets.randbits(128))
    rows = [(c, conceals) for c in conditions for conceals in c.conceals(rng)]
    cases = []
    for number, i in enumerate(rng.permutation(len(rows))):
        condition, conceals = rows[i]
        name = f"{prefix}{number:04d}"
        cases.append(Case(name, condition.name, secrets.randbits(48), conceals, **condition.overrides))
    return cases


def draw_file(which: str, file: Path) -> None:
    """Draw a list into a file that does not exist yet.

    Raises:
        InputError: the file exists, or cannot be written.
    """
    write_new(file, lambda aside: write_cases(draw_list(LISTS[which], which[0]), aside))


if __name__ == "__main__":
    draw_command("slapshot.blind_validation.lists", LISTS, draw_file)
