"""Score of one case of joints: its verdict compared with the truth, both read from files.

The sealed truth of the joint lab is read here only. Every catalogued hidden effect of the lab corresponds to
the effect of the same name. On some rigs another effect is exactly the same law, so that no recording
distinguishes the two: these are aliases. Neither a merely similar law nor a more general one is an alias.
"""

import re
from collections.abc import Mapping, Sequence
from itertools import permutations
from pathlib import Path
from typing import NamedTuple

from pydantic import BaseModel

from slapshot.diagnosis.verdict import Fits, Verdict
from slapshot.effects.joints.catalogue import joint_effects
from slapshot.json_types import Row

_KEY = re.compile(r"(?P<name>[^@ ]+)(?:@(?P<part>.*?))?(?: \(.*\))?(?: from order \S+)?$")
_OF_WHOLE_RIG = {"gravity_tilt", "base_compliance"}  # their effects sit on no part


class LocatedEffect(NamedTuple):
    """An effect at a part of the rig; "" for the whole rig."""

    effect: str
    part: str


# Rig and concealed effect -> the one that is the same law there. tests/blind_validation/joints compares both
# with each other by inverse dynamics.
ALIASES: Mapping[tuple[str, LocatedEffect], LocatedEffect] = {
    # All axes of this rig are level and parallel: turning the first link's zero turns all links against
    # gravity alike, as turning gravity about that axis does, and inertia does not depend on the first angle.
    ("pendulum", LocatedEffect("joint_offset", "joint1")): LocatedEffect("gravity_tilt", ""),
    # The first axis is upright and its link turns about it alone: gravity does no work, and whatever the link
    # weighs adds a constant to the inertia about that axis, as a rotor does.
    ("arm", LocatedEffect("armature", "joint1")): LocatedEffect("link_mass", "turret"),
    ("kuka", LocatedEffect("armature", "q0")): LocatedEffect("link_mass", "link1"),
    ("kuka", LocatedEffect("link_mass", "link1")): LocatedEffect("armature", "q0"),
}


class ConcealedEffect(BaseModel):
    """What the truth says of a hidden effect, see lab.joints.hidden_effect."""

    kind: str
    catalogued: bool
    joint: str | None
    body: str | None
    amplitude: float
    amplitude_unit: str


class SealedTruth(BaseModel):
    """The part of a sealed truth that is scored."""

    rig: str
    size: float
    concealed: list[ConcealedEffect]


def equivalent_effects(rig: str, concealed: ConcealedEffect) -> tuple[LocatedEffect, ...]:
    """Effects that correctly name a hidden effect: the effect of the same name first, then an alias.

    Args:
        rig: name of the stand-in rig.
        concealed: an entry of `concealed` in the truth.
    """
    part = "" if concealed.kind in _OF_WHOLE_RIG else concealed.joint or concealed.body or ""
    own = LocatedEffect(concealed.kind, part)
    alias = ALIASES.get((rig, own))
    return (own,) if alias is None else (own, alias)


def parse_key(key: str) -> LocatedEffect:
    """Effect and part of an effect's key, `name@part (variant)`."""
    found = _KEY.match(key)
    assert found is not None, f"{key!r} is no key of an effect"
    return LocatedEffect(found["name"], found["part"] or "")


TRUTH = Path("sealed") / "truth.json"
P_VALUE = 0.05
GEARED = frozenset({"joint_elasticity", "backlash"})  # whose held-out error has an aim of its own

# Yes or no, empty where it does not apply.
ANSWERS = (
    "cannot_tell", "p_below_05", "false_alarm", "detected", "named_first", "in_class", "joint_right",
    "both_named", "unknown_flagged", "false_unknown", "made_worse",
)  # fmt: skip
COLUMNS = (
    "case", "condition", "rig", "concealed", "size", "group", "geared", "headline", "reason", "p_value",
    "named", "unknown", *ANSWERS, "held_out_over_floor", "cpu_s",
)  # fmt: skip


def score(case: str, condition: str, case_folder: Path, verdict: Verdict) -> Row:
    """A row of cases.csv; what does not apply is None.

    An undecided verdict (cannot_tell) is a miss wherever something is concealed; for a null it is not a false
    alarm, and counts among its cases.

    Args:
        case: its name.
        condition: of the list.
        case_folder: of stage `joint_case`, with the sealed truth.
        verdict: on its recording.
    """
    truth = SealedTruth.model_validate_json((case_folder / TRUTH).read_text())
    concealed = truth.concealed
    right = [equivalent_effects(truth.rig, one) for one in concealed]
    known = all(one.catalogued for one in concealed)
    p_value = None if verdict.mismatch is None else verdict.mismatch.p_value
    row: Row = {
        "case": case,
        "condition": condition,
        "rig": truth.rig,
        "concealed": " + ".join(map(_describe, concealed)),
        "size": truth.size if concealed else None,
        "group": _group(concealed),
        "geared": any(one.kind in GEARED for one in concealed),
        "headline": verdict.headline,
        "reason": verdict.reason if verdict.cannot_tell is None else verdict.cannot_tell,
        "p_value": p_value,
        "named": " + ".join(f"{e.name}@{e.part}" if e.part else e.name for e in verdict.effects),
        "unknown": verdict.unknown is not None and verdict.unknown.flagged,
        "cpu_s": verdict.cpu_s,
    }
    row["cannot_tell"] = verdict.headline == "cannot_tell"
    alarm = verdict.headline in ("found", "found_not_named")
    if not concealed:
        row["p_below_05"] = p_value is not None and p_value < P_VALUE
        row["false_alarm"] = alarm
    else:
        row["detected"] = alarm
        row |= _naming(right, verdict) if known else {"unknown_flagged": row["unknown"]}
        if known and len(concealed) == 1:
            row["false_unknown"] = row["unknown"]
    row["made_worse"] = verdict.fit is not None and _is_worse(verdict.fit)
    if verdict.fit is not None:
        row["held_out_over_floor"] = _over_floor(verdict.fit)
    return row


def _describe(concealed: ConcealedEffect) -> str:
    part = concealed.joint or concealed.body
    value = f"{concealed.amplitude:.3g} {concealed.amplitude_unit}".removesuffix(" 1")
    return f"{concealed.kind}{f'@{part}' if part else ''} {value}"


def _group(concealed: Sequence[ConcealedEffect]) -> str:
    """Group by effort: structural effects add states to the model and take longest."""
    if not concealed:
        return "nothing concealed"
    if not all(one.catalogued for one in concealed):
        return "uncatalogued"
    effects = joint_effects()
    return "structural effect" if any(effects[c.kind].hidden_state for c in concealed) else "force effect"


def _naming(right: Sequence[tuple[LocatedEffect, ...]], verdict: Verdict) -> Row:
    """Of one effect: name, class and part of the effect named first; of two: whether both are named."""
    answer = [LocatedEffect(effect.name, effect.part) for effect in verdict.effects]
    if len(right) > 1:
        fitting = permutations(answer, len(right))
        return {"both_named": any(all(map(_matches, order, right)) for order in fitting)}
    first, names = answer[:1], right[0]
    in_class = [*first, *(parse_key(key) for effect in verdict.effects[:1] for key in effect.rivals)]
    return {
        "named_first": any(_matches(one, names) for one in first),
        "in_class": any(_matches(one, names) for one in in_class),
        "joint_right": any(one.part == names[0].part or one in names[1:] for one in first),
    }


def _matches(answer: LocatedEffect, names: tuple[LocatedEffect, ...]) -> bool:
    """Whether an effect is the concealed one at any part, or an alias at its part."""
    return answer.effect == names[0].effect or answer in names[1:]


def _is_worse(fit: Fits) -> bool:
    """Whether the augmented model predicts held-out windows worse than the refitted model's interval."""
    return any(error.value > fit.refitted.rms[quantity].high for quantity, error in fit.augmented.rms.items())


def _over_floor(fit: Fits) -> float:
    """Held-out error over the noise floor, of the worst quantity."""
    return max(error.value / fit.noise_floor.rms[q].value for q, error in fit.augmented.rms.items())
