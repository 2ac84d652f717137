"""`python -m slapshot.lab.joints.lists FILE`: draw a list of cases, seeds from the operating system."""

import secrets
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slapshot.case_list import draw_command, write_new
from slapshot.lab.joints.case_spec import CaseSpec, Colour, MeasurementCondition
from slapshot.lab.joints.cases import Case, write_cases
from slapshot.lab.joints.noise import CORRELATION
from slapshot.lab.joints.record_case import INCOMPATIBLE, SIZES
from slapshot.lab.joints.registry import HIDDEN_EFFECTS
from slapshot.lab.joints.rigs import rig_named

_RIGS = {"pendulum": 0.42, "arm": 0.46, "kuka": 0.12}  # shares; a KUKA takes as long as four arms
_COLOURS = (0.5, 0.25, 0.25)  # shares of white noise and of noise with correlation times of 20 and 100 ms
_QUANTISED = (0.15, (5e-4, 1e-3, 2e-3))  # share of recordings with coarse encoders, and their steps in rad


@dataclass(frozen=True)
class CaseGroup:
    """Cases of one condition.

    Attributes:
        condition: in words.
        count: of cases.
        effects_per_case: number of hidden effects in one case.
        catalogued: whether they are catalogued.
        cluttered: see `noise.Condition`.
    """

    condition: str
    count: int
    effects_per_case: int = 0
    catalogued: bool = True
    cluttered: bool = False

    def conceals(self, rng: np.random.Generator) -> Iterator[tuple[str, tuple[str, ...]]]:
        """Rig and hidden effects of each case; all effects in turn."""
        names = [name for name, effect in HIDDEN_EFFECTS.items() if effect.catalogued == self.catalogued]
        turn: list[str] = []
        for _ in range(self.count):
            rig = str(rng.choice(list(_RIGS), p=list(_RIGS.values())))
            if self.effects_per_case == 0:
                yield rig, ()
                continue
            turn = turn or rng.permutation(names).tolist()
            first = turn.pop()
            while not HIDDEN_EFFECTS[first].fits(rig_named(rig)):
                rig = str(rng.choice(list(_RIGS), p=list(_RIGS.values())))
            others = [n for n in names if HIDDEN_EFFECTS[n].fits(rig_named(rig)) and n != first]
            others = [n for n in others if {n, first} != INCOMPATIBLE]
            yield rig, (first, *rng.choice(others, self.effects_per_case - 1, replace=False).tolist())


_EPISODES = 10  # of a session: with twenty, the full list takes ten hours of a core

_FULL = (
    CaseGroup("null", 102),
    CaseGroup("null, cluttered", 51, cluttered=True),
    CaseGroup("single", 104, effects_per_case=1),
    CaseGroup("pair", 40, effects_per_case=2),
    CaseGroup("uncatalogued", 42, effects_per_case=1, catalogued=False),
)
_SMALL = (
    CaseGroup("null", 4),
    CaseGroup("null, cluttered", 2, cluttered=True),
    CaseGroup("single", 12, effects_per_case=1),
    CaseGroup("pair", 3, effects_per_case=2),
    CaseGroup("uncatalogued", 3, effects_per_case=1, catalogued=False),
)
LISTS: Mapping[str, Sequence[CaseGroup]] = {"full": _FULL, "small": _SMALL}


def draw_list(groups: Sequence[CaseGroup], prefix: str) -> list[Case]:
    """Cases under new seeds of the operating system, in random order and called by their numbers."""
    rng = np.random.default_rng(secrets.randbits(128))
    rows = [(group, *conceals) for group in groups for conceals in group.conceals(rng)]
    colours: list[Colour] = list(CORRELATION)
    cases = []
    for number, i in enumerate(rng.permutation(len(rows))):
        group, rig, kinds = rows[i]
        sizes = np.exp(rng.uniform(np.log(SIZES[0]), np.log(SIZES[1]), len(kinds)))
        share, steps = _QUANTISED
        condition = MeasurementCondition(
            noise=colours[rng.choice(len(colours), p=_COLOURS)],
            cluttered=group.cluttered,
            quantised=float(rng.choice(steps)) if rng.uniform() < share else None,
        )
        conceals = tuple((effect, float(f"{size:.3g}")) for effect, size in zip(kinds, sizes, strict=True))
        spec = CaseSpec(rig, secrets.randbits(48), conceals, condition, _EPISODES)
        cases.append(Case(f"{prefix}{number:04d}", group.condition, spec))
    return cases


def draw_file(which: str, file: Path) -> None:
    """Draw a list into a file that does not exist yet.

    Raises:
        InputError: the file exists, or cannot be written.
    """
    prefix = "j" if which == "full" else "k"
    write_new(file, lambda aside: write_cases(draw_list(LISTS[which], prefix), aside))


if __name__ == "__main__":
    draw_command("slapshot.lab.joints.lists", LISTS, draw_file)
