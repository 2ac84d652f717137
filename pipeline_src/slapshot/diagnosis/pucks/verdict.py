"""What a diagnosis says of a recording, as plain dataclasses; SI units.

Annotations say what a file may hold (diagnosis.pucks.verdict_file).
"""

from dataclasses import asdict, dataclass
from typing import Annotated, Any, Literal

from pydantic import Field

from slapshot.effects.effect import Follows, Phase
from slapshot.recordings.format import Kind

Text = Annotated[str, Field(min_length=1)]
Count = Annotated[int, Field(ge=0)]
NotNegative = Annotated[float, Field(ge=0)]
Probability = Annotated[float, Field(ge=0, le=1)]
Headline = Literal["nothing_found", "found", "found_not_named", "cannot_tell"]


@dataclass(frozen=True)
class Interval:
    """A value with the bounds of its 90 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Mismatch:
    """Whether something is missing after the nuisance parameters were fitted.

    Attributes:
        found: the verdict: by the test below, or because held-out hits are predicted worse than noise alone
            would.
        decided_by: which of both it was, tests first; None where nothing is found.
        p_value: that what the hits say for any hypothesis is as large by chance, errors of the nominal laws
            included.
        log_evidence: nats of the best hypothesis over the nominal scene.
        shift_m: rms shift of tracks by it where it is largest, beyond what another friction would do.
    """

    found: bool
    decided_by: Literal["tests", "held-out hits"] | None
    p_value: Probability
    log_evidence: float
    shift_m: NotNegative


@dataclass(frozen=True)
class Location:
    """Where the mismatch is.

    Attributes:
        phase: swing, contact, slide, across hits, camera; None where nothing is found.
        variable: that it follows.
        size: in words with numbers.
    """

    phase: Phase | None
    variable: Follows | None
    size: Text


@dataclass(frozen=True)
class ParameterValue:
    """A fitted parameter with its 90 % interval."""

    name: Text
    unit: Text
    value: float
    low: float
    high: float
    meaning: Text


@dataclass(frozen=True)
class NamedEffect:
    """One piece of missing physics.

    Attributes:
        name: the most probable one.
        phase, variable: where it acts and what it follows.
        members: name -> probability of all that this recording cannot tell apart from it, itself included;
            what they lack to 1 is that of physics in no catalogue.
        log_evidence: nats that it adds to the others.
        shift_m: rms shift of tracks by it, where it is largest.
        parameters: of the most probable one.
        physics: what it is.
    """

    name: Text
    phase: Phase
    variable: Follows
    members: Annotated[dict[str, Probability], Field(min_length=1)]
    log_evidence: float
    shift_m: NotNegative
    parameters: tuple[ParameterValue, ...]
    physics: Text


@dataclass(frozen=True)
class Unknown:
    """Whether something is left that the catalogue does not explain.

    Attributes:
        flagged: the verdict.
        phase, variable: where the free form that describes it acts, and what it follows; None where held-out
            hits show that something is left and no free form says what.
        log_evidence: nats of that free form beyond the named effects.
        shift_m: rms shift of tracks by it, where it is largest.
        probability: that what is missing is in no catalogue; None where nothing is missing.
    """

    flagged: bool
    phase: Phase | None
    variable: Follows | None
    log_evidence: float
    shift_m: NotNegative
    probability: Probability | None


@dataclass(frozen=True)
class Errors:
    """On hits that took no part in fitting or choosing.

    Attributes:
        track_rmse_m: of the frames after the first ones, from which the launch was told; None without tracks.
        rest_rmse_m: of the last of them; None without tracks.
        command_rest_rmse_m: of rest points predicted from commands alone; None where they are not known, and
            of a noise floor that cannot be told.
        loglik_per_hit: nats, over that of the nominal scene with refitted nuisance.
        chi2_per_freedom: of the whitened residuals of the camera or of the encoders, whichever is more
            clearly above 1, which it is where the model holds; its interval is one of 99 %, since the
            headline rests on it.
        camera_chi2, encoder_chi2: the same of either; None where there is none.
    """

    track_rmse_m: Interval | None
    rest_rmse_m: Interval | None
    command_rest_rmse_m: Interval | None
    loglik_per_hit: Interval
    chi2_per_freedom: Interval
    camera_chi2: Interval | None
    encoder_chi2: Interval | None


@dataclass(frozen=True)
class NextHit:
    """A hit that would tell the two best rivals apart.

    Attributes:
        heading_rad, speed_m_s: of its launch.
        rivals: that it parts.
        nats: expected in favour of the true one.
        like_hit: number of a recorded hit whose command makes it; None where commands are not known.
    """

    heading_rad: float
    speed_m_s: NotNegative
    rivals: tuple[Text, Text]
    nats: float
    like_hit: int | None


@dataclass(frozen=True)
class Limit:
    """What an effect that was not found could still be, with 95 % confidence."""

    effect: Text
    parameter: Text
    unit: Text
    at_most: NotNegative


@dataclass(frozen=True)
class Verdict:
    """All of it.

    Attributes:
        headline: what all of it comes to, see `headline`.
        rig, kind, stand_in: of the recording.
        hits, used: recorded, and used.
        cannot_tell: reason and what to record instead; None where there is a verdict.
        hits_to_blame: numbers of hits because of which it cannot be told, worst first.
        findings: what a check of the recording found odd, a line each.
        mismatch, location, effects, unknown: what is missing, and where.
        limits: of what was not found.
        noise_sd_m, noise_time_s: of the camera, as estimated at rest.
        noise_jitter_s: of when frames were taken: at speed v it adds jitter times v to the noise.
        friction_scatter: sd of log friction from hit to hit.
        fit: nominal, refitted, augmented and noise_floor -> errors on held-out hits.
        next_hits: best first.
        notes: what else one should know, a line each.
    """

    headline: Headline
    rig: Text
    kind: Kind
    stand_in: bool
    hits: Count
    used: Count
    cannot_tell: Text | None
    hits_to_blame: tuple[int, ...] = ()
    findings: tuple[Text, ...] = ()
    mismatch: Mismatch | None = None
    location: Location | None = None
    effects: tuple[NamedEffect, ...] = ()
    unknown: Unknown | None = None
    limits: tuple[Limit, ...] = ()
    noise_sd_m: NotNegative | None = None
    noise_time_s: NotNegative | None = None
    noise_jitter_s: NotNegative | None = None
    friction_scatter: NotNegative | None = None
    fit: dict[str, Errors] | None = None
    next_hits: tuple[NextHit, ...] = ()
    notes: tuple[Text, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)
