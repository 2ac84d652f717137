"""Blocks about adaptation: the methods, their training and their evaluation."""

import difflib
import re
from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from slapshot.config.sources import RecordedTasksSettings
from slapshot.config.values import (
    Few,
    Hits,
    LearningRate,
    Models,
    Name,
    PositiveRatio,
    Samples,
    Seed,
    SomeOf,
    Steps,
    Variance,
    Widths,
)
from slapshot.validation import LONGEST_NAME, Model, ProblemAtError, short, validated_part

Draws = Annotated[int, Field(ge=4, le=100_000)]
"""Number of samples of phi, from which a covariance is computed."""


class KalmanSettings(Model):
    """The Kalman filter in a learned space."""

    latent: Annotated[int, Field(ge=1, le=1_000)] = Field(description="dimension of phi and z")
    hidden: Widths = Field(description="widths of hidden layers, the same in both networks")
    drift: Variance = Field(
        description="epsilon of the process noise Q = epsilon I per sample; the prior's variance is 1"
    )


class LstmSettings(Model):
    """A recurrent network."""

    state: Annotated[int, Field(ge=1, le=16_384)] = Field(description="units of the cell")
    hidden: Widths = Field(description="of the prediction network")


class MamlSettings(Model):
    """Gradient steps from learned weights."""

    batch: Annotated[int, Field(ge=1, le=10_000)] = Field(description="samples per update")
    steps: Annotated[int, Field(ge=1, le=10_000)] = Field(
        description="largest number of updates in training; an evaluation makes one per complete batch"
    )
    step_size: PositiveRatio = Field(description="of the inner step, before it is learned")
    hidden: Widths = Field(description="widths of hidden layers")


MethodSettings = KalmanSettings | LstmSettings | MamlSettings
"""Settings of a method without those of its training."""


class Kalman(KalmanSettings):
    """The Kalman filter in a learned space."""

    learning_rate: LearningRate = Field(description="of Adam")

    @property
    def own(self) -> KalmanSettings:
        """Without the training's."""
        return KalmanSettings.from_parts(self)


class Lstm(LstmSettings):
    """A recurrent network."""

    learning_rate: LearningRate = Field(description="of Adam")

    @property
    def own(self) -> LstmSettings:
        """Without the training's."""
        return LstmSettings.from_parts(self)


class Maml(MamlSettings):
    """Gradient steps from learned weights."""

    learning_rate: LearningRate = Field(description="of Adam")

    @property
    def own(self) -> MamlSettings:
        """Without the training's."""
        return MamlSettings.from_parts(self)


Method = Kalman | Lstm | Maml
_MODELS: Mapping[str, type[Method]] = {"kalman": Kalman, "lstm": Lstm, "maml": Maml}
# The suffix after the first underscore distinguishes methods of the same kind.
_OF_KIND = {kind: rf"^{kind}(_[A-Za-z0-9]{{1,{LONGEST_NAME - len(kind) - 1}}})?$" for kind in _MODELS}
BELIEVING = ("kalman",)
"""Kinds of methods with a belief from which phi can be sampled."""


def kind_of(method: str) -> str:
    """Kind of the method with this name."""
    return method.partition("_")[0]


def _by_kind(methods: Any) -> Any:
    if not isinstance(methods, Mapping):
        return methods
    found = {}
    for name, settings in methods.items():
        kind = next((kind for kind, pattern in _OF_KIND.items() if re.fullmatch(pattern, name)), None)
        if kind is None:
            close = difflib.get_close_matches(name, _MODELS, n=1)
            meant = f"write {close[0]!r}" if close else "remove it"
            known = ", ".join(_MODELS)
            raise ProblemAtError(
                (name,),
                f"unknown key {short(name)}; {meant}, or use one of: {known}, each perhaps with _ and "
                "letters or digits behind it",
            )
        found[name] = validated_part(_MODELS[kind], settings, (name,))
    return found


def _patterns(schema: dict[str, Any]) -> None:
    """Let the schema select a method's settings by its kind, with which its name begins."""
    cases = schema.pop("additionalProperties")["anyOf"]
    schema["patternProperties"] = dict(zip(_OF_KIND.values(), cases, strict=True))
    schema["additionalProperties"] = False


Methods = Annotated[
    dict[str, Method],
    BeforeValidator(_by_kind),
    Field(min_length=1, max_length=100, json_schema_extra=_patterns),
]


class Training(Model):
    """Meta-training of every method."""

    models: Models = Field(description="number of models of an ensemble")
    steps: Steps = Field(description="of the optimiser")
    tasks: Annotated[int, Field(ge=1, le=100_000)] = Field(description="conditions per step")
    sequence: Annotated[int, Field(ge=1, le=10_000)] = Field(description="hits of each condition per step")
    noise_variance_max: Variance = Field(description="of the standardised outcome")


class DomainTraining(Training):
    """Meta-training of every method of a domain."""

    jobs: Annotated[int, Field(ge=1, le=100)] = Field(
        description="over which the models of an ensemble are spread; each of several draws its own hits"
    )


class EnsembleTraining(Training):
    """Meta-training of one method."""

    seed: Seed
    learning_rate: LearningRate


class TrainSettings(Model):
    """Settings of the stage `train`."""

    method: Name
    settings: MethodSettings
    training: EnsembleTraining


class Evaluation(Model):
    """Error against number of samples on simulated test conditions."""

    samples: Hits = Field(description="largest number of hits to adapt to")
    queries: Hits = Field(description="hits to predict")
    repeats: Few = Field(description="random splits of a condition's hits")
    noise_variances: SomeOf[Variance] = Field(description="of the standardised outcome")


class EvaluateSettings(Evaluation):
    """Settings of the stage `evaluate`."""

    method: Name
    seed: Seed


class EvaluateRecordingSettings(RecordedTasksSettings):
    """Settings of the stage `evaluate_recording`."""

    method: Name
    seed: Seed
    samples: Hits
    repeats: Few


class Intervals(Model):
    """Prediction intervals, their calibration and their evaluation."""

    method: Name = Field(description="one of `methods`, with a belief from which phi is sampled")
    draws: Draws = Field(description="samples of phi per interval")
    levels: SomeOf[Annotated[float, Field(gt=0, lt=1)]] = Field(description="nominal coverages")
    samples: Samples = Field(description="numbers of hits to adapt to")
    queries: Hits = Field(description="hits of a condition to predict")


class Uncertainty(Intervals):
    """Prediction intervals from sampled phi, calibrated on the validation conditions."""

    shown_noise_variance: Variance = Field(description="of the simulated hits in figures")


class NoiseLevels(Model):
    """Noise of simulated outcomes, as variances of the standardised outcome."""

    noise_variances: SomeOf[Variance] = Field(description="levels to evaluate at")
    noise_variance_max: Variance = Field(description="largest level in training")


class CalibrateSettings(Intervals, NoiseLevels):
    """Settings of the stage `calibrate`."""

    seed: Seed


class PredictionsSettings(RecordedTasksSettings):
    """Settings of the stage `predictions`."""

    method: Name
    seed: Seed
    draws: Draws
    samples: Samples
    shown_noise_variance: Variance


class HiddenStates(Model):
    """Evaluation of hidden states."""

    samples: Samples = Field(description="numbers of hits to adapt to")
    repeats: Few = Field(description="random orders of a condition's hits")


class Latents(HiddenStates):
    """Hidden states of test conditions and recordings."""

    methods: SomeOf[Name] = Field(description="methods whose hidden states are evaluated")


class BeliefsSettings(HiddenStates, NoiseLevels, RecordedTasksSettings):
    """Settings of the stage `beliefs`."""

    method: Name
    seed: Seed
