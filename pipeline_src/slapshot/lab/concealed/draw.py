"""Draw what a rig conceals, as `lab.concealed` of the settings asks."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from slapshot.errors import InputError
from slapshot.lab.concealed.effect_size_calibration import Rehearsal
from slapshot.lab.concealed.hidden_effect import Concealed
from slapshot.lab.concealed.registry import hidden_effect_named
from slapshot.lab.ranges import draw_number
from slapshot.lab.rng_streams import stream_for


def check_concealed(settings: Mapping[str, Any]) -> None:
    """Refuse what cannot be concealed together.

    Raises:
        InputError: a kind is unknown, stands twice, or contradicts the settings of the blade.
    """
    names = [entry["kind"] for entry in settings["concealed"]]
    for name in names:
        hidden_effect_named(name)
        if names.count(name) > 1:
            raise InputError(f"lab.concealed: {name} stands twice; give it once, with a larger amplitude")
    if "compliant_blade" in names and settings["blade"] is not None:
        raise InputError(
            "lab.concealed: compliant_blade and lab.blade bend the same blade; set lab.blade to null"
        )


def draw_concealed(
    entries: Sequence[Mapping[str, Any]], rehearsal: Rehearsal, rng: np.random.Generator
) -> tuple[Concealed, ...]:
    """Draw shapes and amplitudes; every kind has its own stream, so that to take one away leaves the rest.

    Args:
        entries: {kind, amplitude} or {kind, displacement}, each a number or [low, high].
        rehearsal: of the session.
        rng: source of the streams.
    """
    found = []
    for entry in entries:
        kind = hidden_effect_named(entry["kind"])
        shape_rng, size_rng = stream_for(rng, kind.name).spawn(2)
        shape = kind.draw(rehearsal.setting, shape_rng)
        key = "amplitude" if "amplitude" in entry else "displacement"
        size = draw_number(entry[key], f"concealed.{kind.name}.{key}", size_rng)
        if key == "displacement":
            found.append(rehearsal.find(kind, shape, size))
            continue
        if size > kind.largest or 0 < size < kind.least:
            raise InputError(
                f"lab.concealed: {kind.name}: an amplitude of {size:g} {kind.unit} is not possible; "
                f"use 0, or {kind.least:g} to {kind.largest:g}"
            )
        plain = Concealed(kind, size, shape)
        displacement = rehearsal.displacement(plain) if size else 0.0
        found.append(Concealed(kind, size, shape, displacement))
    return tuple(found)
