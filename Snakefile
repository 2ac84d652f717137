"""slapshot: from scene to figure. Rules are in workflow/rules, what they run in pipeline_src."""

from pathlib import Path

from snakemake.exceptions import WorkflowError
from snakemake.logging import logger
from snakemake.utils import min_version

from slapshot.config.files import read_config
from slapshot.errors import InputError
from slapshot.dag import FIGURES, STAGES, make_plan
from slapshot.dag.marks import Marks
from slapshot.dag.proof import FRESH
from slapshot.dag.time_left import TimeLeft
from slapshot.store.folder import Store

min_version("9.0")


configfile: "config/default.yaml"


# Directive that `snakemake --lint` asks for; it is used only with --software-deployment-method.
container: "docker://python:3.11-slim"


include: "workflow/rules/common.smk"
include: "workflow/rules/stages.smk"
include: "workflow/rules/publish.smk"
include: "workflow/rules/report.smk"
include: "workflow/rules/benchmark.smk"


# Here, because an included file cannot set the default target.
rule figures:
    """Every figure, published to figures/ with the table behind it; checks the data it stands on."""
    default_target: True
    input:
        of_figures(),
        reported(),
    log:
        "logs/publish.log",
    localrule: True
    params:
        name=config["name"],
        versions=all_versions,
    shell:
        "python -m slapshot.publish --name {params.name:q} --log {log} {params.versions:q}"


# The figures of one domain; what else was published stays if it is what the configuration asks for.
for domain in config["domains"]:

    rule:
        name:
            f"figures_{domain}"
        input:
            of_domain(domain),
        log:
            f"logs/publish_{domain}.log",
        localrule: True
        params:
            name=config["name"],
            versions=all_versions,
        shell:
            "python -m slapshot.publish --available --name {params.name:q} --log {log} {params.versions:q}"
