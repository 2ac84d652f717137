"""What is missing: the section of verdict.md that names it."""

import numpy as np

from slapshot.diagnosis.pucks.report import wording
from slapshot.diagnosis.pucks.report.wording import table
from slapshot.diagnosis.pucks.selection.search import CLASS
from slapshot.diagnosis.pucks.verdict import NamedEffect, Verdict
from slapshot.effects.catalogue import catalogue

LEAST_SHOWN = 0.005  # probability


def what(verdict: Verdict) -> list[str]:
    """Parts of the section: each effect with its rivals and parameters, and what has no name."""
    parts: list[str] = []
    for effect in verdict.effects:
        parts += [
            f"### {wording.escaped(wording.capitalised(wording.phrase(effect.name)))}",
            f"{wording.escaped(effect.physics)} Refitted, it adds {effect.log_evidence:.1f} nats of "
            "evidence; without it, all else being equal, tracks would lie "
            f"{1e3 * effect.shift_m:.1f} mm (rms) elsewhere.",
            *_members(effect),
            *_parameters(effect),
        ]
    if verdict.unknown is not None and verdict.unknown.flagged:
        parts.append(_unknown(verdict))
    return parts or ["Nothing to name."]


def _members(effect: NamedEffect) -> list[str]:
    known = catalogue()
    follows = {name: known[name].follows for name in effect.members if name in known}
    follows.setdefault(effect.name, effect.variable)
    if len(effect.members) == 1:
        (probability,) = effect.members.values()
        return [
            f"No other effect that was tried in its place comes within a factor of {np.exp(CLASS):.0f}: "
            f"{100 * probability:.0f} %, the rest is for physics in no catalogue."
        ]
    same = len(set(follows.values())) == 1
    reason = (
        f"all of them follow {wording.VARIABLES[effect.variable]}, and do so alike over the range recorded"
        if same
        else "they follow different variables, but the hits recorded vary these together"
    )
    rows = [
        [
            wording.escaped(wording.title(name)),
            f"{100 * p:.0f} %",
            wording.VARIABLES[follows[name]] if name in follows else "",
        ]
        for name, p in effect.members.items()
    ]
    outside = 1 - sum(effect.members.values())
    if outside > LEAST_SHOWN:
        rows.append(["physics in no catalogue", f"{100 * outside:.0f} %", ""])
    return [
        f"These hits cannot tell {wording.several(len(effect.members), 'effect')} apart: {reason}.",
        table(["effect", "probability", "follows"], rows),
    ]


def _parameters(effect: NamedEffect) -> list[str]:
    if not effect.parameters:
        return []
    rows = [
        [
            wording.escaped(wording.parameter_label(p.name, p.meaning)),
            wording.escaped(wording.parameter_text(p.name, p.unit, p.value, p.low, p.high)),
        ]
        for p in effect.parameters
    ]
    values = table(
        [f"parameter of {wording.escaped(wording.title(effect.name))}", "value (90 % interval)"], rows
    )
    chance = (
        "Intervals hold chance alone, not what the law of an effect simplifies: with many hits a value can "
        "lie outside its own (`coverage90` of the proof says how often)."
    )
    if not any(wording.is_bump(p.name) for p in effect.parameters):
        return [values, chance]
    return [
        values,
        chance,
        "These are the strongest bumps of a field. Neighbours can stand in for each other, so that one bump "
        "is uncertain where the field is not; the location map shows the whole.",
    ]


def _unknown(verdict: Verdict) -> str:
    unknown = verdict.unknown
    assert unknown is not None
    beyond = "beyond the effects above, " if verdict.effects else ""
    head = "**Not in the catalogue:**"
    if unknown.probability is not None:
        head = f"**Not in the catalogue** (probability {100 * unknown.probability:.0f} %):"
    if unknown.phase is None:
        assert verdict.fit is not None
        left = verdict.fit["augmented"].chi2_per_freedom
        return (
            f"{head} {beyond}something is left. With them held-out hits have a "
            f"chi-squared of {left.value:.2f} ({left.low:.2f} to {left.high:.2f}) a degree of freedom, which "
            "is more than laws that are right but simplified would leave. Nothing that was tried says where "
            "it acts."
        )
    return (
        f"{head} {beyond}something acts {wording.PHASES[str(unknown.phase)]} and follows "
        f"{wording.VARIABLES[str(unknown.variable)]}. Described without a name it gains "
        f"{unknown.log_evidence:.1f} nats and moves tracks by {1e3 * unknown.shift_m:.1f} mm (rms). "
        "The location map shows it."
    )
