"""A diagnosis that could tell something: what figures and the Rerun recording are made from."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import pandas as pd

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.fit.hit_fit import HitFitter
from slapshot.diagnosis.pucks.launch.launch_model import LaunchModel
from slapshot.diagnosis.pucks.report.predictions import Predicted, predict
from slapshot.diagnosis.pucks.report.residuals import arrow_table
from slapshot.diagnosis.pucks.result import Diagnosis
from slapshot.diagnosis.pucks.selection.level import Level
from slapshot.diagnosis.pucks.selection.search import Candidate, Screen, Search
from slapshot.diagnosis.pucks.verdict import Verdict
from slapshot.effects.catalogue import catalogue
from slapshot.effects.effect import Effect


@dataclass(frozen=True)
class Launches:
    """Launches of n hits: x, y (m), vx, vy (m/s), spin (rad/s).

    Attributes:
        order: (n,) place in the recording, from -1/2 to 1/2.
        measured: (n, 5) as the slides tell them.
        nominal: (n, 5) as the nominal scene has them for their commands.
        augmented: (n, 5) with the effects that were found; None where there are none.
    """

    order: Array
    measured: Array
    nominal: Array
    augmented: Array | None = None


@dataclass(frozen=True)
class Part:
    """Hypotheses about hits, and what was made of them.

    Attributes:
        name: hit, or rest point.
        search: with all that was refitted.
        final: with the effects that were found.
        screen: of all hypotheses at the nominal fit.
    """

    name: str
    search: Search[Any]
    final: Candidate
    screen: Screen


@dataclass(frozen=True)
class Outcome:
    """As `Diagnosis`, nothing of it absent."""

    verdict: Verdict
    search: Search[HitFitter]
    nominal: Candidate
    final: Candidate
    screen: Screen
    held_out: HitFitter

    @classmethod
    def of(cls, diagnosis: Diagnosis) -> "Outcome | None":
        """The outcome of a diagnosis; None where it could not tell."""
        d = diagnosis
        if not (d.search and d.nominal and d.final and d.screen and d.held_out):
            return None
        return cls(d.verdict, d.search, d.nominal, d.final, d.screen, d.held_out)

    @property
    def fitter(self) -> HitFitter:
        """Of the hits that took part in fitting."""
        return self.search.fitter

    def effect(self, name: str) -> Effect:
        """An effect or a free form by name."""
        known = self.fitter.effects
        return known[name] if name in known else catalogue()[name]

    @property
    def parts(self) -> tuple[Part, ...]:
        """All of it."""
        return (Part("hit", self.search, self.final, self.screen),)

    @cached_property
    def launches(self) -> Launches | None:
        """Of the hits that took part in fitting; None where commands are not known."""
        if not isinstance(self.fitter.launches, LaunchModel):
            return None
        told = self.final.fit.marginal.told
        assert told is not None
        augmented = self.final.fitter.launches.means(self.final.fit.point) if self.final.effects else None
        return Launches(
            order=self.fitter.model.tracks.order,
            measured=told[0],
            nominal=self.fitter.launches.means(self.nominal.fit.point),
            augmented=augmented,
        )

    @cached_property
    def arrows(self) -> pd.DataFrame:
        """Pushes over the board that the nominal scene lacks, see `arrow_table`."""
        return self.judged(arrow_table(self.fitter, self.nominal))

    def judged(self, table: pd.DataFrame) -> pd.DataFrame:
        """A table whose rows are significant only where the recording as a whole shows a mismatch.

        Single places are judged after the whole (a closed test), so that the chance of calling any of them
        where nothing is missing is that of calling the whole.
        """
        return table if self.verdict.headline != "nothing_found" else table.assign(significant=False)

    @cached_property
    def predicted(self) -> Predicted:
        """Of the held-out hits."""
        return self._predict(self.held_out)

    @cached_property
    def predicted_used(self) -> Predicted:
        """Of the hits that took part in fitting."""
        return self._predict(self.fitter)

    def _predict(self, fitter: HitFitter) -> Predicted:
        return predict(fitter, self.nominal.fit, self.final.fit if self.final.effects else None)


@dataclass(frozen=True)
class RestOutcome:
    """The same of a recording that has rest points alone."""

    verdict: Verdict
    level: Level

    def effect(self, name: str) -> Effect:
        """An effect or a free form by name."""
        known = self.level.search.fitter.effects
        return known[name] if name in known else catalogue()[name]

    @property
    def parts(self) -> tuple[Part, ...]:
        """Rest points alone."""
        level = self.level
        return (Part("rest point", level.search, level.final, level.screen),)
