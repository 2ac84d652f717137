"""Schema of verdict.json for recordings of joints and bodies."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from slapshot.errors import InputError
from slapshot.validation import Model, read_json, validated
from slapshot.whole_file import write_whole

VERDICT_FILE = "verdict.json"

Headline = Literal["nothing_found", "found", "found_not_named", "cannot_tell"]
Text = Annotated[str, Field(min_length=1)]
Share = Annotated[float, Field(ge=0, le=1)]


class Interval(Model):
    """A value with its 90 % interval."""

    value: float
    low: float
    high: float
    unit: str

    @model_validator(mode="after")
    def _in_order(self) -> "Interval":
        if not self.low <= self.value <= self.high:
            raise ValueError("a value lies outside its interval; write low <= value <= high")
        return self


class NamedParameter(Interval):
    """A parameter of an effect."""

    name: Text
    state: Literal["moved", "at a bound", "flat"] = Field(
        description="flat: the data say less about it than the prior"
    )


class NamedEffect(Model):
    """An effect that is missing in the nominal model."""

    name: Text
    part: str = Field(description="joint, body, actuator or channel; empty for the whole rig")
    variant: str
    phrase: Text
    gain_nats: float = Field(description="log evidence by which it raised the model that lacked it")
    rivals: dict[str, float] = Field(
        description="equivalent effects, and by how many nats they are worse; less "
        "than 0 for better ones of more parameters"
    )
    same_as: str = Field(default="", description="what else the law with these values is called")
    parameters: list[NamedParameter]


class Mismatch(Model):
    """Whether something is missing."""

    found: bool
    p_value: Share
    strongest: Text = Field(description="what stands out most by itself")


class Location(Model):
    """Where the mismatch is, by what describes it best by itself."""

    part: str
    follows: Text = Field(description="variable that it follows")
    size: Interval | None = Field(description="rms of the missing force or reading; null where it has none")


class Unknown(Model):
    """Whether something is missing that no name explains."""

    flagged: bool
    p_value: Share = Field(description="that nothing is missing beside what is named")
    description: str


class Errors(Model):
    """Prediction of held-out windows."""

    rms: dict[str, Interval] = Field(description="quantity of the channels -> rms error over the window")
    log_likelihood: float | None = Field(description="nats a window; null for the noise floor")


class Fits(Model):
    """Held-out predictions of four models."""

    nominal: Errors
    refitted: Errors
    augmented: Errors
    noise_floor: Errors
    window_s: float = Field(default=0.5, description="how long a window is that is predicted")
    windows: int = Field(default=0, description="that are predicted")
    windows_left_out: int = Field(default=0, description="further ones, with a push that no model here has")


class ChannelNoise(Model):
    """Noise of a channel.

    Attributes:
        white: standard deviation.
        coloured: standard deviation.
        correlation_s: of the coloured part.
        unit: of the channel.
        drift: root mean square of the slow drift over the session.
        jitter_s: standard deviation of the times at which it is really sampled.
        growth: factor by which the noise grows over the session; white and coloured are those of its middle.
    """

    white: float
    coloured: float
    correlation_s: float
    unit: str
    drift: float = 0.0
    jitter_s: float = 0.0
    growth: float = 1.0


class Limit(Model):
    """How large an effect that was not found could still be, at 95 %."""

    effect: Text
    parameter: Text
    limit: float
    unit: str


class Verdict(Model):
    """What a diagnosis says."""

    headline: Headline
    reason: Text = Field(description="of the headline, in a sentence")
    rig: Text
    stand_in: bool
    episodes: int
    seconds: float = Field(description="recorded in all")
    held_out_episodes: list[int]
    cannot_tell: str | None
    findings: list[str] = Field(description="quality warnings about recording or model")
    mismatch: Mismatch | None
    location: Location | None
    effects: list[NamedEffect]
    nominal_parameters: list[NamedEffect] = Field(description="free parameters of the nominal model")
    unknown: Unknown | None
    fit: Fits | None
    noise: dict[str, ChannelNoise]
    limits: list[Limit]
    converged: bool
    cpu_s: float
    versions: dict[str, str]

    @model_validator(mode="after")
    def _holds_together(self) -> "Verdict":
        untold = self.headline == "cannot_tell"
        if (self.cannot_tell is not None) is not untold:
            raise ValueError("headline is cannot_tell just where cannot_tell says why")
        for key in ("mismatch", "unknown", "fit"):
            if getattr(self, key) is None and not untold:
                raise ValueError(f"{key} is null only where cannot_tell says why")
        if bool(self.effects) is not (self.headline == "found"):
            raise ValueError("effects are named just where headline is found")
        missing = self.headline != "nothing_found"
        if self.mismatch is not None and not untold and self.mismatch.found is not missing:
            raise ValueError("mismatch.found is false just where headline is nothing_found")
        return self


def write_verdict(verdict: Verdict, folder: Path) -> None:
    """Write verdict.json into a folder that exists.

    Raises:
        ValueError: a number is not finite.
    """
    text = json.dumps(verdict.model_dump(mode="json"), indent=2, allow_nan=False, ensure_ascii=False)
    write_whole(folder / VERDICT_FILE, text + "\n")


def read_verdict(folder: Path) -> Verdict:
    """Read and check verdict.json.

    Raises:
        InputError: it is not there, or is none.
    """
    file = folder / VERDICT_FILE
    values = read_json(file, "diagnose the recording first")
    try:
        return validated(Verdict, values, file)
    except InputError as error:
        raise InputError(f"{error}; or diagnose the recording again") from None


def versioned(verdict: Verdict, versions: Mapping[str, str]) -> Verdict:
    """The verdict with the versions of what it came from."""
    return verdict.model_copy(update={"versions": dict(versions)})
