"""The verdict in ten lines for the terminal."""

from slapshot.diagnosis.pucks.report import wording
from slapshot.diagnosis.pucks.report.sentences import (
    MM,
    VERDICT_TEXT,
    heading,
    headline,
    mm,
    place,
    rest_error,
    rest_floor,
    scenes,
)
from slapshot.diagnosis.pucks.verdict import Verdict
from slapshot.plotting import STAND_IN
from slapshot.text import printable


def terminal_text(verdict: Verdict) -> str:
    """Headline, and a line for each thing worth knowing."""
    kind = f"{verdict.kind}; {STAND_IN}" if verdict.stand_in else verdict.kind
    lines = [
        headline(verdict),
        f"  recording  {verdict.rig} ({kind}), {verdict.used} of {verdict.hits} hits used",
    ]
    notes = [f"  check      {finding}" for finding in verdict.findings]
    notes += [f"  note       {note}" for note in verdict.notes]
    if verdict.cannot_tell is not None:
        return _safe([*lines, f"  because    {verdict.cannot_tell}", *notes])
    mismatch = verdict.mismatch
    assert mismatch is not None
    tests = (
        f"p = {mismatch.p_value:.2g}, evidence {mismatch.log_evidence:.1f} nats, "
        f"tracks {MM * mismatch.shift_m:.1f} mm"
    )
    if mismatch.decided_by == "held-out hits" and verdict.fit is not None:
        chi2 = verdict.fit["refitted"].chi2_per_freedom
        lines.append(
            f"  mismatch   yes: held-out chi-squared {chi2.value:.2f} ({chi2.low:.2f} to {chi2.high:.2f}); "
            f"single hypotheses alone {tests}"
        )
    else:
        lines.append(f"  mismatch   {'yes' if mismatch.found else 'no'}: {tests}")
    if mismatch.found:
        lines.append(f"  where      {place(verdict)}")
    for effect in verdict.effects:
        rivals = ", ".join(f"{wording.title(n)} {100 * p:.0f} %" for n, p in effect.members.items())
        lines.append(f"  what       {rivals}")
        for p in effect.parameters[:2]:
            text = wording.parameter_text(p.name, p.unit, p.value, p.low, p.high)
            lines.append(f"             {wording.parameter_label(p.name, p.meaning)}: {text}")
    if verdict.fit is not None:
        shown = [
            f"{wording.title(name)} {mm(rest_error(verdict.fit[name]))}"
            for name in scenes(verdict)
            if name != "noise_floor"
        ]
        floor = rest_floor(verdict)
        shown += [] if floor is None else [f"noise floor {mm(floor)}"]
        unknown = "; the noise floor cannot be told" if floor is None else ""
        lines.append(f"  rest error {', '.join(shown)} mm{unknown}")
    if verdict.limits:
        lines.append(f"  limits     {wording.several(len(verdict.limits), 'line')} in {VERDICT_TEXT}")
    if verdict.next_hits:
        best = verdict.next_hits[0]
        command = "" if best.like_hit is None else f", the command of hit {best.like_hit}"
        lines.append(f"  next hit   {heading(best.heading_rad)} degrees at {best.speed_m_s:.1f} m/s{command}")
    return _safe([*lines, *notes])


def _safe(lines: list[str]) -> str:
    """Lines that hold no control characters, whatever names and notes do."""
    return "\n".join(printable(line) for line in lines)
