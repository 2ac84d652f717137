"""The whole pipeline as recipes: which versions a configuration asks for, and what each is made from.

This package is the one place that knows how stages follow on each other. The workflow turns every recipe
into a job; adding a method, a recording or a domain to the configuration adds recipes here by itself.
"""

from collections.abc import Mapping
from typing import Any

from slapshot.plan.acting import add_acting
from slapshot.plan.adaptation import add_method, add_regression, add_uncertainty
from slapshot.plan.catalogue import CLAIMS, FIGURES, ON_DEMAND, STAGES
from slapshot.plan.diagnosis import add_diagnoses
from slapshot.plan.proof import add_proof
from slapshot.plan.recipes import Plan
from slapshot.plan.refinement import add_refinement
from slapshot.plan.results import add_claims, add_figures, add_viewer
from slapshot.plan.retraining import add_retraining
from slapshot.plan.simulation import add_labs, add_simulation

__all__ = ["CLAIMS", "FIGURES", "ON_DEMAND", "STAGES", "Plan", "make_plan"]


def make_plan(config: Mapping[str, Any]) -> Plan:
    """Work out all recipes of a checked configuration.

    Raises:
        InputError: a module or a recording that the configuration names does not exist.
    """
    plan = Plan()
    add_regression(plan, config["regression"])
    for name, domain in config["domains"].items():
        add_simulation(plan, name, domain)
        add_labs(plan, name, domain)
        for method in domain["methods"]:
            add_method(plan, name, domain, method)
        add_uncertainty(plan, name, domain)
        add_acting(plan, name, domain)
        add_refinement(plan, name, domain)
        add_viewer(plan, name, domain)
        add_diagnoses(plan, name, domain)
        add_retraining(plan, name, domain)
    add_proof(plan, config)
    add_claims(plan, config)
    add_figures(plan, config)
    return plan
