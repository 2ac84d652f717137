"""Whether a recording's hits show that something is missing, and what."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from slapshot.diagnosis.pucks.selection.judgement import mismatch_of, unknown_of
from slapshot.diagnosis.pucks.selection.search import ADD, CLASS, Candidate, Screen, Search
from slapshot.diagnosis.pucks.selection.trial import dropped_note
from slapshot.diagnosis.pucks.verdict import Mismatch, Unknown

LEAST_SHIFT = 0.003  # m, rms of rest points: less is real where a test says so, and small
P_VALUE = 0.01
LEAST_EVIDENCE = 2.0  # nats
FORMS = 2  # free forms that are refitted
LINEAR = 0.5  # of what a refit finds may be missing from what a linear screen promises


@dataclass(frozen=True)
class Level:
    """What was made of the hits: of their tracks, or of rest points alone.

    Attributes:
        search: with its fitter and all that was refitted.
        nominal, final: fits without and with the effects that were found.
        screen, leftover: of all hypotheses at those fits.
        mismatch: whether anything is missing.
        refuted: effects that would have been named, had a free form not explained more by itself.
    """

    search: Search[Any]
    nominal: Candidate
    final: Candidate
    screen: Screen
    leftover: Screen
    mismatch: Mismatch
    refuted: tuple[str, ...] = ()

    @property
    def notes(self) -> tuple[str, ...]:
        """Hypotheses that failed, and names that would have been given."""
        notes = tuple(dropped_note(name, why) for name, why in self.search.failed.items())
        if unreached := sorted(self.search.unreached):
            names = ", ".join(unreached).replace("_", " ")
            notes = (*notes, f"no object came where {names} could act: nothing is said of them")
        if not self.refuted:
            return notes
        names = _listed(self.refuted)
        return (*notes, f"{names}: what has no name explains more by itself, so that nothing is named")

    def without_names(self) -> "Level":
        """The same where what was named does not hold: nothing is named, and all of it is left over."""
        return replace(self, final=self.nominal, leftover=self.screen)

    def without_weakest_name(self) -> "Level":
        """The same without the name that gains least; without any, what it explained is left over."""
        if len(self.final.effects) == 1:
            return self.without_names()
        final = self.search.settle(self.search.without(self.final, self.weakest_name))
        return replace(self, final=final, leftover=self.search.screen_beyond(final))

    @property
    def weakest_name(self) -> str:
        """The name that gains least."""
        return min(self.final.effects, key=lambda n: self.search.gain(self.final, n))

    @property
    def unknown(self) -> Unknown:
        """What the catalogue does not explain."""
        search, at = self.search, self.final
        least = CLASS + least_gain(search, at) if self.mismatch.found else float("inf")
        found = unknown_of(search, self.leftover, least, least_shift(search, at))
        form = self.leftover.best(search.free)[0]
        reachable = [n for n in at.effects if search.gain_beyond(at, form, n)]
        if found.flagged or not self.mismatch.found or not reachable:
            return found
        # By data that errors of those laws do not reach it may show all the same, once it is fitted.
        if self.leftover.log_evidence[form] <= CLASS + ADD:
            return found
        fitted = search.try_adding(at, form, self.leftover.direction)
        if fitted is None:
            return found
        # What still errs counts as it did without the form, which may have taken a part of its place.
        erring = _erring(search, fitted, form)
        least, shift = CLASS + _gain_of_errors(search, at, erring), _shift_of_errors(search, at, erring)
        return unknown_of(search, self.leftover, least, shift)


def examine(search: Search[Any]) -> Level:
    """Whether something is missing, and if so what."""
    nominal = search.seen.get(()) or search.nominal()
    screen = search.screen(nominal, [*search.catalogue, *search.free])
    mismatch = mismatch_of(screen, P_VALUE, LEAST_EVIDENCE)
    final, leftover = nominal, screen
    if mismatch.found:
        final, leftover = _search(search, nominal, screen)
        final = search.settle(final)
    level = Level(search, nominal, final, screen, leftover, mismatch)
    if final.effects and unnamed_explains_more(search, nominal, screen, final):
        level = replace(level.without_names(), refuted=final.effects)
    return level


def unnamed_explains_more(search: Search[Any], nominal: Candidate, screen: Screen, final: Candidate) -> bool:
    """Whether a free form by itself explains more than all names do, and than their laws may err by."""
    least = CLASS + least_gain(search, final)
    for name in screen.best(search.free)[:FORMS]:
        if screen.log_evidence[name] > LINEAR * final.log_evidence:
            form = search.try_adding(nominal, name, screen.direction)
            if form is not None and search.ahead(form, final) > least:
                return True
    return False


def _erring(search: Search[Any], at: Candidate, beside: str) -> list[str]:
    """Effects of a fit of whose laws errors could be what is taken for `beside`."""
    return [n for n in at.effects if n != beside and not (beside and search.gain_beyond(at, beside, n) > ADD)]


def least_shift(search: Search[Any], at: Candidate, beside: str = "") -> float:
    """m, rms of tracks, that something beside a fit's effects must move: their own laws may err by less."""
    return _shift_of_errors(search, at, _erring(search, at, beside))


def least_gain(search: Search[Any], at: Candidate, beside: str = "") -> float:
    """Nats that something beside a fit's effects must add: what their laws err by leaves less.

    Evidence is a square: of a law that errs by a share, it leaves the square of that share.
    """
    return _gain_of_errors(search, at, _erring(search, at, beside))


def _shift_of_errors(search: Search[Any], at: Candidate, erring: Sequence[str]) -> float:
    errors = [search.known_to(n) * search.shift(at, n) for n in erring]
    return float(np.hypot(LEAST_SHIFT, np.linalg.norm(errors)))


def _gain_of_errors(search: Search[Any], at: Candidate, erring: Sequence[str]) -> float:
    return max(ADD, sum(search.known_to(n) ** 2 * search.gain(at, n) for n in erring))


def without_hidden(search: Search[Any], at: Candidate) -> Candidate:
    """A fit without those effects that what the others' laws err by would hide."""
    if len(at.effects) == 1:
        return at
    for name in sorted(at.effects, key=lambda n: search.gain(at, n)):
        moves = search.shift(at, name) > least_shift(search, at, name)
        if not moves or search.gain(at, name) < least_gain(search, at, name):
            return without_hidden(search, search.without(at, name))
    return at


def _search(search: Search[Any], nominal: Candidate, screen: Screen) -> tuple[Candidate, Screen]:
    """Add effects while the recording asks for them, then delete what became superfluous."""
    best = search.grow(nominal, screen, search.catalogue)[0]
    if best.log_evidence < LEAST_EVIDENCE or search.at_bound(best):
        return nominal, screen
    leftover, refused = search.screen_beyond(best), set[str]()
    while len(best.effects) < search.most and leftover.p_value <= P_VALUE:
        further = [
            n for n in search.catalogue if n not in refused and _may_be_added(search, best, leftover, n)
        ]
        if not further:
            break
        grown = search.grow(best, leftover, further)[0]
        tried = {n for n in further if tuple(sorted((*best.effects, n))) in search.seen}
        added = next(iter(set(grown.effects) - set(best.effects)), further[0])
        pruned = best
        # Among many that are tried some pass by chance: after the best ones only what is told apart.
        passes = not refused or (added in grown.effects and not _erring(search, grown, added))
        passes = passes and not search.at_bound(grown)
        if passes and search.ahead(grown, best) >= least_gain(search, best, added):
            pruned = _exchanged(search, grown)
        if set(pruned.effects) <= set(best.effects):
            # Another one may still pass: of which less is asked beside what is there.
            refused |= {added, *tried}
            continue
        best, refused = pruned, set()
        leftover = search.screen_beyond(best)
    return best, leftover


def _exchanged(search: Search[Any], grown: Candidate) -> Candidate:
    """A fit with rivals in place of its effects where they explain more, without what is then superfluous."""
    while True:
        whole = search.exchange(grown)
        left = without_hidden(search, search.prune(whole))
        if len(left.effects) == 1 or left.effects == whole.effects:
            return left
        grown = left


def _may_be_added(search: Search[Any], best: Candidate, leftover: Screen, name: str) -> bool:
    """Whether an effect promises enough; a screen is linear, and a refit may find more."""
    if name in best.effects or leftover.shift[name] <= LINEAR * least_shift(search, best, name):
        return False
    # Two fields bend to almost anything: what one of them leaves is for a free form to describe.
    if search.is_field(name) and any(search.is_field(n) for n in best.effects):
        return False
    least = least_gain(search, best, name)
    return leftover.log_evidence[name] >= least - max(CLASS, LINEAR * least)


def refuted_note(level: Level) -> str:
    """A line on the name that goes first where names do not hold."""
    name = level.weakest_name
    others = [n for n in level.final.effects if n != name]
    tried = f"beside {_listed(others)}, but with all of them" if others else "best, but with it"
    return (
        f"{_listed([name])} fitted {tried} held-out hits are predicted worse than by the nominal scene: "
        "it is not named"
    )


def _listed(effects: Sequence[str]) -> str:
    return " with ".join(name.replace("_", " ") for name in effects)
