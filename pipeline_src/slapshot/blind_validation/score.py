"""Score of one case: its verdict compared with the truth, both read from files.

The sealed truths of the lab are read here only.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

from pydantic import BaseModel

from slapshot.blind_validation.case_table import FIT
from slapshot.diagnosis.pucks.diagnose import diagnose
from slapshot.diagnosis.pucks.launch.signatures import Signatures
from slapshot.diagnosis.pucks.result import Setting
from slapshot.diagnosis.pucks.verdict import Errors, Verdict
from slapshot.effects.catalogue import catalogue
from slapshot.effects.effect import Effect
from slapshot.json_types import Row
from slapshot.recordings.read import read_recording

TRUTH = Path("truth") / "truth.json"
DRAGS = frozenset({"linear_drag", "quadratic_drag", "stribeck_friction"})  # drag laws, hard to distinguish
HELD_OUT_ERRORS = ("track_rmse_m", "rest_rmse_m", "command_rest_rmse_m")
TYPICAL_SIZE, WEAK_SIZE = 0.5, 0.2  # displacement over the hit-to-hit scatter


class ConcealedEffect(BaseModel):
    """What the truth says of a hidden effect, see lab.hidden_effects.hidden_effect."""

    kind: str
    catalogued: bool
    phase: str
    displacement: float | None
    parameters_are: Literal["same", "near"] | None
    parameters: dict[str, float]


class SealedTruth(BaseModel):
    """The part of a sealed truth that is scored."""

    concealed: list[ConcealedEffect]


def score(case: str, condition: str, case_folder: Path, verdict: Verdict) -> Row:
    """A row of cases.csv; what does not apply is None."""
    truth = SealedTruth.model_validate_json((case_folder / TRUTH).read_text()).concealed
    kinds = [one.kind for one in truth]
    sizes = [one.displacement for one in truth]
    row: Row = {
        "case": case,
        "condition": _condition(condition, sizes),
        "conceals": "+".join(kinds),
        "displacement": min((size for size in sizes if size is not None), default=None),
        "hits": verdict.hits,
        "cannot_tell": verdict.cannot_tell,
    }
    mismatch, location, unknown, fit = verdict.mismatch, verdict.location, verdict.unknown, verdict.fit
    if mismatch is None or location is None or unknown is None or fit is None:  # all, as files are checked
        return row | {"found": False} | _score_undecided(truth, kinds)
    named = [effect.name for effect in verdict.effects]
    classes = [set(effect.members) for effect in verdict.effects]
    row |= {
        "found": mismatch.found,
        "p_value": mismatch.p_value,
        "named": "+".join(named),
        "classes": " | ".join("+".join(sorted(members)) for members in classes),
        "class_size": len(classes[0]) if classes else None,
        "stated_probability": verdict.effects[0].members.get(named[0]) if named else None,
        "unknown": unknown.flagged,
        "phase": location.phase,
        "variable": location.variable,
    }
    for scene, errors in fit.items():
        for measure in FIT:
            error = getattr(errors, measure)
            row[f"{scene}_{measure}"] = None if error is None else error.value
    row["made_worse"] = bool(named) and _is_worse(fit)
    if not truth:
        return row
    effects = catalogue()
    row["phase_right"] = location.phase in {one.phase for one in truth}
    if all(one.catalogued for one in truth):
        row |= _naming(kinds, named, classes)
        row["variable_right"] = location.variable in {effects[kind].follows for kind in kinds}
        row |= _coverage(truth, verdict, effects)
    return row


def _condition(drawn: str, sizes: Sequence[float | None]) -> str:
    """The condition, or one of smaller effects where the requested size was not attainable."""
    meets_aim = min((size for size in sizes if size is not None), default=None)
    family = drawn.split(",")[0]
    if meets_aim is None or family == "weak" or meets_aim >= TYPICAL_SIZE:
        return drawn
    smaller = "weak" if meets_aim >= WEAK_SIZE else "faint"
    return smaller if drawn == "plain" else f"{drawn}, {smaller}"


def _score_undecided(truth: Sequence[ConcealedEffect], kinds: Sequence[str]) -> Row:
    """Scores of a verdict that is undecided: every effect is missed."""
    if not truth:
        return {}
    missed: Row = {"phase_right": False}
    if all(one.catalogued for one in truth):
        missed |= _naming(kinds, [], []) | {"variable_right": False}
    return missed


def _naming(kinds: Sequence[str], named: Sequence[str], classes: Sequence[set[str]]) -> Row:
    found = [kind in named for kind in kinds]
    in_class = [any(kind in members for members in classes) for kind in kinds]
    first = named[0] if named else None
    return {
        "top1": first in kinds,
        "top1_merged": first in kinds or (first in DRAGS and not DRAGS.isdisjoint(kinds)),
        "in_class": any(in_class),
        "both": all(found) if len(kinds) > 1 else None,
        "both_in_class": all(in_class) if len(kinds) > 1 else None,
        "one": any(found) if len(kinds) > 1 else None,
    }


def _is_worse(fit: Mapping[str, Errors]) -> bool:
    """Whether a held-out error with what was named exceeds its 90 % interval without it."""
    pairs = [(getattr(fit["refitted"], m), getattr(fit["augmented"], m)) for m in HELD_OUT_ERRORS]
    return any(before and after and after.value > before.high for before, after in pairs)


def _coverage(truth: Sequence[ConcealedEffect], verdict: Verdict, effects: Mapping[str, Effect]) -> Row:
    """Number of 90 % intervals of parameters of the same law, and how many contain the truth."""
    intervals, held = 0, 0
    reported = {effect.name: effect.parameters for effect in verdict.effects}
    for one in truth:
        if one.parameters_are != "same":
            continue
        for parameter in reported.get(one.kind, ()):
            if parameter.name in one.parameters:
                intervals += 1
                held += parameter.low <= one.parameters[parameter.name] <= parameter.high
    return {"intervals": intervals, "intervals_held": held}


SLIDING = ("slide", "across hits", "camera")  # whose gain shows on held-out slides


def gain_share(
    row: Row, case_folder: Path, setting: Setting, signatures: Signatures, seed: int
) -> float | None:
    """Held-out log-likelihood gained over that of the true family; None where slides show none.

    Args:
        row: of the scored case.
        case_folder: with recording/.
        setting: of the diagnosis.
        signatures: of the pool of commands.
        seed: of the diagnosis, so that the same hits are held out.
    """
    effects = catalogue()
    kinds = str(row["conceals"]).split("+")
    if not all(kind in effects and effects[kind].phase in SLIDING for kind in kinds) or not row["found"]:
        return None
    named = str(row["named"]).split("+")
    gained = float(row["augmented_loglik_per_hit"] or 0.0)
    if set(kinds) <= set(named):
        return 1.0
    known = {kind: effects[kind] for kind in kinds}
    recording = read_recording(case_folder / "recording")
    verdict = diagnose(recording, setting, seed, known, signatures=signatures).verdict
    possible = verdict.fit["augmented"].loglik_per_hit.value if verdict.fit else 0.0
    return gained / possible if possible > 0 else None
