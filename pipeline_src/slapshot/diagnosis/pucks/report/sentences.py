"""The verdict in sentences: verdict.md, for a roboticist who must act."""

from collections.abc import Mapping

import numpy as np

from slapshot.diagnosis.pucks.held_out import HELD_OUT, SEEN_SHARE
from slapshot.diagnosis.pucks.report import wording
from slapshot.diagnosis.pucks.report.naming import what
from slapshot.diagnosis.pucks.report.wording import table
from slapshot.diagnosis.pucks.selection.level import LEAST_EVIDENCE, LEAST_SHIFT, P_VALUE
from slapshot.diagnosis.pucks.selection.search import ADD
from slapshot.diagnosis.pucks.verdict import Errors, Interval, NamedEffect, Verdict
from slapshot.effects.catalogue import catalogue
from slapshot.plotting import STAND_IN

VERDICT_TEXT = "verdict.md"

SCENES = {
    "nominal": "nominal scene as it was believed",
    "refitted": "nominal scene, friction refitted",
    "augmented": "scene with what was found",
    "noise_floor": "noise floor: what noise alone leaves",
}
MM = 1e3


def headline(verdict: Verdict) -> str:
    """The verdict in one sentence."""
    if verdict.headline == "cannot_tell":
        return "Cannot tell"
    if verdict.headline == "nothing_found":
        return "Nothing found: the nominal scene predicts held-out hits to the noise floor"
    unknown = verdict.unknown
    flagged = unknown is not None and unknown.flagged
    if verdict.headline == "found_not_named":
        if unknown is None or not flagged:
            return "Something is missing, but no effect of the catalogue explains enough of it to be named"
        return (
            "Something is missing that the catalogue does not know: it acts "
            f"{wording.PHASES[str(unknown.phase)]} and follows {wording.VARIABLES[str(unknown.variable)]}"
        )
    further = ", and something that the catalogue does not know" if flagged else ""
    named = [_alternatives(effect) for effect in verdict.effects]
    sure = all(len(effect.members) == 1 for effect in verdict.effects)
    return f"Something is missing: {wording.listed(named) if sure else '; '.join(named)}{further}"


def _alternatives(effect: NamedEffect) -> str:
    """What is most likely, and the rivals that are left."""
    if len(effect.members) == 1:
        return wording.phrase(effect.name)
    own = effect.members[effect.name]
    rivals = {name: p for name, p in effect.members.items() if name != effect.name}
    rest = [f"{wording.title(name)} ({100 * p:.0f} %)" for name, p in rivals.items()]
    most = "most likely " if own >= max(rivals.values()) else ""
    return f"{most}{wording.phrase(effect.name)} ({100 * own:.0f} %), else {wording.listed(rest, 'or')}"


def markdown(
    verdict: Verdict, versions: Mapping[str, str] | None = None, figures: Mapping[str, str] | None = None
) -> str:
    """verdict.md.

    Args:
        verdict: to tell.
        versions: of what it came from.
        figures: name of a figure in the same folder, without suffix -> caption.
    """
    parts = [f"# {wording.escaped(headline(verdict))}", _recording(verdict)]
    if verdict.cannot_tell is not None:
        parts += ["## Why not, and what to record instead", _sentence(verdict.cannot_tell)]
        if verdict.hits_to_blame:
            parts.append(f"Hits to blame, worst first: {', '.join(map(str, verdict.hits_to_blame))}.")
    else:
        parts += ["## Is there a mismatch?", _mismatch(verdict), "## Where?", _where(verdict)]
        parts += ["## What?", *what(verdict), "## How much better?", *_better(verdict)]
        parts += ["## What to record next", _next(verdict), "## What it could still be", _still(verdict)]
    if verdict.findings:
        parts += [
            "## What a check of the recording found odd",
            "\n".join(f"- {_sentence(finding)}" for finding in verdict.findings),
        ]
    if verdict.notes:
        parts += ["## Notes", "\n".join(f"- {_sentence(note)}" for note in verdict.notes)]
    if figures:
        parts.append("## Figures")
        parts += [f"![{name}]({name}.png)\n\n*{caption}*" for name, caption in figures.items()]
    if versions:
        rows = [[wording.escaped(name), f"`{version}`"] for name, version in versions.items()]
        parts += ["## Versions", table(["of", "version"], rows)]
    return "\n\n".join(parts) + "\n"


def _recording(verdict: Verdict) -> str:
    what = f"Recording of “{wording.escaped(verdict.rig)}” ({verdict.kind})"
    if verdict.stand_in:
        what += f", a **{STAND_IN}**"
    used = f"{verdict.used} of {wording.several(verdict.hits, 'hit')} could be used"
    if verdict.cannot_tell is None:
        used += f"; {100 * HELD_OUT:.0f} % of them took no part in fitting or choosing"
    return f"{what}. {used}. Ranges in brackets are 90 % intervals, of chance alone."


def _mismatch(verdict: Verdict) -> str:
    mismatch = verdict.mismatch
    assert mismatch is not None
    facts = (
        f"p = {mismatch.p_value:.2g} (of draws without a mismatch), evidence {mismatch.log_evidence:.1f} "
        "nats for the best single hypothesis by the linear screen, which moves tracks by "
        f"{MM * mismatch.shift_m:.1f} mm (rms)"
    )
    held_out = _held_out(verdict)
    noise = _noise(verdict)
    if verdict.headline == "nothing_found":
        return (
            f"**No.** {held_out} The test of what is left after friction was refitted falls short of what "
            f"counts as missing physics ({facts}; it takes p < {P_VALUE:g} and more than "
            f"{LEAST_EVIDENCE:g} nats). {noise}"
        )
    if mismatch.decided_by == "tests":
        small = " It is real, and small." if mismatch.shift_m < LEAST_SHIFT else ""
        return f"**Yes.** After friction was refitted, something is left: {facts}.{small} {held_out} {noise}"
    return (
        f"**Yes.** {held_out} The test of single hypotheses alone would not have said so ({facts}). {noise}"
    )


def _held_out(verdict: Verdict) -> str:
    """Whether the nominal scene predicts held-out hits as well as noise lets it."""
    assert verdict.fit is not None
    chi2 = verdict.fit["refitted"].chi2_per_freedom
    told = f"{chi2.value:.2f} ({chi2.low:.2f} to {chi2.high:.2f}, 99 %)"
    how = "worse than noise alone would" if chi2.low > 1 else "to the noise floor"
    return (
        f"Held-out hits are predicted {how} by the nominal scene with friction refitted: chi-squared a "
        f"degree of freedom {told}, where 1 is noise alone."
    )


def _noise(verdict: Verdict) -> str:
    if verdict.noise_sd_m is None:
        return ""
    memory = (
        f"with a memory of {1e3 * verdict.noise_time_s:.0f} ms" if verdict.noise_time_s else "without memory"
    )
    text = (
        f"As estimated from the recording, camera noise is {MM * verdict.noise_sd_m:.1f} mm at rest, {memory}"
    )
    if verdict.noise_jitter_s:
        at_one = MM * float(np.hypot(verdict.noise_sd_m, verdict.noise_jitter_s))
        text += f" ({at_one:.1f} mm at 1 m/s, as times of frames scatter)"
    if verdict.friction_scatter is not None:
        text += f", and friction scatters by {100 * verdict.friction_scatter:.1f} % from hit to hit"
    return text + "."


def _where(verdict: Verdict) -> str:
    if verdict.headline == "nothing_found":
        return "Nowhere that these hits could show."
    return _sentence(place(verdict))


def place(verdict: Verdict) -> str:
    """Phase, variable and size."""
    location = verdict.location
    if location is None or (location.phase is None and not verdict.effects):
        return f"no phase or variable stands out{'; ' + location.size if location else ''}"
    phase = "rivals disagree in which phase" if location.phase is None else wording.PHASES[location.phase]
    variable = "it cannot be told what it follows"
    if location.variable is not None:
        variable = f"it follows {wording.VARIABLES[location.variable]}"
    return f"{phase}; {variable}; {location.size}"


def scenes(verdict: Verdict) -> list[str]:
    """Names of the scenes that differ: what acts before a slide does not change the rest of it."""
    assert verdict.fit is not None
    # Values alone: intervals are of resampled hits.
    before, after = (
        [error and error.value for error in _measured(verdict.fit[name]).values()]
        for name in ("refitted", "augmented")
    )
    return [name for name in SCENES if not (before == after and name == "augmented")]


def _better(verdict: Verdict) -> list[str]:
    if verdict.fit is None:
        return ["Not measured."]
    known = [name for name, error in _measured(verdict.fit["refitted"]).items() if error]
    rows = [[SCENES[name], *_errors(verdict.fit[name], known)] for name in scenes(verdict)]
    head = ["scene", *known, "log-likelihood a hit (nats)"]
    before, after = (mm(rest_error(verdict.fit[name])) for name in ("refitted", "augmented"))
    floor = rest_floor(verdict)
    leaves = (
        "what noise alone leaves cannot be told" if floor is None else f"noise alone leaves {mm(floor)} mm"
    )
    told = f"Rest points are predicted to {before} mm; {leaves}."
    if "augmented" in scenes(verdict):
        told = f"Rest points are predicted to {after} mm instead of {before} mm; {leaves}."
        gained = rest_error(verdict.fit["augmented"]).high < rest_error(verdict.fit["refitted"]).low
        if verdict.fit["augmented"].loglik_per_hit.low <= 0 and not gained:
            told += " **On so few held-out hits the gain cannot be told from chance.**"
    elif verdict.effects:
        told += (
            " What was found acts before the slide: it does not change what follows from its first frames."
        )
    told += _below_floor(verdict)
    if verdict.fit["refitted"].track_rmse_m is None:
        how = "On held-out hits, each predicted from its command alone. Likelihoods are over that of the "
        return [f"{told} {how}nominal scene with friction refitted.", table(head, rows)]
    how = (
        f"On held-out hits, each predicted from its first {100 * SEEN_SHARE:.0f} % of frames, and where "
        "commands are known from its command alone, which launches scatter about. Likelihoods are over "
        "that of the nominal scene with friction refitted."
    )
    return [f"{told} {how}", table(head, rows)]


def _below_floor(verdict: Verdict) -> str:
    """A sentence on errors that lie below what noise alone is said to leave; nothing if none does."""
    assert verdict.fit is not None
    best = verdict.fit["augmented" if "augmented" in scenes(verdict) else "refitted"]
    floors = _measured(verdict.fit["noise_floor"])
    low = [
        name.removesuffix(" (mm)")
        for name, error in _measured(best).items()
        if error is not None and (floor := floors[name]) is not None and error.high < floor.low
    ]
    if not low:
        return ""
    return f" The {wording.listed(low)} lies below its noise floor: there the noise is overestimated."


def _errors(errors: Errors, known: list[str]) -> list[str]:
    measured = _measured(errors)
    found = [
        f"{mm(e)} ({MM * e.low:.1f} to {MM * e.high:.1f})" if (e := measured[name]) else "cannot be told"
        for name in known
    ]
    loglik = errors.loglik_per_hit
    fixed = loglik.low == loglik.high == 0  # the scene that others are compared with
    return [*found, "0" if fixed else wording.between(loglik.value, loglik.low, loglik.high)]


def _measured(errors: Errors) -> dict[str, Interval | None]:
    return {
        "track RMSE (mm)": errors.track_rmse_m,
        "rest RMSE (mm)": errors.rest_rmse_m,
        "rest from command RMSE (mm)": errors.command_rest_rmse_m,
    }


def rest_error(errors: Errors) -> Interval:
    """Of rest points, predicted from the command where it is known."""
    found = errors.command_rest_rmse_m or errors.rest_rmse_m
    assert found is not None
    return found


def rest_floor(verdict: Verdict) -> Interval | None:
    """What noise alone leaves of the same; None where that cannot be told."""
    assert verdict.fit is not None
    floor = verdict.fit["noise_floor"]
    by_command = verdict.fit["refitted"].command_rest_rmse_m is not None
    return floor.command_rest_rmse_m if by_command else floor.rest_rmse_m


def mm(error: Interval) -> str:
    """An error in mm."""
    return f"{MM * error.value:.1f}"


def _next(verdict: Verdict) -> str:
    if not verdict.next_hits:
        classes = [e.members for e in verdict.effects if len(e.members) > 1]
        rivals = [
            wording.escaped(wording.listed([wording.title(name) for name in members])) for members in classes
        ]
        if rivals:
            return f"No hits were worked out that would part {wording.listed(rivals)}."
        if verdict.headline == "found_not_named":
            return (
                "No name is left whose rivals hits could part. Repeat some commands, and send hits where the "
                "location map shows lacking pushes, from several directions and at several speeds."
            )
        return "No rivals are left that further hits would have to part."
    hits = verdict.next_hits
    first = [wording.escaped(wording.title(name)) for name in hits[0].rivals]
    head = ["heading (degrees, anticlockwise from x)", "speed (m/s)", "evidence a hit (nats)"]
    rows = [[heading(h.heading_rad), f"{h.speed_m_s:.1f}", f"{h.nats:.1f}"] for h in hits]
    if hits[0].like_hit is not None:
        head = ["repeat the command of hit", *head]
        rows = [[str(hit.like_hit), *row] for hit, row in zip(hits, rows, strict=True)]
    told = f"Hits that part {wording.listed(first)}, best first; 3 nats are odds of 20 to 1."
    return f"{told}\n\n{table(head, rows)}"


def heading(radians: float) -> str:
    """In whole degrees, with its sign."""
    degrees = round(np.degrees(radians))
    return f"{degrees:+d}" if degrees else "0"


def _still(verdict: Verdict) -> str:
    unknown = verdict.unknown
    beyond = ""
    if verdict.effects and unknown is not None and not unknown.flagged:
        sign = "no sign" if unknown.log_evidence < ADD else "too little to speak"
        beyond = (
            "Beyond what is named, the best description without a name gains "
            f"{unknown.log_evidence:.1f} nats: {sign} of anything that the catalogue does not know. "
        )
    if verdict.headline != "nothing_found" or not verdict.limits:
        return f"{beyond}Limits on effects are given where nothing is found."
    known = catalogue()
    meanings = {(e.name, p.name): p.meaning for e in known.values() for p in e.parameters}
    rows = [
        [
            wording.escaped(wording.title(limit.effect)),
            wording.escaped(
                wording.parameter_label(
                    limit.parameter, meanings.get((limit.effect, limit.parameter), "")
                ).rstrip(": ")
            ),
            wording.escaped(wording.limit_text(limit.parameter, limit.unit, limit.at_most)),
        ]
        for limit in verdict.limits
    ]
    return "Each of these alone could be there unseen, up to this size to either side (95 %).\n\n" + table(
        ["effect", "parameter", "at most"], rows
    )


def _sentence(text: str) -> str:
    """With a capital and a full stop, as Markdown."""
    text = wording.capitalised(wording.escaped(text))
    return f"{text}{'' if text.endswith('.') else '.'}"
