"""Draw the hidden effects of a rig, as specified by `lab.concealed` in the settings."""

from collections.abc import Sequence

import numpy as np

from slapshot.config.lab import ConcealedEffect
from slapshot.errors import InputError
from slapshot.lab.hidden_effects.effect_size_calibration import EffectSizeCalibration
from slapshot.lab.hidden_effects.hidden_effect import Concealed
from slapshot.lab.hidden_effects.registry import hidden_effect_named
from slapshot.lab.ranges import draw_number
from slapshot.lab.rng_streams import stream_for


def draw_concealed(
    entries: Sequence[ConcealedEffect], size_calibration: EffectSizeCalibration, rng: np.random.Generator
) -> tuple[Concealed, ...]:
    """Draw shapes and amplitudes; every effect has its own stream, so that removing one leaves the others.

    Args:
        entries: effects with an amplitude or a displacement, each a number or [low, high].
        size_calibration: of the session.
        rng: source of the streams.
    """
    found = []
    for entry in entries:
        effect = hidden_effect_named(entry.kind)
        shape_rng, size_rng = stream_for(rng, effect.name).spawn(2)
        shape = effect.draw(size_calibration.nominal, shape_rng)
        if entry.displacement is not None:
            size = draw_number(entry.displacement, size_rng)
            found.append(size_calibration.find(effect, shape, size))
            continue
        assert entry.amplitude is not None
        size = draw_number(entry.amplitude, size_rng)
        if size > effect.max_amplitude or 0 < size < effect.min_amplitude:
            raise InputError(
                f"lab.concealed: {effect.name}: an amplitude of {size:g} {effect.unit} is not possible; "
                f"use 0, or {effect.min_amplitude:g} to {effect.max_amplitude:g}"
            )
        plain = Concealed(effect, size, shape)
        displacement = size_calibration.displacement(plain) if size else 0.0
        found.append(Concealed(effect, size, shape, displacement))
    return tuple(found)
