"""From a fit of the nuisance to the effects that are there: screen, refit, add, delete.

All hypotheses are screened at once on one quadratic (see `marginal`); the best are then refitted with
their full nonlinearity, and compared by their evidence. While a recording asks for more, effects are added;
any that the others make superfluous are deleted.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Generic, TypeVar

import mujoco
import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.inference.mismatch_test import Scores, mismatch_test
from slapshot.diagnosis.pucks.fit.fitter import Fitter
from slapshot.diagnosis.pucks.fit.gauss_newton import FIELD, Fit
from slapshot.diagnosis.pucks.fit.marginal import Marginal
from slapshot.diagnosis.pucks.selection.evidence import LARGEST, SIZES, LinearEvidence, project
from slapshot.diagnosis.pucks.selection.law_error import with_law_errors
from slapshot.diagnosis.pucks.slide.slide_model import Column, Effects
from slapshot.effects.effect import Effect, Parameter
from slapshot.text import reason_of

F = TypeVar("F", bound=Fitter)

REFITTED = 4
CLASS = 3.0  # nats: a factor of 20 in probability
ADD = 4.0  # nats that a further effect must add
MOST = 3
DRAWS = 499  # of scores under the null hypothesis
TESTED = 1.0  # information in units of the priors, of a direction that is tested
# Share of the best one's gain by which another may promise less and still win once both are exact: what is
# linear about no elasticity tells little of what an elastic arm does.
RIVAL, RIVAL_AT_LAUNCH = 0.4, 0.75
RIVALS = 3  # at most so many
SIMULATED = 0.25  # share of a gain by which another may still explain less once it was simulated
EXCHANGED = 2  # best rivals of each effect that are refitted in its place
STAYED, EXACT = 0.1, 0.5  # of a parameter's scale, from where hits were simulated: no more, near enough
WITHIN = 0.5  # of a parameter's standard error: by as much the scatter of contact moves it
AT_BOUND = 1e-3  # of a parameter's scale
FINISHED = 6  # most rounds of fitting about the last fit
CONTINUED = 5  # times that a fit which stopped before it had converged goes on
CREEP = 20.0  # of the objective: as many steps as a fit takes, each of which may raise it by 1


@dataclass(frozen=True)
class Screen:
    """Every hypothesis judged on one quadratic.

    Attributes:
        log_evidence: hypothesis -> nats over no further effect.
        shift: hypothesis -> rms shift of the tracks in m that its best values make, where it is largest.
        p_value: of the largest, see `inference.mismatch_test`.
        direction: hypothesis -> best change of its parameters.
    """

    log_evidence: Mapping[str, float]
    shift: Mapping[str, float]
    p_value: float
    direction: Mapping[str, Mapping[str, float]]

    def best(self, among: Sequence[str]) -> list[str]:
        """Hypotheses, best first."""
        return sorted(among, key=lambda name: -self.log_evidence[name])


@dataclass(frozen=True)
class Candidate:
    """A set of effects, refitted.

    Attributes:
        effects: names.
        fit: of them and the nuisance.
        log_evidence: nats over the nominal scene with refitted nuisance.
        fitter: that fitted it.
        final: whether that fitter is linear about the fit, not about the nominal scene.
        precision: (p,) of the prior of its shared parameters; later screens choose other sizes of fields.
    """

    effects: tuple[str, ...]
    fit: Fit
    log_evidence: float
    fitter: Any
    final: bool = True
    precision: Array | None = None


def largest_shift(moved: Array) -> float:
    """Root mean square over hits of changes (n, frames, 2) in m, at the frame where it is largest."""
    return float(np.sqrt((moved**2).sum(-1).mean(0).max()))


def settled(fitter: Fitter, fit: Fit, effects: Sequence[str] = ()) -> Fit:
    """A fit that goes on from where one stopped before it had converged.

    Steps are those of a linear model with estimated scatter, and near an optimum may creep away from it. A
    fit that going on only makes worse, by no more than its steps are let pass, has converged where it was.
    """
    for _ in range(CONTINUED):
        if fit.converged:
            break
        further = fitter.fit(fit.point, fit.scatter, effects)
        if not further.converged and 0 <= further.objective - fit.objective < CREEP:
            return replace(fit, converged=True)
        fit = further
    return fit


def balanced(scores: Array, fitted: NDArray[np.int64]) -> Array:
    """Scores (n, p) of hits at a fit, where priors and bounds of what was fitted balance what hits say."""
    found = scores.copy()
    found[:, fitted] -= found[:, fitted].mean(0)
    return found


def inflation_of(*fits: Fit) -> float:
    """By how much what the best of some fits leaves exceeds noise, at least 1: all evidence shrinks alike."""
    return max(1.0, min(fit.dispersion for fit in fits))


def _least_rival(gain: float, share: float = RIVAL) -> float:
    """Nats that another effect must promise to be tried beside one that gains so many."""
    return gain - max(8 * CLASS, share * gain)


@dataclass
class Search(Generic[F]):
    """The search and what it finds on the way.

    Attributes:
        fitter: of the recording's hits.
        catalogue: names of effects that may be named.
        free: names of free forms.
        rng: of draws under the null hypothesis.
        seen: every set of effects that was refitted.
        failed: hypotheses that could not be refitted -> why.
        unreached: those that act at places where no object came; they have no evidence at all.
        left: effects and one of them -> the last fit from which it was left out.
        told: what is asked and an effect -> the fit of which it was asked last, and the answer.
        about: a fitter that is linear about a fit, where the first one is exact near the nominal scene only;
            by derivatives from there, or, where it is told not to, by those about the nominal scene.
        refitted: best of a screen that are refitted.
        most: effects that are named together.
    """

    fitter: F
    catalogue: Sequence[str]
    free: Sequence[str]
    rng: np.random.Generator
    seen: dict[tuple[str, ...], Candidate] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)
    unreached: set[str] = field(default_factory=set)
    left: dict[tuple[tuple[str, ...], str], Fit] = field(default_factory=dict)
    told: dict[tuple[str, str], tuple[Fit, float]] = field(default_factory=dict)
    about: Callable[[Fit, bool], F] | None = None
    refitted: int = REFITTED
    most: int = MOST

    @property
    def _effects(self) -> Mapping[str, Effect]:
        return self.fitter.effects

    def is_field(self, name: str) -> bool:
        """Whether an effect has so many parameters that it bends to almost anything."""
        return len(self._effects[name].parameters) > FIELD

    def nominal(self) -> Candidate:
        """The scene as it is, with its nuisance fitted; mistracked frames are left out."""
        fit = self.fitter.fit(self.fitter.start())
        self.fitter.drop_jumps(fit.point)
        fit = settled(self.fitter, self.fitter.fit(fit.point, fit.scatter))
        self.seen[()] = Candidate((), fit, 0.0, self.fitter)
        return self.seen[()]

    def settle(self, candidate: Candidate) -> Candidate:
        """A candidate whose fit has converged, if going on makes it do so."""
        fit = settled(candidate.fitter, candidate.fit, candidate.effects)
        return (
            candidate if fit is candidate.fit else replace(candidate, fit=fit, precision=self._precision(fit))
        )

    def screen(self, at: Candidate, hypotheses: Sequence[str]) -> Screen:
        """Judge hypotheses beyond those of a fit, which are projected out with the nuisance."""
        judged, columns, marginal = self._judged(at, hypotheses)
        return replace(judged, p_value=self._p_value(at, columns, marginal, hypotheses))

    def _judged(self, at: Candidate, hypotheses: Sequence[str]) -> tuple[Screen, Sequence[Column], Marginal]:
        """A screen without its p-value, and the quadratic that it is of."""
        columns, marginal, moved = at.fitter.quadratic(at.fit, [*at.effects, *hypotheses])
        _, precision = self.fitter.prior(columns)
        fixed = np.array([c for c, column in enumerate(columns) if column.owner not in hypotheses], np.int64)
        marginal = replace(marginal, scores=balanced(marginal.scores, fixed))
        projected = project(marginal.information.sum(0), marginal.scores, fixed, np.diag(precision[fixed]))
        others = [column for column in columns if column.owner in hypotheses]
        # Where the model leaves more than noise, all evidence shrinks alike.
        inflation = max(1.0, at.fit.dispersion)
        total = projected.scores.sum(0) / inflation
        log_evidence: dict[str, float] = {}
        shift: dict[str, float] = {}
        direction: dict[str, Mapping[str, float]] = {}
        # Beyond what another friction would have done to the track.
        others_at = np.setdiff1d(np.arange(len(columns)), fixed)
        moved = moved[..., others_at] - moved[..., fixed] @ projected.weights
        for name in hypotheses:
            mine = np.array([c for c, column in enumerate(others) if column.owner == name], np.int64)
            if not len(mine):
                self.unreached.add(name)
                log_evidence[name], shift[name], direction[name] = -np.inf, 0.0, {}
                continue
            own = [others[c] for c in mine]
            judge = self._judge(name, own, projected.information[np.ix_(mine, mine)] / inflation)
            log_evidence[name] = float(judge.log_ratio(total[None, mine])[0])
            if len(mine) > FIELD and name not in at.effects:
                self.fitter.sizes[name] = judge.best_size(total[mine])
            estimate = judge.estimate(total[None, mine], self.fitter.sizes.get(name, LARGEST))[0]
            direction[name] = {column.parameter: v for column, v in zip(own, estimate, strict=True)}
            shift[name] = largest_shift(moved[..., mine] @ estimate)
        return Screen(log_evidence, shift, 1.0, direction), columns, marginal

    def _p_value(
        self, at: Candidate, columns: Sequence[Column], marginal: Marginal, hypotheses: Sequence[str]
    ) -> float:
        """That scores are as large by chance, their spread between hits being what it is."""
        _, precision = self.fitter.prior(columns)
        nuisance = np.array([column.owner not in hypotheses for column in columns])
        sd = 1 / np.sqrt(precision)
        of = Scores(marginal.scores * sd, marginal.information * np.outer(sd, sd), sd, nuisance)
        sliding = [n for n in self.catalogue if self._effects[n].acts_on_slide and not self.is_field(n)]
        log_mu = float(at.fit.point.nuisance[:, :2].mean())
        # Of rest points alone no launches are fitted, and no errors of contacts known.
        speed = float(np.linalg.norm(at.fit.point.latents[:, 2:4], axis=1).mean())
        of = with_law_errors(of, columns, sliding, log_mu, speed)
        owners = np.array([column.owner for column in columns])
        of, groups = with_few_directions(of, [np.flatnonzero(owners == name) for name in hypotheses])
        # Where nothing can be told, nothing contradicts the nominal scene.
        return mismatch_test(of, groups, self.rng, DRAWS, TESTED).p_value if groups else 1.0

    def screen_beyond(self, at: Candidate) -> Screen:
        """Judge all other effects and all free forms beyond those of a fit."""
        return self.screen(at, [n for n in (*self.catalogue, *self.free) if n not in at.effects])

    def shift(self, at: Candidate, name: str) -> float:
        """See `Fitter.shift`."""
        return self._once("shift", at.fit, name, at.fitter.shift)

    def known_to(self, name: str) -> float:
        """Share of what an effect does by which its law may err."""
        return self._effects[name].known_to

    def gain_beyond(self, at: Candidate, name: str, other: str) -> float:
        """Nats of an effect that no error of another's law can make; infinite where they may be any.

        Errors of laws of swing and contact reach launches, and those of the swing encoders; what is seen of a
        slide whose launch is unknown they leave alone. Errors of laws of the slide leave encoders alone.
        """
        mine, theirs = self._effects[name], self._effects[other]
        sources = []
        if not theirs.acts_on_slide and (mine.acts_on_slide or mine.acts_on_camera):
            sources.append("tracks")
        if theirs.phase != "swing" and mine.phase == "swing":
            sources.append("encoders")
        if name not in at.effects:
            return np.inf if sources else 0.0
        return max((self._gain_by(at, name, source) for source in sources), default=0.0)

    def _gain_by(self, at: Candidate, name: str, source: str) -> float:
        gain = {"tracks": at.fitter.gain_by_tracks, "encoders": at.fitter.gain_by_encoders}[source]
        likelihood = self._once(source, at.fit, name, gain) / max(1.0, at.fit.dispersion)
        # Schwarz's criterion: what as many parameters would gain by chance.
        return likelihood - len(self._effects[name].parameters) / 2 * np.log(len(at.fit.point.latents))

    def _once(self, what: str, fit: Fit, name: str, answer: Callable[[Fit, str], float]) -> float:
        """An answer about an effect of a fit, which is asked for again and again."""
        of, known = self.told.get((what, name), (None, 0.0))
        if of is not fit:
            known = float(answer(fit, name))
            self.told[what, name] = fit, known
        return known

    def gain(self, at: Candidate, name: str) -> float:
        """Nats that an effect adds to the others of a fit, as far as those were fitted alone."""
        rest = tuple(n for n in at.effects if n != name)
        return self.ahead(at, self.seen.get(rest, self.seen[()]))

    def ahead(self, one: Candidate, other: Candidate) -> float:
        """Nats by which a candidate is more likely than another, both in the same units of misfit."""
        inflation = inflation_of(one.fit, other.fit)
        first, second = (self._log_evidence(c.fit, c.precision, inflation) for c in (one, other))
        return first - second

    def refit(
        self, at: Candidate, names: Sequence[str], direction: Mapping[str, Mapping[str, float]]
    ) -> Candidate:
        """Fit a set of effects nonlinearly, from a fit of fewer of them and a linear estimate."""
        key = tuple(sorted(names))
        if key in self.seen:
            return self.seen[key]
        # Errors of laws go on from where they are.
        effects = {n: values for n, values in at.fit.point.effects.items() if n not in at.effects}
        for name in key:
            values = dict(at.fit.point.effects.get(name, self._effects[name].neutral()))
            if name not in at.fit.point.effects and name in direction:
                for parameter in self._effects[name].parameters:
                    start = values[parameter.name] + float(direction[name].get(parameter.name, 0.0))
                    values[parameter.name] = float(np.clip(start, parameter.low, parameter.high))
            effects[name] = values
        for name in set(key) - set(at.effects):
            effects = min(
                (effects, *({**effects, name: values} for values in at.fitter.starts(name))),
                key=lambda begin: at.fitter.start_misfit(at.fit, begin),
            )
        fit = at.fitter.fit(replace(at.fit.point, effects=effects), at.fit.scatter, key)
        precision = self._precision(fit)
        evidence = self._log_evidence(fit, precision)
        if not np.isfinite(evidence):
            raise ArithmeticError("its fit is not finite")
        # What begins with the slide leaves launches as they were simulated.
        launched = any(self._effects[n].acts_on_launch or self._effects[n].acts_on_camera for n in key)
        final = self.about is None or not launched
        self.seen[key] = Candidate(key, fit, evidence, at.fitter, final, precision)
        return self.seen[key]

    def finish(self, candidate: Candidate, least: float = -np.inf) -> Candidate:
        """A candidate with a fitter that is exact where it is: the best of all rounds of simulation and fit.

        Contacts scatter what is simulated by a few nats, about which the last rounds only go to and fro.
        With less evidence than the least that is asked for, no further round is simulated.
        """
        if candidate.final or self.about is None:
            return candidate
        fit = candidate.fit
        near: list[tuple[Fit, F]] = []
        if np.isfinite(least):
            # Derivatives are most of the work.
            fitter = self.about(fit, False)
            fitter.sizes = self.fitter.sizes
            there = fitter.fit(fit.point, fit.scatter, candidate.effects)
            precision = self._precision(there)
            evidence = self._log_evidence(there, precision)
            if evidence < least:
                # Not kept: elsewhere it may be asked for with derivatives.
                return Candidate(candidate.effects, there, evidence, fitter, precision=precision)
        for _ in range(FINISHED):
            before = fit.point.effects
            fitter = self.about(fit, True)
            fitter.sizes = self.fitter.sizes
            fit = fitter.fit(fit.point, fit.scatter, candidate.effects)
            hopeless = self._log_evidence(fit, self._precision(fit)) < least
            # What went far from where it was simulated is not known to be as good as it seems.
            if not self._stayed(before, fit, EXACT) and not hopeless:
                continue
            gained = min((f.objective for f, _ in near), default=np.inf) - fit.objective
            near.append((fit, fitter))
            if self._stayed(before, fit, STAYED) or gained < 2 * ADD or hopeless:
                break
        fit, fitter = min(near, key=lambda one: one[0].objective, default=(fit, fitter))
        precision = self._precision(fit)
        evidence = self._log_evidence(fit, precision)
        self.seen[candidate.effects] = Candidate(
            candidate.effects, fit, evidence, fitter, precision=precision
        )
        return self.seen[candidate.effects]

    def _stayed(self, before: Effects, fit: Fit, share: float) -> bool:
        """Whether a fit moved all parameters by less than a share of their scales or standard errors."""
        variance = np.diagonal(fit.covariance)
        sd = {(c.owner, c.parameter): np.sqrt(v) for c, v in zip(fit.columns, variance, strict=True)}
        return all(
            abs(fit.point.effects[name][p.name] - before[name][p.name])
            < max(share * p.scale, WITHIN * sd.get((name, p.name), 0.0))
            for name in before
            for p in self._effects[name].parameters
        )

    def grow(self, at: Candidate, screen: Screen, hypotheses: Sequence[str]) -> list[Candidate]:
        """Refits of the best hypotheses of a screen added to a fit, best first."""
        promise = {n: max(screen.log_evidence[n], self._start_gain(at, n)) for n in hypotheses}
        found: list[Candidate] = []
        simulated = 0
        for name in sorted(hypotheses, key=lambda name: -promise[name])[: self.refitted]:
            # What the best one turned out to gain may be far less than its promise.
            best = max((c.log_evidence - at.log_evidence for c in found), default=np.inf)
            share = RIVAL_AT_LAUNCH if self._effects[name].acts_on_launch else RIVAL
            if promise[name] <= _least_rival(min(best, max(promise.values())), share):
                continue
            tried = self.try_adding(at, name, screen.direction)
            if tried is None:
                continue
            worth = not found or tried.log_evidence - at.log_evidence > _least_rival(best, share)
            if worth and simulated < RIVALS:
                simulated += not tried.final
                tried = self.finish(tried)
            found.append(tried)
        return sorted(found, key=lambda c: (not c.final, self.at_bound(c), -c.log_evidence)) or [at]

    def at_bound(self, candidate: Candidate) -> bool:
        """Whether an effect, but for fields, fits best at a bound of what is possible: it is another law."""
        return any(
            abs(candidate.fit.point.effects[name][p.name] - bound) < AT_BOUND * p.scale
            for name in candidate.effects
            if not self.is_field(name)
            for p in self._effects[name].parameters
            for bound in (p.low, p.high)
            if bound != p.neutral
        )

    def _start_gain(self, at: Candidate, name: str) -> float:
        """Nats that the best start of an effect promises, to which a linear screen is blind."""
        starts = at.fitter.starts(name)
        if not starts:
            return -np.inf
        here = at.fit.point.effects
        least = min(at.fitter.start_misfit(at.fit, {**here, name: values}) for values in starts)
        return (at.fitter.start_misfit(at.fit, here) - least) / 2 - CLASS

    def try_adding(
        self, at: Candidate, name: str, direction: Mapping[str, Mapping[str, float]]
    ) -> Candidate | None:
        """An effect added to a fit; None where its simulation fails."""
        try:
            return self.refit(at, [*at.effects, name], direction)
        except (ArithmeticError, ValueError, RuntimeError, mujoco.FatalError) as error:
            self.failed[name] = reason_of(error)
            return None

    def exchange(self, candidate: Candidate) -> Candidate:
        """The best candidate that has rivals in place of effects; the same if none explains more.

        What explains most by itself also explains a part of what is missing besides, and once that is named
        another effect may explain the rest better. Rivals of an effect are those that promise most beside the
        others.
        """
        for _ in range(self.most):
            exchanged = self._with_one_exchanged(candidate)
            if exchanged is candidate:
                break
            candidate = exchanged
        return candidate

    def _with_one_exchanged(self, candidate: Candidate) -> Candidate:
        best = candidate
        for old in candidate.effects if len(candidate.effects) > 1 else ():
            at = self.without(candidate, old)
            # Two fields bend to almost anything.
            bends = any(self.is_field(n) for n in at.effects)
            rivals = [
                n for n in self.catalogue if n not in candidate.effects and not (bends and self.is_field(n))
            ]
            if not rivals:
                continue
            screen, *_ = self._judged(at, rivals)
            promise = {n: max(screen.log_evidence[n], self._start_gain(at, n)) for n in rivals}
            for new in sorted(rivals, key=lambda n: -promise[n])[:EXCHANGED]:
                share = RIVAL_AT_LAUNCH if self._effects[new].acts_on_launch else RIVAL
                if promise[new] <= _least_rival(self.ahead(candidate, at), share):
                    continue
                tried = self.try_adding(at, new, screen.direction)
                gain = self.ahead(best, at)
                if tried is None or self.ahead(tried, at) <= _least_rival(gain, share):
                    continue
                # A simulation about it tells more than a promise does.
                tried = self.finish(tried, at.log_evidence + gain - max(2 * ADD, SIMULATED * gain))
                if not self.at_bound(tried) and self.ahead(tried, best) > 0:
                    best = tried
        return best

    def prune(self, candidate: Candidate) -> Candidate:
        """Delete effects, the least needed first, while the rest has no less evidence by more than ADD."""
        if len(candidate.effects) == 1:
            return candidate
        fewer = [self.without(candidate, name) for name in candidate.effects]
        best = min(fewer, key=lambda rest: self.ahead(candidate, rest))
        return self.prune(best) if self.ahead(candidate, best) < ADD else candidate

    def without(self, candidate: Candidate, name: str) -> Candidate:
        """A candidate's other effects, fitted anew: simulated where it is, or the best that is known.

        Where simulations about an earlier fit were not exact, an effect that is added seems to explain what
        only the new simulation does.
        """
        fewer = tuple(n for n in candidate.effects if n != name)
        if self.left.get((candidate.effects, name)) is candidate.fit and fewer in self.seen:
            return self.seen[fewer]
        self.left[candidate.effects, name] = candidate.fit
        point = candidate.fit.point
        kept = {n: values for n, values in point.effects.items() if n != name}
        fit = candidate.fitter.fit(replace(point, effects=kept), candidate.fit.scatter, fewer)
        precision = self._precision(fit)
        evidence = self._log_evidence(fit, precision)
        found = Candidate(fewer, fit, evidence, candidate.fitter, candidate.final, precision)
        known = self.seen.get(fewer)
        if known is None or not known.final or known.log_evidence < found.log_evidence:
            self.seen[fewer] = found
        return self.seen[fewer]

    def _judge(self, name: str, columns: Sequence[Column], information: Array) -> LinearEvidence:
        parameters = {p.name: p for p in self._effects[name].parameters}
        first = parameters[columns[0].parameter]
        one_sided = len(parameters) == 1 and first.low == first.neutral
        scales = np.array([parameters[column.parameter].scale for column in columns])
        return LinearEvidence(information, scales, one_sided)

    def _parameter(self, column: Column) -> Parameter:
        return next(p for p in self._effects[column.owner].parameters if p.name == column.parameter)

    def _precision(self, fit: Fit) -> Array:
        """(p,) of the prior of a fit's shared parameters, with the sizes of fields as they are now."""
        return np.asarray(self.fitter.prior(fit.columns)[1])

    def _log_evidence(self, fit: Fit, precision: Array | None, inflation: float | None = None) -> float:
        """Laplace's approximation at the refit, averaged over sizes, against the nominal scene.

        Args:
            fit: of effects.
            precision: (p,) of the prior with which it was fitted; None for that of now.
            inflation: of all squares; by default what the fit leaves over noise.
        """
        nominal = self.seen[()].fit
        columns = fit.columns
        mean = self.fitter.prior(columns)[0]
        precision = self._precision(fit) if precision is None else precision
        own = np.array([c for c, column in enumerate(columns) if column.object < 0], np.int64)
        fixed = np.setdiff1d(np.arange(len(columns)), own)
        inflation = inflation_of(fit) if inflation is None else inflation
        scores = balanced(fit.marginal.scores, fixed)
        projected = project(fit.marginal.information.sum(0), scores, fixed, np.diag(precision[fixed]))
        information = projected.information / inflation
        values = np.array([fit.point.effects[columns[c].owner][columns[c].parameter] for c in own])
        offset = values - mean[own]
        slope = projected.scores.sum(0) / inflation
        parameters = [self._parameter(columns[c]) for c in own]
        scales = np.array([p.scale for p in parameters])
        # A slope that leads out of what is possible promises nothing.
        low, high = (np.array([getattr(p, end) for p in parameters]) for end in ("low", "high"))
        outward = ((values <= low) & (slope < 0)) | ((values >= high) & (slope > 0))
        slope = np.where(outward, 0.0, slope)
        gain = (nominal.objective - fit.objective + float((precision[own] * offset**2).sum())) / 2 / inflation
        # The quadratic about the refit, as if it stood about the neutral values.
        constant = gain - slope @ offset - offset @ information @ offset / 2
        score = slope + information @ offset
        terms = []
        for size in SIZES:
            scaled = size * scales
            inner = np.eye(len(own)) + information * np.outer(scaled, scaled)
            part = scaled * score
            terms.append(part @ np.linalg.solve(inner, part) / 2 - np.linalg.slogdet(inner)[1] / 2)
        return float(constant + np.logaddexp.reduce(terms) - np.log(len(SIZES)))


def with_few_directions(
    of: Scores, groups: Sequence[NDArray[np.int64]]
) -> tuple[Scores, list[NDArray[np.int64]]]:
    """Scores by those directions alone of each group of columns that may be tested.

    Without the nuisance a direction has no less information than beside it.

    Returns:
        The scores, and each group's indices among what is no nuisance.
    """
    total, nuisance = of.H.sum(0), np.flatnonzero(of.nuisance)
    parts = [(nuisance, np.eye(len(nuisance)))]
    for group in groups:
        values, vectors = np.linalg.eigh(total[np.ix_(group, group)])
        if (values > TESTED).any():
            parts.append((group, vectors[:, values > TESTED]))
    half = np.concatenate([of.H[:, :, of_part] @ turn for of_part, turn in parts], axis=2)
    H = np.concatenate([turn.T @ half[:, of_part] for of_part, turn in parts], axis=1)
    b = np.concatenate([of.b[:, of_part] @ turn for of_part, turn in parts], axis=1)
    few = Scores(b, H, np.ones(len(b.T)), np.arange(len(b.T)) < len(nuisance))
    ends = np.cumsum([turn.shape[1] for _, turn in parts[1:]])
    return few, np.split(np.arange(ends[-1]), ends[:-1]) if len(ends) else []
