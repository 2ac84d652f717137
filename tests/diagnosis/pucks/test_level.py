"""What may be named beside another effect, and when a name is dropped."""

from dataclasses import dataclass, field, replace

import pytest
from slapshot.diagnosis.pucks.headline import names_hold
from slapshot.diagnosis.pucks.level import LEAST_SHIFT, least_gain, least_shift, without_hidden
from slapshot.diagnosis.pucks.search import ADD
from slapshot.diagnosis.pucks.verdict import Errors, Interval


@dataclass(frozen=True)
class Named:
    """A candidate, as far as these rules look at it."""

    effects: tuple[str, ...]


@dataclass
class Told:
    """A search: law errors, shifts in m and gains in nats by effect."""

    law: dict[str, float]
    moves: dict[str, float]
    gains: dict[str, float]
    deleted: list[str] = field(default_factory=list)

    def known_to(self, name):
        return self.law[name]

    def shift(self, at, name):
        return self.moves[name]

    def gain(self, at, name):
        return self.gains[name]

    def without(self, at, name):
        self.deleted.append(name)
        return Named(tuple(n for n in at.effects if n != name))


def told(companion_moves, companion_gain, law=0.15):
    return Told(
        {"tilt": law, "curl": 0.15},
        {"tilt": 0.1, "curl": companion_moves},
        {"tilt": 2000.0, "curl": companion_gain},
    )


BOTH = Named(("curl", "tilt"))


@pytest.mark.parametrize(
    ("moves", "gain", "kept"),
    [(0.02, 60.0, True), (0.01, 60.0, False), (0.02, 40.0, False)],  # of 15 mm and 45 nats
)
def test_a_companion_must_do_more_than_the_law_beside_it_errs_by(moves, gain, kept):
    search = told(moves, gain)
    assert (without_hidden(search, BOTH) == BOTH) == kept
    assert search.deleted == ([] if kept else ["curl"])


def test_beside_an_exact_law_anything_that_matters_may_be_named():
    search = told(0.004, 5.0, law=0.0)
    assert least_shift(search, BOTH, "curl") == LEAST_SHIFT
    assert least_gain(search, BOTH, "curl") == ADD
    # The tilt must still do more than the curl's law errs by.
    assert without_hidden(search, BOTH) == BOTH


def test_law_errors_add_up_as_independent_ones():
    search = told(0.02, 60.0)
    squares = LEAST_SHIFT**2 + (0.15 * 0.1) ** 2 + (0.15 * 0.02) ** 2
    assert least_shift(search, BOTH) == pytest.approx(squares**0.5)
    assert least_gain(search, BOTH) == pytest.approx(0.15**2 * 2060)


def errors(rest):
    same = Interval(0.01, 0.009, 0.011)
    return Errors(same, rest, None, Interval(1.0, 0.5, 1.5), Interval(1.0, 0.9, 1.1))


def test_a_name_that_makes_an_error_larger_than_its_interval_without_it_does_not_hold():
    before = errors(Interval(0.0077, 0.006, 0.0092))
    fit = {"refitted": before, "augmented": replace(before, rest_rmse_m=Interval(0.0093, 0.007, 0.012))}
    assert not names_hold(fit)
    assert names_hold(fit | {"augmented": replace(before, rest_rmse_m=Interval(0.0091, 0.007, 0.012))})
