"""The pipeline's dependency graph (DAG) as recipes: the versions of a configuration, and their inputs.

Only this package defines how stages depend on each other. The workflow turns every recipe into a job; adding
a method, a recording or a domain to the configuration adds its recipes automatically.
"""

from collections.abc import Callable
from pathlib import Path

from slapshot.config.configuration import Configuration
from slapshot.config.files import read_config
from slapshot.dag.acting import add_acting
from slapshot.dag.adaptation import add_method, add_regression, add_uncertainty
from slapshot.dag.calibration import add_calibration
from slapshot.dag.diagnosis import add_diagnoses
from slapshot.dag.joint_proof import add_joint_proof
from slapshot.dag.proof import add_proof
from slapshot.dag.recipes import Plan, in_words
from slapshot.dag.refinement import add_refinement
from slapshot.dag.results import add_claims, add_figures, add_viewer
from slapshot.dag.retraining import add_retraining
from slapshot.dag.simulation import add_labs, add_simulation
from slapshot.dag.stages import CLAIMS, FIGURES, STAGES, Stage
from slapshot.errors import InputError
from slapshot.validation import ProblemAtError, key_of
from slapshot.yaml_file import Loc

__all__ = ["CLAIMS", "FIGURES", "STAGES", "Plan", "Stage", "in_words", "load_plan", "make_plan"]


def load_plan(path: Path | None = None) -> Plan:
    """Recipes of the default configuration, overridden by the values of the file `path`.

    Raises:
        InputError: the configuration is invalid, or names something that does not exist.
    """
    checked = read_config([] if path is None else [path])
    return make_plan(checked.settings, checked.layers.where)


def make_plan(config: Configuration, where: Callable[[Loc], str] | None = None) -> Plan:
    """Work out all recipes of a validated configuration.

    Args:
        config: the configuration.
        where: file and line of a value, for messages.

    Raises:
        InputError: a module, a recording, a list of cases or a figure that the configuration names does not
            exist, or cannot be made from it.
    """
    try:
        return _make_plan(config)
    except ProblemAtError as problem:
        place = f"{where(problem.loc)}: " if where is not None else ""
        raise InputError(f"{place}{key_of(problem.loc)}: {problem}") from None


def _make_plan(config: Configuration) -> Plan:
    plan = Plan()
    add_regression(plan, config.regression)
    for name, domain in config.domains.items():
        add_simulation(plan, name, domain)
        add_labs(plan, name, domain)
        for method in domain.methods:
            add_method(plan, name, domain, method)
        add_uncertainty(plan, name, domain)
        add_acting(plan, name, domain)
        add_refinement(plan, name, domain)
        add_viewer(plan, name, domain)
        add_diagnoses(plan, name, domain)
        add_retraining(plan, name, domain)
    add_proof(plan, config)
    add_joint_proof(plan, config.cases)
    add_calibration(plan, config.calibration)
    add_claims(plan, config)
    add_figures(plan, config)
    return plan
