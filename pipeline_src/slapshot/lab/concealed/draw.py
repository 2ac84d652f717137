"""Draw what a rig conceals, as `lab.concealed` of the settings asks."""

from collections.abc import Sequence

import numpy as np

from slapshot.config.lab import ConcealedEffect
from slapshot.errors import InputError
from slapshot.lab.concealed.effect_size_calibration import Rehearsal
from slapshot.lab.concealed.hidden_effect import Concealed
from slapshot.lab.concealed.registry import hidden_effect_named
from slapshot.lab.ranges import draw_number
from slapshot.lab.rng_streams import stream_for


def draw_concealed(
    entries: Sequence[ConcealedEffect], rehearsal: Rehearsal, rng: np.random.Generator
) -> tuple[Concealed, ...]:
    """Draw shapes and amplitudes; every kind has its own stream, so that to take one away leaves the rest.

    Args:
        entries: kinds with an amplitude or a displacement, each a number or [low, high].
        rehearsal: of the session.
        rng: source of the streams.
    """
    found = []
    for entry in entries:
        kind = hidden_effect_named(entry.kind)
        shape_rng, size_rng = stream_for(rng, kind.name).spawn(2)
        shape = kind.draw(rehearsal.setting, shape_rng)
        if entry.displacement is not None:
            size = draw_number(entry.displacement, size_rng)
            found.append(rehearsal.find(kind, shape, size))
            continue
        assert entry.amplitude is not None
        size = draw_number(entry.amplitude, size_rng)
        if size > kind.largest or 0 < size < kind.least:
            raise InputError(
                f"lab.concealed: {kind.name}: an amplitude of {size:g} {kind.unit} is not possible; "
                f"use 0, or {kind.least:g} to {kind.largest:g}"
            )
        plain = Concealed(kind, size, shape)
        displacement = rehearsal.displacement(plain) if size else 0.0
        found.append(Concealed(kind, size, shape, displacement))
    return tuple(found)
