"""`python -m slapshot.lab.joints.lists FILE`: draw a list of cases, seeds from the operating system."""

import secrets
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slapshot.case_list import draw_command, write_new
from slapshot.lab.joints.case_specs import Case, Colour, Condition, Order, write_cases
from slapshot.lab.joints.noise import CORRELATION
from slapshot.lab.joints.record_case import SIZES, TOGETHER_NEVER
from slapshot.lab.joints.registry import HIDDEN_EFFECTS
from slapshot.lab.joints.rigs import rig_named

_RIGS = {"pendulum": 0.42, "arm": 0.46, "kuka": 0.12}  # shares; a KUKA takes as long as four arms
_COLOURS = (0.5, 0.25, 0.25)  # shares of white noise and of noise with correlation times of 20 and 100 ms
_QUANTISED = (0.15, (5e-4, 1e-3, 2e-3))  # share of recordings with coarse encoders, and their steps in rad


@dataclass(frozen=True)
class _Group:
    """Cases of one condition.

    Attributes:
        condition: in words.
        count: of cases.
        together: kinds concealed in one case.
        catalogued: which kinds.
        cluttered: see `noise.Condition`.
    """

    condition: str
    count: int
    together: int = 0
    catalogued: bool = True
    cluttered: bool = False

    def conceals(self, rng: np.random.Generator) -> Iterator[tuple[str, tuple[str, ...]]]:
        """Rig and kinds of each case: all kinds in turn."""
        names = [name for name, kind in HIDDEN_EFFECTS.items() if kind.catalogued == self.catalogued]
        turn: list[str] = []
        for _ in range(self.count):
            rig = str(rng.choice(list(_RIGS), p=list(_RIGS.values())))
            if self.together == 0:
                yield rig, ()
                continue
            turn = turn or rng.permutation(names).tolist()
            first = turn.pop()
            while not HIDDEN_EFFECTS[first].fits(rig_named(rig)):
                rig = str(rng.choice(list(_RIGS), p=list(_RIGS.values())))
            others = [n for n in names if HIDDEN_EFFECTS[n].fits(rig_named(rig)) and n != first]
            others = [n for n in others if {n, first} != TOGETHER_NEVER]
            yield rig, (first, *rng.choice(others, self.together - 1, replace=False).tolist())


_EPISODES = 10  # of a session: with twenty, the full list takes ten hours of a core

_FULL = (
    _Group("null", 102),
    _Group("null, cluttered", 51, cluttered=True),
    _Group("single", 104, together=1),
    _Group("pair", 40, together=2),
    _Group("uncatalogued", 42, together=1, catalogued=False),
)
_SMALL = (
    _Group("null", 4),
    _Group("null, cluttered", 2, cluttered=True),
    _Group("single", 12, together=1),
    _Group("pair", 3, together=2),
    _Group("uncatalogued", 3, together=1, catalogued=False),
)
LISTS: Mapping[str, Sequence[_Group]] = {"full": _FULL, "small": _SMALL}


def draw_list(groups: Sequence[_Group], prefix: str) -> list[Case]:
    """Cases under new seeds of the operating system, in random order and called by their numbers."""
    rng = np.random.default_rng(secrets.randbits(128))
    rows = [(group, *conceals) for group in groups for conceals in group.conceals(rng)]
    colours: list[Colour] = list(CORRELATION)
    cases = []
    for number, i in enumerate(rng.permutation(len(rows))):
        group, rig, kinds = rows[i]
        sizes = np.exp(rng.uniform(np.log(SIZES[0]), np.log(SIZES[1]), len(kinds)))
        share, steps = _QUANTISED
        condition = Condition(
            noise=colours[rng.choice(len(colours), p=_COLOURS)],
            cluttered=group.cluttered,
            quantised=float(rng.choice(steps)) if rng.uniform() < share else None,
        )
        conceals = tuple((kind, float(f"{size:.3g}")) for kind, size in zip(kinds, sizes, strict=True))
        order = Order(rig, secrets.randbits(48), conceals, condition, _EPISODES)
        cases.append(Case(f"{prefix}{number:04d}", group.condition, order))
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
