"""Summary of the verdict for the terminal."""

import textwrap

from slapshot.diagnosis.report.presentation import (
    between,
    errors_text,
    headline,
    label,
    left_out,
    named,
    noise_text,
    place,
    quantity,
    rivals_text,
    several,
    shown,
)
from slapshot.diagnosis.selection.steps import P_VALUE
from slapshot.diagnosis.verdict import Verdict
from slapshot.plotting import STAND_IN
from slapshot.text import printable

_WIDTH = 108
_MAX_SHOWN = 3  # channels, rivals or quantities that are listed individually
_INDENT = 13


def terminal_text(verdict: Verdict) -> str:
    """Headline and one line for each result; 5 to 15 lines."""
    kind = f" ({STAND_IN})" if verdict.stand_in else ""
    recorded = f"{verdict.rig}{kind}, {several(verdict.episodes, 'episode')}"
    if verdict.seconds:
        recorded += f", {verdict.seconds:.3g} s"
    lines = [_line("", headline(verdict)), _line("recording", recorded)]
    if verdict.cannot_tell is not None:
        lines += [_line("because", verdict.cannot_tell), *_findings(verdict)]
        if not verdict.findings:
            lines.append(_line("check", "no quality warnings"))
        lines.append(_line("next", "fix the problem above, and diagnose the recording again"))
        return "\n".join(lines)
    mismatch, unknown = verdict.mismatch, verdict.unknown
    assert mismatch is not None
    assert unknown is not None
    yes = "yes" if mismatch.found else "no"
    if mismatch.found and mismatch.p_value >= P_VALUE:
        yes = "yes, by held-out data"
    lines.append(_line("mismatch", f"{yes}, p = {mismatch.p_value:.2g}; largest score: {mismatch.strongest}"))
    for effect in verdict.effects:
        values = "; ".join(f"{label(p)} {between(p)}{_state(p.state)}" for p in shown(effect))
        lines.append(_line("what", f"{named(effect)}: {values}"))
        if effect.same_as:
            lines.append(_line("same as", effect.same_as))
        if effect.rivals:
            some = dict(list(effect.rivals.items())[:_MAX_SHOWN])
            more = f", and {len(effect.rivals) - _MAX_SHOWN} more" if len(effect.rivals) > _MAX_SHOWN else ""
            lines.append(_line("or", f"{rivals_text(some)}{more}"))
    if verdict.location is not None:
        size = verdict.location.size
        rms = "" if size is None else f"; {quantity(size.value, size.unit)} rms"
        lines.append(_line("where", f"{place(verdict)}{rms}"))
    assert verdict.fit is not None
    for kind in list(verdict.fit.nominal.rms)[:_MAX_SHOWN]:
        lines.append(
            _line(
                "held out",
                f"{kind}, rms error over {verdict.fit.window_s:.2g} s: {errors_text(verdict, kind)}"
                f"{left_out(verdict.fit)}",
            )
        )
    if unknown.flagged:
        seen = f", p = {unknown.p_value:.2g};" if unknown.p_value < P_VALUE else ":"
        lines.append(_line("left", f"something{seen} {unknown.description}"))
    elif verdict.effects:
        lines.append(_line("left", f"no significant mismatch, p = {unknown.p_value:.2g}"))
    channels = [f"{name} {noise_text(noise)}" for name, noise in list(verdict.noise.items())[:2]]
    if len(verdict.noise) > 2:
        channels.append(f"{len(verdict.noise) - 2} more in verdict.md")
    lines.append(_line("noise", "; ".join(channels)))
    if verdict.limits:
        lines.append(
            _line(
                "limits",
                f"{several(len(verdict.limits), 'line')} in verdict.md: upper limits of undetected effects",
            )
        )
    return "\n".join([*lines, *_findings(verdict)])


def _findings(verdict: Verdict) -> list[str]:
    lines = [_line("check", finding, most=2) for finding in verdict.findings[:_MAX_SHOWN]]
    if len(verdict.findings) > _MAX_SHOWN:
        lines.append(_line("check", f"{len(verdict.findings) - _MAX_SHOWN} more in verdict.md"))
    return lines


def _state(state: str) -> str:
    return {"at a bound": ", at a bound", "flat": ", hardly narrowed down by the data"}.get(state, "")


def _line(head: str, text: str, most: int = 3) -> str:
    """A heading and a text, wrapped to the terminal; no control characters, whatever names do."""
    width, indent = (_WIDTH - _INDENT, _INDENT) if head else (_WIDTH, 0)
    parts = textwrap.wrap(printable(text), width, max_lines=most, placeholder=" ...") or [""]
    first = f"  {head:<{_INDENT - 2}}" if head else ""
    return f"\n{' ' * indent}".join([first + parts[0], *parts[1:]])
