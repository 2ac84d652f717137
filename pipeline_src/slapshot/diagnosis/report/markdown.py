"""verdict.md: the verdict as text."""

from collections.abc import Mapping, Sequence

from slapshot.diagnosis.held_out_split import HELD_OUT
from slapshot.diagnosis.report.presentation import (
    MODELS,
    VARIABLES,
    between,
    error_unit,
    errors_text,
    escaped,
    headline,
    label,
    left_out,
    listed,
    named,
    noise_text,
    phrase_of,
    quantity,
    rivals_text,
    sentence,
    several,
    shown,
    shown_models,
)
from slapshot.diagnosis.selection.steps import LEAST_P_VALUE, P_VALUE
from slapshot.diagnosis.verdict import Errors, NamedEffect, Verdict
from slapshot.plotting import STAND_IN
from slapshot.text import markdown_table

VERDICT_TEXT = "verdict.md"
AUGMENTED = "augmented"
_ABOVE = 1.5  # noise floors


def markdown(
    verdict: Verdict,
    figures: Mapping[str, str] | None = None,
    *,
    augmented: bool = False,
    problems: Sequence[str] = (),
) -> str:
    """verdict.md.

    Args:
        verdict: the verdict.
        figures: name of a figure in the same folder, without suffix -> caption.
        augmented: whether the model with what was found stands beside it.
        problems: what could not be written beside it, a line each.
    """
    parts = [f"# {escaped(headline(verdict))}", _recording(verdict)]
    if verdict.cannot_tell is not None:
        parts += ["## Why not", sentence(verdict.cannot_tell)]
        parts.append(
            "The diagnosis is inconclusive: effects may or may not be missing. Fix the problem above, "
            "and diagnose the recording again."
        )
    else:
        parts += ["## Is something missing?", _mismatch(verdict)]
        if verdict.location is not None:
            parts += ["## Where?", _where(verdict)]
        if verdict.mismatch is not None and verdict.mismatch.found:
            parts += ["## What?", *_what(verdict, augmented), "## What is left?", _left(verdict)]
        parts += ["## How well are held-out motions predicted?", *_errors(verdict)]
        if verdict.nominal_parameters:
            parts += ["## Free parameters of the nominal model", *_free(verdict)]
        parts += ["## Noise", *_noise(verdict)]
        if verdict.limits:
            parts += ["## Upper limits of effects that were not found", *_limits(verdict)]
    if verdict.findings:
        warnings = "\n".join(f"- {sentence(finding)}" for finding in verdict.findings)
        parts += ["## Quality warnings", warnings]
    if problems:
        parts += [
            "## What could not be written",
            "\n".join(f"- {sentence(problem)}" for problem in problems),
        ]
    if figures:
        parts.append("## Figures")
        parts += [f"![{name}]({name}.png)\n\n*{caption}*" for name, caption in figures.items()]
    if verdict.versions:
        rows = [[escaped(name), f"`{version}`"] for name, version in verdict.versions.items()]
        parts += ["## Versions", markdown_table(["of", "version"], rows)]
    return "\n\n".join(parts) + "\n"


def _recording(verdict: Verdict) -> str:
    what = f"Recording of “{escaped(verdict.rig)}”"
    if verdict.stand_in:
        what += f", a **{STAND_IN}**"
    text = f"{what}: {several(verdict.episodes, 'episode')}"
    if verdict.cannot_tell is not None:
        return f"{text}."
    text += f", {verdict.seconds:.4g} s in all"
    numbers = verdict.held_out_episodes
    held = f"Episode{'s' * (len(numbers) > 1)} {listed([str(number) for number in numbers])}"
    if verdict.episodes < HELD_OUT:
        held = f"Parts of {held[0].lower()}{held[1:]}"
    return (
        f"{text}. {held} took no part in fitting: models are judged by how they predict them, which "
        "decides what is named, too. Ranges in brackets are 90 % intervals."
    )


def _mismatch(verdict: Verdict) -> str:
    mismatch = verdict.mismatch
    assert mismatch is not None
    strongest = escaped(mismatch.strongest)
    if not mismatch.found:
        return (
            "**No.** If the nominal model were complete, a mismatch at least this large would occur in a "
            "share of "
            f"p = {mismatch.p_value:.2g} of recordings like this one; p < {P_VALUE:g} is significant. "
            f"The largest single score, {strongest}, is consistent with chance."
        )
    if mismatch.p_value >= P_VALUE:
        return (
            "**Yes**, by held-out data: they are predicted worse than noise and law errors explain, or "
            "something pushes there. "
            f"No effect of the catalogue is significant (p = {mismatch.p_value:.2g}; p < {P_VALUE:g} would "
            f"be); the largest single score is that of {strongest}."
        )
    return (
        f"**Yes.** If the nominal model were complete, a mismatch this large would occur in a share of "
        f"p = {mismatch.p_value:.2g} of recordings like this one (p < {P_VALUE:g} is significant"
        f"{'; draws can give none that is smaller' if mismatch.p_value <= LEAST_P_VALUE else ''}). "
        f"The largest single score is that of {strongest}."
    )


def _where(verdict: Verdict) -> str:
    location = verdict.location
    assert location is not None
    at = f"At {escaped(location.part)}" if location.part else "In the whole rig"
    follows = escaped(VARIABLES.get(location.follows, location.follows))
    text = f"{at}. The mismatch follows {follows}"
    if location.size is not None:
        text += f"; described without a name, its rms is {between(location.size)}"
    return f"{text}."


def _what(verdict: Verdict, augmented: bool) -> list[str]:
    if not verdict.effects:
        return [f"Nothing is named: {sentence(verdict.reason)[0].lower()}{sentence(verdict.reason)[1:]}"]
    parts = []
    for effect in verdict.effects:
        text = f"**{escaped(_capital(named(effect)))}**"
        if effect.gain_nats:
            text += f" raises the log evidence by {effect.gain_nats:.1f} nats"
        parts += [f"{text}.", _parameters(effect)]
        if len(shown(effect)) < len(effect.parameters):
            parts.append(
                "A push of which the largest force is given comes and goes: `verdict.json` lists its force "
                "at evenly spaced times, between which it is linear."
            )
        parts += [_state(effect)] if _state(effect) else []
        parts += [f"This is the same as {escaped(effect.same_as)}."] if effect.same_as else []
        if effect.rivals:
            parts.append(
                f"The recording cannot distinguish it from {escaped(rivals_text(effect.rivals))}. Listed are "
                "rivals within a factor of 20 and those that explain more with more parameters; the named "
                "effect is the simplest of those with nearly the same action, not the only possible one."
            )
    if not verdict.converged:
        parts.append(
            "The fit of these values had not fully converged when it ended: intervals may be too narrow."
        )
    if augmented:
        parts.append(
            f"[{AUGMENTED}/]({AUGMENTED}) holds the model with these values (`model.xml`), and notes "
            "on what MJCF cannot represent (`NOTES.md`)."
        )
    return parts


def _parameters(effect: NamedEffect) -> str:
    rows = [[escaped(label(p)), escaped(between(p))] for p in shown(effect)]
    return markdown_table(["parameter", "value (90 % interval)"], rows)


def _state(effect: NamedEffect) -> str:
    flat = [label(p) for p in shown(effect) if p.state == "flat"]
    bound = [label(p) for p in shown(effect) if p.state == "at a bound"]
    texts = []
    if flat:
        texts.append(
            f"The data hardly narrow down {escaped(listed(flat))}: "
            f"{'the interval is' if len(flat) == 1 else 'intervals are'} nearly as wide as the prior's."
        )
    if bound:
        texts.append(f"At its physical bound: {escaped(listed(bound))}.")
    return " ".join(texts)


def _left(verdict: Verdict) -> str:
    unknown = verdict.unknown
    assert unknown is not None
    beside = "beside what is named " if verdict.effects else ""
    if not unknown.flagged:
        return f"No test says that anything is missing {beside}(p = {unknown.p_value:.2g})."
    text = f"Something is missing {beside}that no name explains"
    if unknown.p_value < P_VALUE:
        text += f" (p = {unknown.p_value:.2g})"
    return f"{text}: {escaped(unknown.description)}." if unknown.description else f"{text}."


def _errors(verdict: Verdict) -> list[str]:
    fit = verdict.fit
    assert fit is not None
    models = shown_models(verdict)
    kinds = list(fit.nominal.rms)
    rows = []
    for model in models:
        errors: Errors = getattr(fit, model)
        cells = [_cell(verdict, model, kind) for kind in kinds]
        likelihood = "" if errors.log_likelihood is None else f"{errors.log_likelihood:.1f}"
        rows.append([MODELS[model], *cells, likelihood])
    units = {kind: error_unit(verdict, kind)[0] for kind in kinds}
    heads = [escaped(kind) + (f" ({unit})" if unit else "") for kind, unit in units.items()]
    errors_by_kind = [f"{kind}: {errors_text(verdict, kind)}" for kind in kinds]
    best: Errors = getattr(fit, models[-2])
    above = any(best.rms[kind].low > _ABOVE * fit.noise_floor.rms[kind].value for kind in kinds)
    unknown = verdict.unknown
    if above and unknown is not None and not unknown.flagged:
        why = (
            "The smallest of them still lie above the noise floor, though no test is "
            "significant: tests allow for time step errors and small law errors, predictions do not."
        )
    else:
        why = ""
    worse = [
        kind
        for kind in kinds
        if "refitted" in models and fit.refitted.rms[kind].low > _ABOVE * fit.nominal.rms[kind].high
    ]
    if worse:
        why += (
            f" Refitted, the nominal model's free parameters predict {escaped(listed(worse))} worse than as "
            "they were given: they may stand in for what is missing."
        )
    return [
        f"Windows of {fit.window_s:.2g} s are predicted from the data before them and the recorded controls"
        f"{left_out(fit)}. Root mean square errors, {escaped('; '.join(errors_by_kind))}.",
        markdown_table(["model", *heads, "log-likelihood (nats a window)"], rows),
        *([why.strip()] if why else []),
    ]


def _cell(verdict: Verdict, model: str, kind: str) -> str:
    interval = getattr(verdict.fit, model).rms[kind]
    _, factor = error_unit(verdict, kind)
    value, low, high = (f"{factor * v:.3g}" for v in (interval.value, interval.low, interval.high))
    return value if interval.low == interval.high else f"{value} ({low} to {high})"


def _free(verdict: Verdict) -> list[str]:
    rows = [
        [escaped(named(effect)), escaped(label(p)), escaped(between(p))]
        for effect in verdict.nominal_parameters
        for p in effect.parameters
    ]
    states = [_state(effect) for effect in verdict.nominal_parameters]
    text = "The rig file declares these free; they were refitted with every hypothesis."
    return [
        " ".join([text, *filter(None, states)]),
        markdown_table(["of", "parameter", "change (90 % interval)"], rows),
    ]


def _noise(verdict: Verdict) -> list[str]:
    rows = [[escaped(channel), escaped(noise_text(noise))] for channel, noise in verdict.noise.items()]
    return [
        "Standard deviations under the model that explains most.",
        markdown_table(["channel", "noise"], rows),
    ]


def _limits(verdict: Verdict) -> list[str]:
    rows = [
        [
            escaped(phrase_of(limit.effect)),
            escaped(limit.parameter.replace("_", " ")),
            quantity(limit.limit, limit.unit),
        ]
        for limit in verdict.limits
    ]
    return [
        "Each effect by itself could be this large, with either sign, without being detected (95 %).",
        markdown_table(["effect", "parameter", "at most"], rows),
    ]


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
