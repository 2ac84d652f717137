"""The table of stages, and the modules of figures and claims.

Recipes take a stage's module from this table, and the workflow makes its rules from it. A new stage needs its
module, a row of this table, and a call of `Plan.add` with its inputs.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Stage:
    """A stage; each of its versions is one job of the workflow.

    Attributes:
        name: of its folder in the store, of its rule, and of the target that makes all its versions.
        module: that the job runs.
        says: description of its versions, shown by `snakemake --list`.
        threads: largest number of cores that it uses. Most stages use one: small matrices gain nothing from a
            second core, a parallel job does.
        minutes: requested from a cluster: about twice the time on one core at the paper's scale, where
            figures/benchmark.csv has it. A job that runs out of time is retried with twice as many.
        memory_mb: requested from a cluster; no stage takes more with the default configuration.
        target: name of the target; empty for the stage's name, None for no target.
        on_demand: not made by `snakemake figures`, since it takes hours or its bytes are not reproducible.
        renders: renders a scene, which needs a GL library.
    """

    name: str
    module: str
    says: str
    threads: int = 1
    minutes: int = 60
    memory_mb: int = 2500
    target: str | None = ""
    on_demand: bool = False
    renders: bool = False


_MANY = 16  # threads of stages with parallel work; more gain little

_TABLE = (
    # Simulation
    Stage("scene", "slapshot.scenes.__main__", "The MuJoCo scene of each domain."),
    Stage(
        "demonstrations", "slapshot.trajectories.demonstrations", "Scripted task trajectories.", minutes=1200
    ),
    Stage("trajectory_model", "slapshot.trajectories.fit", "The trajectory VAE.", minutes=120),
    Stage(
        "swings",
        "slapshot.trajectories.pool",
        "The pool of safe sampled latents, each executed once.",
        threads=_MANY,
    ),
    Stage(
        "rollouts", "slapshot.rollouts.__main__", "Conditions x hits to Parquet.", threads=_MANY, minutes=360
    ),
    Stage(
        "lab", "slapshot.lab.__main__", "Recordings of the stand-in rig, and the sealed truth behind them."
    ),
    # Adaptation
    Stage(
        "regression", "slapshot.adaptation.regression", "The linear regression walkthrough.", threads=_MANY
    ),
    Stage(
        "train_part",
        "slapshot.adaptation.train",
        "Models of an ensemble, where a configuration spreads them over jobs.",
        minutes=1600,
    ),
    Stage("train", "slapshot.adaptation.train", "An ensemble of each method.", minutes=1600),
    Stage("evaluate", "slapshot.adaptation.evaluate", "Error against samples in simulation."),
    Stage(
        "evaluate_recording", "slapshot.adaptation.evaluate_recording", "Error against samples on recordings."
    ),
    Stage(
        "calibrate",
        "slapshot.adaptation.calibrate",
        "Prediction intervals, calibrated on validation data, and what they cover.",
    ),
    Stage(
        "predictions",
        "slapshot.adaptation.predictions",
        "What one model believed of single hits before and after adaptation.",
    ),
    Stage("beliefs", "slapshot.adaptation.beliefs", "Hidden states of test conditions and recordings."),
    # Uses of an adapted model, and the policy that the paper compares with
    Stage(
        "inverse", "slapshot.goal_reaching.train_inverse", "A network from a target and a belief to a latent."
    ),
    Stage("acting", "slapshot.goal_reaching.__main__", "Every stand-in rig hit anew."),
    Stage(
        "exploration", "slapshot.goal_reaching.exploration", "Error against samples that a belief chooses."
    ),
    Stage(
        "policy", "slapshot.policy.__main__", "Policies meta-trained on-policy in simulation.", minutes=600
    ),
    Stage(
        "policy_acting", "slapshot.policy.rigs", "A policy that adapts to every stand-in rig by its own hits."
    ),
    # Narrower randomisation from beliefs, and the evaluation of models trained on it
    Stage(
        "refinement", "slapshot.refinement.__main__", "Ranges of randomisation that hold the recorded rigs."
    ),
    Stage(
        "coverage",
        "slapshot.refinement.coverage",
        "Whether those ranges hold the truth about stand-in rigs.",
    ),
    Stage(
        "refined_rollouts",
        "slapshot.refinement.rollouts",
        "Hits under the refined ranges of a rig.",
        threads=_MANY,
        minutes=360,
    ),
    Stage(
        "refined_train_part",
        "slapshot.refinement.train",
        "The same as `train_part`.",
        minutes=1600,
    ),
    Stage("refined_train", "slapshot.refinement.train", "Models of refined ranges.", minutes=1600),
    Stage(
        "refined_errors",
        "slapshot.refinement.errors",
        "New hits of a rig, predicted by models of all ranges and of refined ones.",
    ),
    # Results for people
    Stage("claim", "slapshot.claims.__main__", "The verdict on one claim of the paper.", target=None),
    Stage("claims", "slapshot.claims.report", "The verdict on each claim of the paper."),
    Stage(
        "figure", "slapshot.figures.__main__", "A figure and the table behind it.", target=None, renders=True
    ),
    Stage(
        "viewer",
        "slapshot.viewer.__main__",
        "Rerun recordings of simulated and recorded hits; `slapshot browse` opens them.",
        target="recordings",
        on_demand=True,
    ),
    # Diagnosis of hits, and its blind validation: only the score opens the sealed truths
    Stage(
        "diagnosis",
        "slapshot.diagnosis.pucks.stage_report",
        "Reports on what the scene lacks, of the recordings in the configuration (of stand-ins, one rig).",
        threads=_MANY,
        target="diagnoses",
        on_demand=True,
    ),
    Stage(
        "signatures",
        "slapshot.diagnosis.pucks.stage_signatures",
        "How launches change with every effect, for the pool of commands of the concealed cases.",
        threads=_MANY,
    ),
    Stage(
        "case", "slapshot.lab.__main__", "Recordings of the small proof, and the sealed truths behind them."
    ),
    Stage(
        "verdict",
        "slapshot.diagnosis.pucks.stage_verdict",
        "What the diagnosis says of the recordings of the small proof.",
    ),
    Stage("score", "slapshot.blind_validation.__main__", "The small proof."),
    # The same for joints; a verdict runs on one core, for which it reports its duration
    Stage(
        "joint_case",
        "slapshot.lab.joints.stage_case",
        "Recordings of the proof for joints, and the sealed truths behind them.",
        on_demand=True,
    ),
    Stage(
        "joint_verdict",
        "slapshot.diagnosis.stage_verdict",
        "What the diagnosis says of the recordings of the proof for joints.",
        on_demand=True,
        minutes=180,
    ),
    Stage(
        "joint_score",
        "slapshot.blind_validation.joints.__main__",
        "The proof for joints, not published.",
        on_demand=True,
    ),
    # Closed loop: effects found are added to the rollouts; models trained on them adapt to the recording
    Stage(
        "findings",
        "slapshot.diagnosis.pucks.stage_findings",
        "What the diagnosis of a recording found, for the stages that build on it.",
        threads=_MANY,
        on_demand=True,
    ),
    Stage(
        "arm_rollouts",
        "slapshot.retraining.rollouts",
        "Rollouts of the arms that a diagnosis changes.",
        threads=_MANY,
        on_demand=True,
    ),
    Stage(
        "held_out",
        "slapshot.retraining.held_out",
        "Hits that took no part in the diagnosis that is built upon.",
        on_demand=True,
    ),
    Stage(
        "arms", "slapshot.retraining.__main__", "The comparison of arms, not yet published.", on_demand=True
    ),
    # Calibration of p-values and coverage of intervals; blocks resume
    Stage(
        "null_p_values",
        "slapshot.calibration.stage_null_p_values",
        "P-values of null recordings.",
        on_demand=True,
        minutes=180,
    ),
    Stage(
        "null_table",
        "slapshot.calibration.stage_null_table",
        "Whether they are uniform, not yet published.",
        on_demand=True,
    ),
    Stage(
        "law_intervals",
        "slapshot.calibration.stage_law_intervals",
        "Intervals of fits to recordings of every effect's own law.",
        on_demand=True,
        minutes=180,
    ),
    Stage(
        "coverage_table",
        "slapshot.calibration.stage_coverage_table",
        "How many hold the truth, not yet published.",
        on_demand=True,
    ),
    Stage(
        "hit_intervals",
        "slapshot.calibration.stage_hit_intervals",
        "Intervals of fits to hits on which one effect acts.",
        on_demand=True,
    ),
    Stage(
        "hit_coverage_table",
        "slapshot.calibration.stage_hit_coverage_table",
        "How many of those hold the truth, not yet published.",
        on_demand=True,
    ),
)
STAGES = {stage.name: stage for stage in _TABLE}
# Figure id -> module.
FIGURES = {
    "A1": "slapshot.figures.a1_acting",
    "A2": "slapshot.figures.a2_exploration",
    "A3": "slapshot.figures.a3_refinement",
    "A4": "slapshot.figures.a4_policy",
    "A5": "slapshot.figures.a5_refined",
    "F1": "slapshot.figures.f1_intro",
    "F2": "slapshot.figures.f2_method",
    "F3": "slapshot.figures.f3_linear_regression",
    "F4": "slapshot.figures.f4_fetchslide",
    "F5": "slapshot.figures.f5_fetchslide_latents",
    "F6": "slapshot.figures.f6_setup",
    "F7": "slapshot.figures.f7_simulated",
    "F8": "slapshot.figures.f8_recorded",
    "F9": "slapshot.figures.f9_latents",
    "M1": "slapshot.figures.m1_training",
    "T1": "slapshot.figures.randomisation_table",
    "T2": "slapshot.figures.randomisation_table",
    "U1": "slapshot.figures.u1_coverage",
    "U2": "slapshot.figures.u2_innovations",
}
# Claim id -> module.
_JUDGED = ("c1", "c2", "c3", "c4", "c5", "c6", "c7", "s11", "s12", "s13")
CLAIMS = {name.upper(): f"slapshot.claims.{name}" for name in _JUDGED}
