"""Blocks about adaptation: the methods, how they are trained, and what they are asked."""

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
"""Of phi; its covariance is taken from them."""


class KalmanSettings(Model):
    """The Kalman filter in a learned space."""

    latent: Annotated[int, Field(ge=1, le=1_000)] = Field(description="dimension of phi and z")
    hidden: Widths = Field(description="widths of hidden layers, the same in both networks")
    drift: Variance = Field(
        description="epsilon of Q = epsilon I, gained per sample; the prior's variance is 1"
    )


class LstmSettings(Model):
    """A recurrent network."""

    state: Annotated[int, Field(ge=1, le=16_384)] = Field(description="units of the cell")
    hidden: Widths = Field(description="of the prediction network")


class MamlSettings(Model):
    """Gradient steps from learned weights."""

    batch: Annotated[int, Field(ge=1, le=10_000)] = Field(description="samples an update")
    steps: Annotated[int, Field(ge=1, le=10_000)] = Field(
        description="most updates in training; an evaluation makes one for every complete batch"
    )
    step_size: PositiveRatio = Field(description="of the inner step, before it is learned")
    hidden: Widths = Field(description="widths of hidden layers")


MethodSettings = KalmanSettings | LstmSettings | MamlSettings
"""A method's own settings, without those of its training."""


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
# What follows the first underscore tells methods of one kind apart.
_OF_KIND = {kind: rf"^{kind}(_[A-Za-z0-9]{{1,{LONGEST_NAME - len(kind) - 1}}})?$" for kind in _MODELS}
BELIEVING = ("kalman",)
"""Kinds of methods with a belief that phi can be drawn from."""


def kind_of(method: str) -> str:
    """Kind of a method, of its name."""
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
    """A method's kind, which its name begins with, decides on its settings."""
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

    models: Models = Field(description="of an ensemble")
    steps: Steps = Field(description="of the optimiser")
    tasks: Annotated[int, Field(ge=1, le=100_000)] = Field(description="conditions of a step")
    sequence: Annotated[int, Field(ge=1, le=10_000)] = Field(description="hits of a condition in a step")
    noise_variance_max: Variance = Field(description="of the standardised outcome")


class EnsembleTraining(Training):
    """Meta-training of one method."""

    seed: Seed
    learning_rate: LearningRate


class TrainSettings(Model):
    """What the stage `train` is told."""

    method: Name
    settings: MethodSettings
    training: EnsembleTraining


class Evaluation(Model):
    """Error against samples on simulated test conditions."""

    samples: Hits = Field(description="hits to adapt to, at most")
    queries: Hits = Field(description="hits to predict")
    repeats: Few = Field(description="random splits of a condition's hits")
    noise_variances: SomeOf[Variance] = Field(description="of the standardised outcome")


class EvaluateSettings(Evaluation):
    """What the stage `evaluate` is told."""

    method: Name
    seed: Seed


class EvaluateRecordingSettings(RecordedTasksSettings):
    """What the stage `evaluate_recording` is told."""

    method: Name
    seed: Seed
    samples: Hits
    repeats: Few


class Intervals(Model):
    """Prediction intervals, and what they are calibrated and tried on."""

    method: Name = Field(description="one of methods, with a belief to draw phi from")
    draws: Draws = Field(description="of phi, for one interval")
    levels: SomeOf[Annotated[float, Field(gt=0, lt=1)]] = Field(description="shares to be covered")
    samples: Samples = Field(description="numbers of hits seen")
    queries: Hits = Field(description="hits of a condition to predict")


class Uncertainty(Intervals):
    """Prediction intervals from sampled phi, calibrated on the validation conditions."""

    shown_noise_variance: Variance = Field(description="of simulated hits that are shown")


class NoiseLevels(Model):
    """Noise of simulated outcomes, as variances of the standardised outcome."""

    noise_variances: SomeOf[Variance] = Field(description="levels to evaluate at")
    noise_variance_max: Variance = Field(description="largest one of training")


class CalibrateSettings(Intervals, NoiseLevels):
    """What the stage `calibrate` is told."""

    seed: Seed


class PredictionsSettings(RecordedTasksSettings):
    """What the stage `predictions` is told."""

    method: Name
    seed: Seed
    draws: Draws
    samples: Samples
    shown_noise_variance: Variance


class HiddenStates(Model):
    """How hidden states are looked at."""

    samples: Samples = Field(description="numbers of hits seen")
    repeats: Few = Field(description="random orders of a condition's hits")


class Latents(HiddenStates):
    """Hidden states of test conditions and recordings."""

    methods: SomeOf[Name] = Field(description="whose hidden states")


class BeliefsSettings(HiddenStates, NoiseLevels, RecordedTasksSettings):
    """What the stage `beliefs` is told."""

    method: Name
    seed: Seed
