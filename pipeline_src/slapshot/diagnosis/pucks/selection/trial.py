"""Whether an effect works at all: one that fails is dropped with a line in the verdict, the rest goes on."""

from collections.abc import Mapping

import numpy as np

from slapshot.arrays import Array
from slapshot.effects.effect import Effect
from slapshot.effects.slide_law import ActiveEffect, slide
from slapshot.text import reason_of

# Headings in rad of hits from the board's near end, their speed in m/s and spin in rad/s.
HEADINGS = np.linspace(-1.0, 1.0, 5)
SPEED, SPIN = 1.5, 2.0
SECONDS = 1.0


def that_work(
    effects: Mapping[str, Effect], start: Array, friction: tuple[float, float, float], radius: float
) -> tuple[dict[str, Effect], tuple[str, ...]]:
    """Effects whose slides and views of a camera are finite near their neutral values, and notes on others.

    Args:
        effects: to try.
        start: (2,) m, where objects lie.
        friction: mu_x, mu_y and torsional friction in m.
        radius: m, of the object.
    """
    kept, notes = {}, []
    for name, effect in effects.items():
        problem = _problem(effect, start, friction, radius)
        if problem is None:
            kept[name] = effect
        else:
            notes.append(dropped_note(name, problem))
    return kept, tuple(notes)


def dropped_note(name: str, problem: str) -> str:
    """A line of the verdict."""
    return f"the hypothesis {name} was dropped: its simulation failed ({problem})"


def _problem(effect: Effect, start: Array, friction: tuple[float, float, float], radius: float) -> str | None:
    count = len(HEADINGS)
    zero = np.zeros(count)
    velocity = SPEED * np.cos(HEADINGS), SPEED * np.sin(HEADINGS)
    launches = np.column_stack([np.tile(start, (count, 1)), zero, *velocity, zero + SPIN])
    values = {p.name: zero + np.clip(p.neutral + p.scale, p.low, p.high) for p in effect.parameters}
    try:
        acting = [ActiveEffect(effect, np.arange(count), values)] if effect.acts_on_slide else []
        tracks = slide(launches, np.tile(friction, (count, 1)), radius, SECONDS, acting)
        seen = effect.see(values, tracks.places, start)
    except (Exception, SystemExit) as error:  # an effect may be anybody's code
        return reason_of(error)
    return None if np.isfinite(seen).all() and np.isfinite(tracks.rests).all() else "it is not finite"
