"""One domain: its scene, its randomisation, and everything that is computed from them."""

from collections.abc import Iterable
from typing import Annotated

from pydantic import Field, model_validator

from slapshot.config.acting import Acting
from slapshot.config.methods import (
    BELIEVING,
    DomainTraining,
    Evaluation,
    Latents,
    Methods,
    NoiseLevels,
    Uncertainty,
    kind_of,
)
from slapshot.config.randomisation import Randomisation
from slapshot.config.recordings import Recording, StandInRecording
from slapshot.config.refinement import Refinement
from slapshot.config.results import Viewer
from slapshot.config.retraining import Retraining
from slapshot.config.rollouts import Rollouts
from slapshot.config.scene import Scene
from slapshot.config.trajectories import Demonstrations, Swings, TrajectoryModel
from slapshot.config.values import MayMiss, Name, Seed, Several
from slapshot.validation import Model, ProblemAtError
from slapshot.yaml_file import Loc


class Domain(Model):
    """A domain: scene, simulation, methods, recordings, and published results."""

    seed: Seed = Field(description="of every random draw")
    figures: Several[Name] = Field(description="ids of the figures to make")
    claims: Several[Name] = Field(description="ids of the claims to check")
    scene: Scene = Field(description="keys of every domain; a user-defined domain may have more keys")
    randomisation: Randomisation = Field(description="distributions that conditions are drawn from")
    demonstrations: Demonstrations = Field(description="scripted hits that the trajectory model learns from")
    trajectory_model: TrajectoryModel = Field(description="a variational autoencoder over motions")
    swings: Swings = Field(description="sampled latents, each executed once")
    rollouts: Rollouts = Field(description="simulated hits")
    training: DomainTraining = Field(description="meta-training of every method")
    methods: Methods = Field(
        description="method -> its own settings; a suffix after _ distinguishes variants, as in maml_8"
    )
    evaluation: Evaluation = Field(description="error against number of samples on simulated test conditions")
    uncertainty: Uncertainty = Field(description="prediction intervals from sampled phi")
    latents: Latents = Field(description="hidden states of test conditions and recordings")
    viewer: Viewer = Field(description="Rerun recordings")
    retraining: MayMiss[Retraining] = Field(
        default=None, description="retraining of a method with the findings of a diagnosis"
    )
    refinement: MayMiss[Refinement] = Field(
        default=None, description="refinement of the randomisation's ranges from beliefs about a recording"
    )
    acting: MayMiss[Acting] = Field(
        default=None,
        description="goal-reaching and exploration on the stand-in rigs of a recording",
    )
    recordings: Annotated[dict[Name, Recording], Field(max_length=100)] = Field(
        description="name -> recording of stand-in rigs or of the user's own rig"
    )

    @model_validator(mode="after")
    def _methods_are_known(self) -> "Domain":
        asked: list[tuple[Loc, str, bool]] = [
            (("uncertainty", "method"), self.uncertainty.method, True),
            *((("latents", "methods", i), m, False) for i, m in enumerate(self.latents.methods)),
        ]
        if self.acting is not None:
            asked.append((("acting", "method"), self.acting.method, True))
            asked += [(("acting", "compared", i), m, False) for i, m in enumerate(self.acting.compared)]
        for key, block in (("retraining", self.retraining), ("refinement", self.refinement)):
            if block is not None:
                asked.append(((key, "method"), block.method, False))
        for loc, method, believes in asked:
            _one_of(loc, method, self.methods, "methods")
            if believes and kind_of(method) not in BELIEVING:
                raise ProblemAtError(
                    loc, f"{method!r} has no belief to draw phi from; use {' or '.join(BELIEVING)}"
                )
        return self

    @model_validator(mode="after")
    def _recordings_are_known(self) -> "Domain":
        if not self.recordings:
            return self  # blocks that need a recording are not used
        blocks = {"retraining": self.retraining, "refinement": self.refinement, "acting": self.acting}
        for key, block in blocks.items():
            if block is not None:
                _one_of((key, "recording"), block.recording, self.recordings, "recordings")
        if self.acting is not None:
            self._hit_anew("acting", self.acting.recording)
        if self.refinement is not None and self.refinement.retrained:
            rigs = self._hit_anew("refinement", self.refinement.recording)
            for i, rig in enumerate(self.refinement.retrained):
                if rig >= rigs:
                    raise ProblemAtError(
                        ("refinement", "retrained", i),
                        f"there is no rig {rig}; recording {self.refinement.recording!r} has rigs 0 to "
                        f"{rigs - 1}",
                    )
        return self

    def _hit_anew(self, block: str, recording: str) -> int:
        """Number of stand-in rigs of a recording, on which new hits can be executed."""
        rigs = self.recordings[recording].rigs
        if rigs is None:
            stand_ins = ", ".join(self.stand_ins) or "none there is"
            raise ProblemAtError(
                (block, "recording"),
                f"{recording!r} is no recording of stand-in rigs, which alone can be hit anew; use one of: "
                f"{stand_ins}",
            )
        return rigs

    @property
    def stand_ins(self) -> dict[str, StandInRecording]:
        """Recordings that are simulated by the lab."""
        return {
            name: StandInRecording.from_parts(recording)
            for name, recording in self.recordings.items()
            if recording.lab is not None
        }

    @property
    def noise_levels(self) -> NoiseLevels:
        """Noise levels of the evaluation, and the largest one in training."""
        return NoiseLevels(
            noise_variances=self.evaluation.noise_variances,
            noise_variance_max=self.training.noise_variance_max,
        )

    @model_validator(mode="after")
    def _hits_suffice(self) -> "Domain":
        hits = self.rollouts.hits
        needed = self.evaluation.samples + self.evaluation.queries
        if needed > hits:
            raise ProblemAtError(
                ("evaluation",),
                f"samples + queries = {needed} hits of a condition, but rollouts.hits is {hits}; lower the "
                "first or raise the second",
            )
        needed = max(self.uncertainty.samples) + self.uncertainty.queries
        if needed > hits:
            raise ProblemAtError(
                ("uncertainty",),
                f"the most of samples + queries = {needed} hits of a condition, but rollouts.hits is {hits}; "
                "lower the first or raise the second",
            )
        _at_most(("training", "sequence"), self.training.sequence, hits)
        _at_most(("training", "jobs"), self.training.jobs, self.training.models, than="training.models")
        _at_most(("latents", "samples"), max(self.latents.samples), hits)
        if self.refinement is not None:
            _at_most(("refinement", "samples"), 2 * self.refinement.samples, hits, "twice the number, ")
            _at_most(
                ("refinement", "nearest"), self.refinement.nearest, self.rollouts.train, than="rollouts.train"
            )
        return self

    @model_validator(mode="after")
    def _recorded_hits_suffice(self) -> "Domain":
        asked: list[tuple[Loc, int]] = [
            (("uncertainty", "samples"), max(self.uncertainty.samples)),
            (("latents", "samples"), max(self.latents.samples)),
        ]
        for name, recording in self.stand_ins.items():
            own = list(asked)
            for key, block in (("retraining", self.retraining), ("refinement", self.refinement)):
                if block is not None and block.recording == name:
                    own.append(((key, "samples"), block.samples))
            if self.acting is not None and self.acting.recording == name:
                own.append((("acting", "exploration", "candidates"), self.acting.exploration.candidates))
            for loc, number in own:
                _at_most(
                    loc,
                    number + 1,
                    recording.lab.hits,
                    "with one hit to predict, ",
                    f"recordings.{name}.lab.hits",
                )
        return self

    @model_validator(mode="after")
    def _joints_fit(self) -> "Domain":
        for name, recording in self.stand_ins.items():
            joints, given = self.scene.joints, len(recording.lab.scatter.joint_offset_sd_rad)
            if joints is not None and given != joints:
                raise ProblemAtError(
                    ("recordings", name, "lab", "scatter", "joint_offset_sd_rad"),
                    f"{given} values for {joints} joints; give one for each joint",
                )
        return self

    @model_validator(mode="after")
    def _shows_something(self) -> "Domain":
        shown = self.viewer.simulated + (self.viewer.recorded if self.recordings else 0)
        if shown == 0:
            raise ProblemAtError(("viewer",), "no hit to show; let `simulated` and `recorded` not both be 0")
        return self


def _one_of(loc: Loc, name: str, known: Iterable[str], key: str) -> None:
    if name not in known:
        raise ProblemAtError(loc, f"{name!r} is not among the domain's {key}; use one of: {', '.join(known)}")


def _at_most(loc: Loc, number: int, limit: int, how: str = "", than: str = "rollouts.hits") -> None:
    if number > limit:
        raise ProblemAtError(
            loc, f"{how}{number} is more than {than} = {limit}; lower the first or raise the second"
        )
