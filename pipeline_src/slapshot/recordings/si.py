"""Conversion of common units to SI: `to_si`, `check_si`.

A unit has one spelling in a recording ("N m", not "Nm"). Only unambiguous spellings are known: "m" is a metre
and never a minute.
"""

import math
from typing import NamedTuple

from slapshot.validation import short

_TURN = 2 * math.pi
_POUND_FORCE_N, _KILOGRAM_FORCE_N, _INCH_M = 4.4482216152605, 9.80665, 0.0254  # all three exact
_OUNCE_FORCE_N = _POUND_FORCE_N / 16

# SI unit -> other spellings of it, and other units of its kind with their size in it.
_OF_SI: dict[str, dict[str, float]] = {
    "rad": {
        "radian": 1.0,
        "radians": 1.0,
        "mrad": 1e-3,
        "deg": _TURN / 360,
        "degree": _TURN / 360,
        "degrees": _TURN / 360,
        "°": _TURN / 360,
        "rev": _TURN,
        "turn": _TURN,
        "turns": _TURN,
    },
    "m": {"km": 1e3, "dm": 0.1, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "in": _INCH_M, "ft": 0.3048},
    "rad/s": {
        "mrad/s": 1e-3,
        "deg/s": _TURN / 360,
        "degrees/s": _TURN / 360,
        "°/s": _TURN / 360,
        "dps": _TURN / 360,
        "rpm": _TURN / 60,
        "1/min": _TURN / 60,
        "rev/min": _TURN / 60,
        "rev/s": _TURN,
        "turns/s": _TURN,
    },
    "m/s": {
        "cm/s": 1e-2,
        "mm/s": 1e-3,
        "km/h": 1 / 3.6,
        "mm/min": 1e-3 / 60,
        "in/s": _INCH_M,
        "ft/s": 0.3048,
    },
    "N m": {
        "kN m": 1e3,
        "mN m": 1e-3,
        "uN m": 1e-6,
        "N cm": 1e-2,
        "N mm": 1e-3,
        "kgf m": _KILOGRAM_FORCE_N,
        "kgf cm": _KILOGRAM_FORCE_N / 100,
        "lbf ft": _POUND_FORCE_N * 12 * _INCH_M,
        "lbf in": _POUND_FORCE_N * _INCH_M,
        "ozf in": _OUNCE_FORCE_N * _INCH_M,
    },
    "N": {
        "kN": 1e3,
        "mN": 1e-3,
        "kgf": _KILOGRAM_FORCE_N,
        "gf": _KILOGRAM_FORCE_N / 1000,
        "lbf": _POUND_FORCE_N,
    },
    "1": {"%": 0.01, "percent": 0.01, "per mille": 1e-3},
    "s": {"sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
}


def _key(unit: str) -> str:
    """The unit without what people write differently: blanks and signs of multiplication."""
    return "".join(c for c in unit.replace("μ", "µ") if not c.isspace() and c not in "*·⋅.")


class InSi(NamedTuple):
    """A unit in SI: one of it is `factor` of `unit`."""

    unit: str
    factor: float


_KNOWN = {
    _key(name): InSi(si, factor)
    for si, others in _OF_SI.items()
    for name, factor in {si: 1.0, **others}.items()
}


def to_si(unit: str) -> InSi:
    """What a unit is in SI.

    Args:
        unit: such as "deg/s", "mNm" or "N m".

    Raises:
        ValueError: it is not known; one line with what to write instead.
    """
    found = _KNOWN.get(_key(unit))
    if found is None:
        names = ", ".join(name for si, others in _OF_SI.items() for name in (si, *others))
        raise ValueError(f"{short(unit)} is no unit that is known; write one of: {names}")
    return found


def check_si(unit: str, allowed: tuple[str, ...], what: str) -> None:
    """Refuse a unit other than those allowed, and say how to convert where that is possible.

    Args:
        unit: as it was given.
        allowed: SI units.
        what: has such a unit, for the message.

    Raises:
        ValueError: one line.
    """
    if unit in allowed:
        return
    fits = " or ".join(repr(name) for name in allowed)
    si = _KNOWN.get(_key(unit))
    if si is None or si.unit not in allowed:
        of_time = "; times stand in column t" if si is not None and si.unit == "s" else ""
        raise ValueError(
            f"{short(unit)} is no unit of a {what}{of_time}; write {fits}, and give values in that"
        )
    if si.factor == 1:
        raise ValueError(f"{short(unit)} is not how it is spelt here; write {si.unit!r}")
    raise ValueError(
        f"{short(unit)} is not SI; multiply the values by {si.factor:.10g} and write {si.unit!r}"
    )
