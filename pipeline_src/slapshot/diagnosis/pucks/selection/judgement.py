"""From fits and evidence to sentences of a verdict: what is found, named, located, limited."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.fit.gauss_newton import Fit
from slapshot.diagnosis.pucks.selection.evidence import project
from slapshot.diagnosis.pucks.selection.search import CLASS, Candidate, Screen, Search, inflation_of
from slapshot.diagnosis.pucks.slide.slide_model import Column
from slapshot.diagnosis.pucks.verdict import (
    Limit,
    Location,
    Mismatch,
    NamedEffect,
    ParameterValue,
    Unknown,
)
from slapshot.effects.effect import Effect

Word = TypeVar("Word", bound=str)

Z90, Z95 = 1.645, 1.96
AGREED = 0.8  # of the probability of a class, to say where it acts
# Physics in no catalogue: how often one meets it is assumed; how often it is called unknown, and catalogued
# physics by mistake, is what 11 and 40 development cases gave (8 and 0, by Laplace's rule of succession).
UNCATALOGUED = 0.1
FLAGGED, FLAGGED_BY_MISTAKE = (8 + 1) / (11 + 2), (0 + 1) / (40 + 2)
TOLD = 0.9  # of the prior's standard deviation: what is left of it where a recording says something
MOST_PARAMETERS = 4  # of an effect that are listed one by one


def mismatch_of(screen: Screen, p_value: float, evidence: float) -> Mismatch:
    """Found if it cannot be chance and is worth its parameters, however small it is."""
    best = max(screen.log_evidence, key=lambda name: screen.log_evidence[name])
    found = screen.p_value < p_value and screen.log_evidence[best] > evidence
    return Mismatch(
        found, "tests" if found else None, screen.p_value, screen.log_evidence[best], screen.shift[best]
    )


def found_effects(search: Search[Any], final: Candidate, leftover: Screen) -> tuple[NamedEffect, ...]:
    """The effects of a fit, each with those that this recording cannot tell from it.

    Args:
        search: that found them.
        final: fit of them.
        leftover: screen beyond it.
    """
    found = []
    beside = _beside_what_is_left(search, final, leftover)
    for name in final.effects:
        rest = tuple(n for n in final.effects if n != name)
        members = _class(search, final, rest, name)
        effect = search.fitter.effects[name]
        found.append(
            NamedEffect(
                name=name,
                phase=effect.phase,
                variable=effect.follows,
                members=members,
                log_evidence=search.gain(final, name),
                shift_m=search.shift(final, name),
                parameters=parameters_of(search, final.fit, name, beside),
                physics=" ".join(effect.physics.split("\n")),
            )
        )
    return tuple(sorted(found, key=lambda e: -e.log_evidence))


def _class(search: Search[Any], final: Candidate, rest: tuple[str, ...], name: str) -> dict[str, float]:
    """Probabilities of effects that could stand in the place of one, within CLASS nats of the best."""
    rivals = {name: final}
    for effects, candidate in search.seen.items():
        other = set(effects) - set(rest)
        if set(rest) <= set(effects) and len(effects) == len(rest) + 1:
            (stand_in,) = other
            # The fit of the name itself went on after it was seen.
            if stand_in == name or not candidate.final:
                continue
            if stand_in in search.catalogue and not search.at_bound(candidate):
                rivals[stand_in] = candidate
    best = max(rivals.values(), key=lambda candidate: search.ahead(candidate, final))
    # By as much evidence as its law may err, what was named may lie ahead of a rival by chance of its law.
    unsure = max(1.0, search.known_to(name) ** 2 * search.gain(final, name) / CLASS)
    behind = {n: _behind(search, best, candidate, unsure) for n, candidate in rivals.items()}
    near = {n: float(np.exp(-nats)) for n, nats in behind.items() if nats < CLASS}
    # However far ahead a rival is by this, it was not what the search came to.
    near.setdefault(name, float(np.exp(-behind[name])))
    total = sum(near.values())
    return dict(sorted(((n, p / total) for n, p in near.items()), key=lambda item: -item[1]))


def _behind(search: Search[Any], best: Candidate, rival: Candidate, unsure: float) -> float:
    """Nats by which a rival lies behind: misfit counts less where laws err, what parameters cost does not."""
    misfit = (rival.fit.objective - best.fit.objective) / 2 / inflation_of(best.fit, rival.fit)
    misfit = max(misfit, 0.0)
    return max(search.ahead(best, rival) - misfit * (1 - 1 / unsure), 0.0)


def parameters_of(
    search: Search[Any], fit: Fit, name: str, beside: tuple[Array, Array] | None = None
) -> tuple[ParameterValue, ...]:
    """Values with 90 % intervals; of a field, its largest weights.

    Args:
        search: that found the effect.
        fit: of it.
        name: of the effect.
        beside: change and sd (p,) of the fit's shared parameters once what is left over is fitted with them:
            an interval holds those of either fit.
    """
    effect = search.fitter.effects[name]
    sd = np.sqrt(np.diagonal(robust_covariance(fit)))
    moved, wide = beside or (np.zeros_like(sd), sd)
    values = []
    for c, column in enumerate(fit.columns):
        if column.owner == name:
            p = next(q for q in effect.parameters if q.name == column.parameter)
            value = fit.point.effects[name][p.name]
            low = value + min(-Z90 * sd[c], moved[c] - Z90 * wide[c])
            high = value + max(Z90 * sd[c], moved[c] + Z90 * wide[c])
            values.append(ParameterValue(p.name, p.unit, value, float(low), float(high), p.meaning))
    if len(values) > MOST_PARAMETERS:
        values = sorted(values, key=lambda v: -abs(v.value))[:MOST_PARAMETERS]
    return tuple(values)


def _beside_what_is_left(
    search: Search[Any], final: Candidate, leftover: Screen
) -> tuple[Array, Array] | None:
    """Change and sd (p,) of a fit's shared parameters with the free form of what is left beside them.

    None where no free form says anything.
    """
    if not final.effects:
        return None
    form = leftover.best([n for n in search.free if n in leftover.log_evidence])[:1]
    if not form or leftover.log_evidence[form[0]] <= 0:
        return None
    fit = final.fit
    columns, marginal, _ = final.fitter.quadratic(fit, [*final.effects, *form])
    _, precision = final.fitter.prior(columns)
    covariance = np.linalg.inv(marginal.information.sum(0) / max(1.0, fit.dispersion) + np.diag(precision))
    added = np.array([column.owner in form for column in columns])
    # At the fit only what was added pulls.
    pull = np.where(added, marginal.scores.sum(0) / max(1.0, fit.dispersion), 0.0)
    place = {(column.owner, column.parameter, column.object): c for c, column in enumerate(columns)}
    mine = [place[column.owner, column.parameter, column.object] for column in fit.columns]
    return (covariance @ pull)[mine], np.sqrt(np.diagonal(covariance))[mine]


def robust_covariance(fit: Fit) -> Array:
    """Of shared parameters: what hits really scatter by, where that is more than the model says."""
    scores = fit.marginal.scores - fit.marginal.scores.mean(0)
    sandwich = fit.covariance @ (scores.T @ scores) @ fit.covariance
    larger = np.maximum(np.diagonal(sandwich) / np.diagonal(fit.covariance), 1.0)
    scale = np.sqrt(larger)
    return fit.covariance * np.outer(scale, scale)


def unknown_of(search: Search[Any], leftover: Screen, least: float, shift: float) -> Unknown:
    """Whether a free form says clearly more than the effects that were named.

    Args:
        search: of a level where something is missing.
        leftover: screen beyond the effects that were named.
        least: nats that a free form must add.
        shift: m by which it must move tracks.
    """
    best = leftover.best(search.free)[0]
    evidence, moved = leftover.log_evidence[best], leftover.shift[best]
    flagged = evidence > least and moved >= shift and leftover.p_value < 0.01
    effect = search.fitter.effects[best]
    if not flagged:
        return Unknown(False, None, None, evidence, moved, None)
    return Unknown(True, effect.phase, effect.follows, evidence, moved, None)


def outside_probability(unexplained: bool) -> float:
    """That what is missing is in no catalogue, by whether names leave something unexplained (Bayes' rule)."""
    rates = FLAGGED, FLAGGED_BY_MISTAKE
    outside, inside = rates if unexplained else (1 - rate for rate in rates)
    odds = UNCATALOGUED / (1 - UNCATALOGUED) * outside / inside
    return odds / (1 + odds)


def with_outside(
    named: Sequence[NamedEffect], unknown: Unknown, found: bool
) -> tuple[tuple[NamedEffect, ...], Unknown]:
    """Names and the unknown, whose probabilities allow for physics in no catalogue."""
    if not found:
        return tuple(named), unknown
    outside = outside_probability(unknown.flagged or not named)
    shared = (
        replace(effect, members={name: (1 - outside) * p for name, p in effect.members.items()})
        for effect in named
    )
    return tuple(shared), replace(unknown, probability=outside)


def location_of(
    mismatch: Mismatch, named: Sequence[NamedEffect], unknown: Unknown, effects: Mapping[str, Effect]
) -> Location:
    """Where that is which moves tracks the most; what the rivals of a class disagree about stays open."""
    if not mismatch.found:
        return Location(None, None, "nothing is missing that this recording could show")
    if unknown.flagged and all(effect.log_evidence < unknown.log_evidence for effect in named):
        return Location(unknown.phase, unknown.variable, _size(unknown.shift_m))
    if not named:
        return Location(None, None, f"the best single description of it {_moves(mismatch.shift_m)}")
    members = named[0].members
    phase = _agreed(members, {name: effects[name].phase for name in members})
    variable = _agreed(members, {name: effects[name].follows for name in members})
    return Location(phase, variable, _size(named[0].shift_m))


def _agreed(members: Mapping[str, float], said: Mapping[str, Word]) -> Word | None:
    """What members say that hold most of the probability; None if no such thing is said."""
    share = {word: sum(p for n, p in members.items() if said[n] == word) for word in set(said.values())}
    best = max(sorted(share), key=lambda word: share[word])
    return best if share[best] >= AGREED else None


def _size(shift: float) -> str:
    return f"it {_moves(shift)}"


def _moves(shift: float) -> str:
    return f"moves tracks by {1e3 * shift:.0f} mm (rms)"


def limits(search: Search[Any], nominal: Candidate) -> tuple[Limit, ...]:
    """What effects with few parameters could still be, at 95 %."""
    few = [n for n in search.catalogue if not search.is_field(n)]
    columns, marginal, _ = search.fitter.quadratic(nominal.fit, few)
    inflation = inflation_of(nominal.fit)
    _, precision = search.fitter.prior(columns)
    fixed = np.array([c for c, column in enumerate(columns) if column.object >= 0])
    found = []
    for name in few:
        mine = [c for c, column in enumerate(columns) if column.owner == name]
        some = np.concatenate([fixed, mine]).astype(int)
        projected = project(
            marginal.information.sum(0)[np.ix_(some, some)],
            marginal.scores[:, some],
            np.arange(len(fixed)),
            np.diag(precision[fixed]),
        )
        information = projected.information / inflation + np.diag(precision[mine])
        covariance = np.asarray(np.linalg.inv(information), float)
        estimate = covariance @ projected.scores.sum(0) / inflation
        found += _limits_of(
            search, [columns[c] for c in mine], estimate, covariance, name, 1 / np.sqrt(precision[mine])
        )
    return tuple(found)


def _limits_of(
    search: Search[Any],
    columns: Sequence[Column],
    estimate: Array,
    covariance: Array,
    name: str,
    prior_sd: Array,
) -> list[Limit]:
    units = {p.name: p for p in search.fitter.effects[name].parameters}
    found = []
    for i, column in enumerate(columns):
        p = units[column.parameter]
        sd = float(np.sqrt(covariance[i, i]))
        # A shape has no limit where there may be nothing that has it, nor what these hits say nothing about.
        if p.neutral == 0 and sd < TOLD * prior_sd[i]:
            most = min(abs(estimate[i]) + Z95 * sd, max(abs(p.low), abs(p.high)))
            found.append(Limit(name, column.parameter, p.unit, most))
    return found
