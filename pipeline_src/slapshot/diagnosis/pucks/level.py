"""One level of a diagnosis: slides, or launches given the slides; whether and what each of them lacks."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from slapshot.diagnosis.pucks.judgement import LEFT, mismatch_of, unknown_of
from slapshot.diagnosis.pucks.search import ADD, CLASS, Candidate, Screen, Search
from slapshot.diagnosis.pucks.trial import dropped_note
from slapshot.diagnosis.pucks.verdict import Mismatch, Unknown

LEAST_SHIFT = 0.003  # m, rms of rest points: less is not called missing physics
P_VALUE = 0.002  # of slides, and of launches: one of two tests
LEAST_EVIDENCE = 2.0  # nats
LEFT_OPEN = 0.08  # of the evidence for what was named: less is how effects differ from what they stand for
LEAK_OF_FIELDS = 0.1  # of the evidence for fields, which hold what they stand for only coarsely


@dataclass(frozen=True)
class Level:
    """One part of a diagnosis: slides, or launches given the slides.

    Attributes:
        search: with its fitter and all that was refitted.
        nominal, final: fits without and with the effects that were found.
        screen, leftover: of all hypotheses at those fits.
        mismatch: of this part.
        feigned: nats that what is wrong with the level before may feign in this one.
    """

    search: Search[Any]
    nominal: Candidate
    final: Candidate
    screen: Screen
    leftover: Screen
    mismatch: Mismatch
    feigned: float = 0.0

    @property
    def notes(self) -> tuple[str, ...]:
        """Hypotheses that failed."""
        return tuple(dropped_note(name, why) for name, why in self.search.failed.items())

    def without_names(self) -> "Level":
        """The same where what was named does not hold: nothing is named, and all of it is left over."""
        return replace(self, final=self.nominal, leftover=self.screen)

    @property
    def unknown(self) -> Unknown:
        """What the catalogue does not explain."""
        least = max(ADD + CLASS, LEFT_OPEN * self.final.log_evidence) + self.feigned
        if not self.mismatch.found:
            least = float("inf")
        return unknown_of(self.search, self.leftover, least, LEAST_SHIFT, self.stretched)

    @property
    def leak(self) -> float:
        """Nats that what is wrong with this level's explanation may feign in the next one."""
        share = LEAK_OF_FIELDS if any(self.search.is_field(n) for n in self.final.effects) else LEFT
        return share * self.final.log_evidence

    @property
    def stretched(self) -> bool:
        """Whether two fields, which bend to almost anything, were needed where one free form says more."""
        fields = [n for n in self.final.effects if self.search.is_field(n)]
        evidence = self.screen.log_evidence
        free = max(evidence[n] for n in self.search.free)
        return len(fields) > 1 and free > max(evidence[n] for n in fields) + CLASS


def examine(search: Search[Any], before: "Level | None" = None) -> Level:
    """Whether something is missing, and if so what; `before` is the level that this one stands on."""
    nominal = search.seen.get(()) or search.nominal()
    screen = search.screen(nominal, [*search.catalogue, *search.free])
    feigned = before.leak if before else 0.0
    mismatch = mismatch_of(screen, P_VALUE, LEAST_EVIDENCE + feigned, LEAST_SHIFT)
    final, leftover = nominal, screen
    if mismatch.found:
        final, leftover = _search(search, nominal, screen, feigned)
        final = search.settle(final)
    return Level(search, nominal, final, screen, leftover, mismatch, feigned)


def _search(
    search: Search[Any], nominal: Candidate, screen: Screen, feigned: float
) -> tuple[Candidate, Screen]:
    """Add effects while the recording asks for them, then delete what became superfluous."""
    best = search.grow(nominal, screen, search.catalogue)[0]
    if best.log_evidence < LEAST_EVIDENCE + feigned:
        return nominal, screen
    leftover = search.screen_beyond(best)
    while len(best.effects) < search.most:
        further = [n for n in search.catalogue if n not in best.effects]
        if not further:
            break
        strongest = leftover.best(further)[0]
        # A screen is linear: what falls short of ADD by a class may still gain it in a refit.
        least = max(ADD, LEFT * best.log_evidence) + feigned
        asked = leftover.log_evidence[strongest] > least - CLASS and leftover.p_value < P_VALUE
        if not asked or leftover.shift[strongest] < LEAST_SHIFT:
            break
        grown = search.grow(best, leftover, further)[0]
        if grown.log_evidence < best.log_evidence + least:
            break
        best = search.prune(grown)
        leftover = search.screen_beyond(best)
    return best, leftover


def refuted_notes(tried: Sequence[Level], kept: Sequence[Level]) -> tuple[str, ...]:
    """A line on what was tried as a name and does not hold."""
    names = [name for a, b in zip(tried, kept, strict=True) for name in a.final.effects if a is not b]
    if not names:
        return ()
    said = " with ".join(name.replace("_", " ") for name in names)
    return (
        f"{said} fitted best, but with it held-out hits are predicted worse than by the nominal scene: "
        "it is not named",
    )
