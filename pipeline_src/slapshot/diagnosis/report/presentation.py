"""Phrases, numbers, units and colours that text, figures and the Rerun recording of a report share."""

import html
import math
import re
from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure

from slapshot.diagnosis.verdict import ChannelNoise, Fits, Interval, NamedEffect, NamedParameter, Verdict
from slapshot.effects.joints.catalogue import joint_effects
from slapshot.effects.joints.external_pulse import AT_KNOT, ExternalPulse
from slapshot.plotting import METHOD_COLOURS, OTHER_COLOURS, STAND_IN
from slapshot.text import printable

MODELS = {
    "nominal": "nominal model, as it was given",
    "refitted": "nominal model, its free parameters refitted",
    "augmented": "model with what was found",
    "noise_floor": "noise floor: what noise of the readings and stamps alone leaves",
}
# Variable that a mismatch follows -> how a sentence says it.
VARIABLES = {
    "position": "its position",
    "velocity": "its velocity",
    "load": "the torque of its actuator",
    "time": "the time since the episode began",
    "session": "the course of the session, episode by episode",
    "episode": "no one law: it is another in each episode",
}
_FEW_PUSHES = 3  # that a headline names one by one
_PREFIXES = ((1e-4, "µ", 1e6), (0.1, "m", 1e3))  # below the first number; the prefix, its factor
_SMALLEST = 1e-9  # below: powers of ten
_PREFIXED = re.compile(r"(rad|m|s|N|kg)(?=$|[ /])")  # units whose first part takes a prefix
_GRAMS = {"kg": "g", "mkg": "g", "µkg": "mg"}
_KEY = re.compile(r"([^@(]+?)(?:@(.*?))?( \(.*\))?")


def headline(verdict: Verdict) -> str:
    """The verdict in one sentence, without its full stop."""
    if verdict.headline == "cannot_tell":
        return "Cannot tell"
    if verdict.headline == "nothing_found":
        return "Nothing found: no test says that the nominal model lacks anything"
    if verdict.headline == "found":
        further = verdict.unknown is not None and verdict.unknown.flagged
        names = listed(_in_short(verdict.effects))
        return f"Something is missing: {names}" + (", and something that no name explains" if further else "")
    location = verdict.location
    at = "" if location is None or not location.part else f" at {location.part}"
    return f"Something is missing{at}, and no effect is named"


def _in_short(effects: Sequence[NamedEffect]) -> list[str]:
    """Effects in a sentence; many pushes are counted, since the page says when each was."""
    pushes = [effect for effect in effects if effect.name == ExternalPulse.name]
    if len(pushes) <= _FEW_PUSHES:
        return [named(effect) for effect in effects]
    rest = [named(effect) for effect in effects if effect.name != ExternalPulse.name]
    return [*rest, f"{len(pushes)} pushes"]


def named(effect: NamedEffect) -> str:
    """An effect in a sentence."""
    return f"{effect.phrase} ({effect.variant})" if effect.variant else effect.phrase


def phrase_of(key: str) -> str:
    """An effect in a sentence, by its key `name@part (variant)`."""
    match = _KEY.fullmatch(key)
    if match is None or match[1] not in joint_effects():
        return key.replace("_", " ")
    return joint_effects()[match[1]].phrase.format(part=match[2] or "") + (match[3] or "")


def place(verdict: Verdict) -> str:
    """Where the mismatch is and what it follows."""
    location = verdict.location
    if location is None:
        return "nowhere"
    at = location.part or "the whole rig"
    follows = VARIABLES.get(location.follows, location.follows)
    return f"{at}; follows {follows}"


def shown_models(verdict: Verdict) -> list[str]:
    """Models that differ from one another, as keys of `MODELS`."""
    refitted = ["refitted"] if verdict.nominal_parameters else []
    return ["nominal", *refitted, *(["augmented"] if verdict.effects else []), "noise_floor"]


def scaled(unit: str, size: float) -> tuple[str, float]:
    """A readable unit for SI numbers of a size, and the factor to it."""
    if unit == "1":
        return ("%", 100.0) if size < 10 else ("", 1.0)
    pretty = unit.replace("^2", "²").replace("^3", "³")
    if not _PREFIXED.match(unit) or not _SMALLEST < size < 0.1:
        return pretty, 1.0
    prefix, factor = next((p, f) for limit, p, f in _PREFIXES if size < limit)
    first = _PREFIXED.match(pretty)
    if first is not None and first[0] == "kg":
        return _GRAMS[prefix + "kg"] + pretty[2:], factor
    if pretty.startswith(("m²", "s²")):  # a prefix would be squared with it
        return pretty, 1.0
    return prefix + pretty, factor


def plain(unit: str) -> str:
    """Unit of a reading: components of a quaternion are not shares, which would be given in per cent."""
    return "" if unit == "1" else unit


def numbers(values: Sequence[float], spread: float) -> list[str]:
    """Numbers with as many decimals as `spread` has at two digits."""
    spread = abs(spread) if math.isfinite(spread) else 0.0
    if spread == 0.0:
        spread = max((abs(v) for v in values), default=0.0) / 10
    decimals = 0 if spread == 0 else 1 - math.floor(math.log10(spread))
    if decimals > 8:
        return [f"{v:.3g}" for v in values]
    texts = [f"{v:.{max(decimals, 0)}f}" for v in values]
    return [re.sub(r"^-(?=[0.]*$)", "", text) for text in texts]


def between(interval: Interval) -> str:
    """12.3 mrad (11.9 to 12.8); without an interval the value alone."""
    values = (interval.value, interval.low, interval.high)
    unit, factor = scaled(interval.unit, max(abs(v) for v in values))
    texts = numbers([factor * v for v in values], factor * (interval.high - interval.low))
    if interval.low == interval.high:
        return quantity(interval.value, interval.unit)
    return f"{texts[0]}{_unit(unit)} ({texts[1]} to {texts[2]})"


def quantity(value: float, unit: str) -> str:
    """A number alone, to three digits: 0.512 N m."""
    readable, factor = scaled(unit, abs(value))
    text = f"{factor * value:.3g}"
    return f"{text}{_unit(readable)}"


def left_out(fit: Fits) -> str:
    """How many held-out windows are not predicted; "" for all of them."""
    if not fit.windows_left_out:
        return ""
    return f", without {several(fit.windows_left_out, 'further window')} in which something pushes"


def errors_text(verdict: Verdict, kind: str) -> str:
    """Prediction errors of one quantity, model by model, in one unit."""
    assert verdict.fit is not None
    models = shown_models(verdict)
    found = [getattr(verdict.fit, model).rms[kind] for model in models]
    unit, factor = error_unit(verdict, kind)
    names = {"noise_floor": "noise floor"}
    parts = [
        f"{names.get(model, model)} {factor * interval.value:.3g}"
        for model, interval in zip(models, found, strict=True)
    ]
    return f"{', '.join(parts)}{_unit(unit)}"


def error_unit(verdict: Verdict, kind: str) -> tuple[str, float]:
    """One readable unit for the errors of all models, midway between their sizes, and the factor to it."""
    assert verdict.fit is not None
    found = [getattr(verdict.fit, model).rms[kind] for model in shown_models(verdict)]
    sizes = [interval.value for interval in found]
    return scaled(plain(found[0].unit), math.sqrt(max(sizes) * min(sizes)))


def noise_text(noise: ChannelNoise) -> str:
    """White and coloured noise of a channel, its drift, and jitter of its samples."""
    unit = plain(noise.unit)
    parts = [f"{quantity(noise.white, unit)} white"]
    if noise.coloured:
        parts.append(f"{quantity(noise.coloured, unit)} correlated over {quantity(noise.correlation_s, 's')}")
    if noise.growth != 1:
        parts.append(f"{noise.growth:.2f} times as much at the session's end as at its beginning")
    if noise.drift:
        parts.append(f"{quantity(noise.drift, unit)} drift over the session")
    if noise.jitter_s:
        parts.append(f"{quantity(noise.jitter_s, 's')} jitter of the sample times")
    return ", ".join(parts)


def shown(effect: NamedEffect) -> list[NamedParameter]:
    """Parameters on a page: of a push with knots, which `verdict.json` lists, the largest force."""
    found: dict[str, NamedParameter] = {}
    for parameter in effect.parameters:
        push = parameter.name.partition(AT_KNOT)[0]
        if push not in found or abs(parameter.value) > abs(found[push].value):
            found[push] = parameter
    return list(found.values())


def label(parameter: NamedParameter) -> str:
    """Name of a parameter in a table."""
    return parameter.name.replace(AT_KNOT, ", largest at ").replace("_", " ")


def rivals_text(rivals: Mapping[str, float]) -> str:
    """Equivalent rivals and their difference in nats; better ones have more parameters."""

    def compare(key: str, nats: float) -> str:
        more = f"{nats:.1f} nats worse" if nats >= 0 else f"{-nats:.1f} nats better, by more parameters"
        return f"{phrase_of(key)} ({more})"

    return listed([compare(key, nats) for key, nats in rivals.items()], "or")


def listed(words: Sequence[str], last: str = "and") -> str:
    """A, B and C."""
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} {last} {words[-1]}"


def several(count: int, noun: str) -> str:
    """1 episode, 2 episodes."""
    return f"{count} {noun}{'s' * (count != 1)}"


def sentence(text: str) -> str:
    """A text from outside as a sentence in Markdown."""
    line = escaped(text).rstrip(".")
    return f"{line[:1].upper()}{line[1:]}."


def escaped(text: str) -> str:
    """A text from outside (a name, a note) as Markdown that shows just it, on one line."""
    line = html.escape(printable(" ".join(text.split())), quote=False)
    return re.sub(r"([\\`*_\[\]|#~])", r"\\\1", line)


def _unit(unit: str) -> str:
    return f" {unit}" if unit else ""


RECORDED = "#D55E00"
NOMINAL = "#7A7A7A"
REFITTED = "#A6761D"
AUGMENTED = METHOD_COLOURS["kalman"]
FREE_FORM = OTHER_COLOURS[0]
NOISE = "#C9DFC3"  # band of what noise alone leaves
MODEL_COLOURS = {"nominal": NOMINAL, "refitted": REFITTED, "augmented": AUGMENTED, "noise_floor": "black"}
Z90 = 1.645
_WARNING = "#A00000"


def mark_stand_in(figure: Figure, verdict: Verdict) -> None:
    """Say at the top where the recording is no robot's."""
    if verdict.stand_in:
        figure.suptitle(f"recorded: {STAND_IN}", fontsize=7, color=_WARNING, x=0.995, ha="right")
