"""Words and units for people: what an effect is called in a sentence, and its numbers in mm/m or degrees."""

import html
import math
import re
from collections.abc import Sequence

from slapshot.effects.bases import BOARD
from slapshot.text import printable

# As the end of "Something is missing: ...". An effect without a phrase is called by its name.
PHRASES = {
    "backlash": "the arm's joints have play",
    "command_delay": "commands reach the servos late",
    "joint_elasticity": "the arm's joints give way under load",
    "servo_gain": "the servos follow their targets otherwise than the scene says",
    "tracking_lag": "the arm lags behind its commands",
    "blade_friction": "the friction of the blade is not that of the scene",
    "blade_yaw": "the blade is turned on its stick",
    "compliant_blade": "the blade yields as it hits",
    "restitution": "the object bounces off the blade otherwise than the scene says",
    "curl": "the object's path bends with its spin",
    "linear_drag": "a drag in proportion to speed slows the object",
    "offcentre_mass": "the object's centre of mass is not in its middle",
    "place_friction": "friction differs from place to place",
    "quadratic_drag": "a drag with the square of the speed slows the object",
    "stribeck_friction": "friction changes with the speed",
    "tilt": "the board is tilted",
    "turned_anisotropy": "the slippery direction of the board is turned",
    "uneven_board": "the board is not flat",
    "friction_drift": "friction drifts from hit to hit",
    "camera_rotation": "the camera is rotated",
    "camera_scale": "the camera's scale is wrong",
    "camera_time": "the camera's clock is shifted",
    "lens_distortion": "the camera's lens distorts",
}
VARIABLES = {
    "place": "the place on the board",
    "speed": "the speed of the object",
    "heading": "the direction of motion",
    "spin": "the spin of the object",
    "time": "the time since the launch",
    "order": "the order of the hits",
    "command": "the command to the arm",
}
PHASES = {
    "swing": "in the swing of the arm",
    "contact": "in the contact of blade and object",
    "slide": "in the slide of the object",
    "across hits": "across hits",
    "camera": "in the camera",
}

# SI unit -> what a person reads it in, and the factor.
_UNITS = {
    "m/m": ("mm/m", 1e3),
    "m": ("mm", 1e3),
    "s": ("ms", 1e3),
    "rad": ("degrees", 180 / math.pi),
    "rad/(N m)": ("mrad/(N m)", 1e3),
    "1": ("", 1.0),
}

_BUMP = re.compile(r"(log_friction|height)_(\d+)")  # of fields on BOARD; a twist_3 is a joint's


def phrase(effect: str) -> str:
    """What is so if the effect is there."""
    return PHRASES.get(effect, f"{title(effect)} acts")


def title(effect: str) -> str:
    """An effect or a free form in a table."""
    return effect.replace("_", " ")


def capitalised(text: str) -> str:
    """With a capital first letter, the others as they are."""
    return text[:1].upper() + text[1:]


def listed(words: Sequence[str], last: str = "and") -> str:
    """A, B and C."""
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} {last} {words[-1]}"


def several(count: int, noun: str) -> str:
    """1 hit, 2 hits."""
    return f"{count} {noun}{'s' * (count != 1)}"


def numbers(values: Sequence[float], spread: float | None = None) -> list[str]:
    """Numbers with as many decimals as `spread` has at two digits; without one, three digits each."""
    found = []
    for value in values:
        size = abs(value) if spread is None else abs(spread)
        digits = 2 if spread is None else 1
        decimals = 0 if size == 0 else digits - math.floor(math.log10(size))
        found.append(f"{value:.{min(max(decimals, 0), 6)}f}")
    # A minus before nothing but noughts says nothing.
    return [re.sub(r"^-(?=[0.]*$)", "", text) for text in found]


def between(value: float, low: float, high: float, unit: str = "", scale: float = 1.0) -> str:
    """12.3 mm (11.9 to 12.8)."""
    texts = numbers([scale * value, scale * low, scale * high], scale * (high - low))
    return f"{texts[0]}{_space(unit)}{unit} ({texts[1]} to {texts[2]})"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown, of cells that are Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def escaped(text: str) -> str:
    """A text from outside (a name, a note) as Markdown that shows just it, on one line.

    What would be a tag, a link, a heading, the end of a cell or a control character is shown as it stands.
    """
    line = html.escape(printable(" ".join(text.split())), quote=False)
    return re.sub(r"([\\`*_\[\]|#~])", r"\\\1", line)


def parameter_label(name: str, meaning: str) -> str:
    """What a parameter is, as a person would say it; of a field, where its bump is."""
    bump = _BUMP.fullmatch(name)
    if bump:
        along_x, along_y = BOARD.axes
        i, j = divmod(int(bump[2]), BOARD.counts[1])
        kind = title(bump[1].removeprefix("log_"))
        return f"{kind} around x {along_x[i]:.1f} m, y {along_y[j]:.1f} m"
    if _is_log(name):
        return re.sub(r"^log(arithm)? of (the )?", "", meaning)
    return f"{title(name)}: {meaning}"


def is_bump(name: str) -> bool:
    """Whether a parameter is one weight of a field."""
    return _BUMP.fullmatch(name) is not None


def parameter_text(name: str, unit: str, value: float, low: float, high: float) -> str:
    """A parameter with its interval: logarithms as changes in %, slopes in mm/m and degrees."""
    if unit.startswith("log "):
        return between(math.exp(value), math.exp(low), math.exp(high), unit.removeprefix("log "))
    if _is_log(name):
        percent = [100 * math.expm1(v) for v in (value, low, high)]
        texts = [f"{'+' * (not t.startswith('-'))}{t}" for t in numbers(percent, percent[2] - percent[1])]
        return f"{texts[0]} % ({texts[1]} to {texts[2]})"
    shown, factor = _UNITS.get(unit, (unit, 1.0))
    text = between(value, low, high, shown, factor)
    if unit == "m/m":
        degrees = [math.degrees(math.atan(v)) for v in (value, high - low)]
        text += f", {numbers(degrees[:1], degrees[1])[0]} degrees"
    return text


def limit_text(name: str, unit: str, at_most: float) -> str:
    """What a parameter is at most, to either side."""
    if _is_log(name):
        return f"{numbers([100 * math.expm1(at_most)])[0]} %"
    shown, factor = _UNITS.get(unit, (unit, 1.0))
    return f"{numbers([factor * at_most])[0]}{_space(shown)}{shown}"


def _is_log(name: str) -> bool:
    return name.startswith("log_")


def _space(unit: str) -> str:
    return " " if unit else ""
