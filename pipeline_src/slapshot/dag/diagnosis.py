"""Recipes of the diagnoses of the recordings in the configuration."""

from slapshot.config.cases import DiagnosisSettings, NominalSettings
from slapshot.config.domain import Domain
from slapshot.dag.recipes import Plan
from slapshot.dag.sources import Sources
from slapshot.effects import modules_of_results
from slapshot.scenes.randomisation import middle_condition

SEED = 0


def nominal_settings(domain: Domain) -> NominalSettings:
    """Nominal parameters of a diagnosis besides the scene: the friction, and no effects of the user's own."""
    condition = middle_condition(domain.randomisation)
    friction = [condition[f"friction_{axis}"] for axis in ("x", "y", "torsional")]
    return NominalSettings(friction=friction, effects=[])


def diagnosed(name: str, domain: Domain, recording: str) -> Sources:
    """The recording that a diagnosis reads; for stand-in rigs, that of the first rig."""
    return Sources.of(name, domain.recordings, [recording], rigs=1)


def add_diagnoses(plan: Plan, name: str, domain: Domain) -> None:
    """Add the diagnosis report of every recording."""
    for recording in domain.recordings:
        sources = diagnosed(name, domain, recording)
        plan.add(
            f"diagnosis/{name}/{recording}",
            "diagnosis",
            DiagnosisSettings.from_parts(nominal_settings(domain), recordings=sources.described, seed=SEED),
            {"scene": f"scene/{name}", **sources.roles},
            modules=modules_of_results(),
            files=sources.files,
        )
