# What is published under figures/: all figures when a run fails in part, and what is made on demand.

all_versions = [f"{r.stage}/{r.id}" for r in plan.of_figures().values()]


# What could be made is published even when something could not, and nothing stale stays behind; but a
# stage that was asked for alone leaves the figures as they are.
onerror:
    if set(workflow.dag_settings.targets) <= {"figures"}:
        shell(
            "python -m slapshot.publish --available --name {config[name]:q} --log logs/publish.log {all_versions:q}"
        )


rule proof:
    """Concealed cases diagnosed and then scored, to figures/proof.csv and figures/proof.md; takes hours."""
    input:
        lambda wildcards: mark_of("score/full"),
    log:
        "logs/proof.log",
    localrule: True
    params:
        folder=lambda wildcards: folder_of("score/full"),
        # What is drawn anew does not replace what is published.
        name="fresh" if config["proof"] == "fresh" else config["name"],
        # A list that was drawn is told, and the next fresh proof draws another.
        retire=(
            f"mv {FRESH} figures/fresh/proof/drawn.csv"
            if config["proof"] == "fresh"
            else "true"
        ),
    shell:
        "python -m slapshot.publish_version --name {params.name:q} --folder proof "
        "--measures proof.csv --beside proof.md --log {log} {params.folder:q} && {params.retire}"


rule proof_joints:
    """Concealed cases of joints diagnosed and then scored, to figures/proof.csv and figures/proof_joints.md."""
    input:
        lambda wildcards: mark_of("joint_score"),
    log:
        "logs/proof_joints.log",
    localrule: True
    params:
        folder=lambda wildcards: folder_of("joint_score"),
        name=config["name"],
    shell:
        "python -m slapshot.publish_version --name {params.name:q} --folder proof-joints "
        "--measures proof.csv --beside proof_joints.md --log {log} {params.folder:q}"


rule nulls:
    """P-values of null recordings against uniform ones, to figures/joint_nulls.*; takes hours."""
    input:
        lambda wildcards: mark_of("null_table"),
    log:
        "logs/nulls.log",
    localrule: True
    params:
        folder=lambda wildcards: folder_of("null_table"),
        name=config["name"],
    shell:
        "python -m slapshot.publish_version --name {params.name:q} --folder nulls "
        "--beside joint_nulls.csv "
        "--beside joint_nulls.md "
        "--beside joint_nulls.png "
        "--beside joint_nulls.pdf "
        "--log {log} {params.folder:q}"


rule joint_coverage:
    """How many 90 % intervals hold the true value, to figures/coverage.csv and .md; takes hours."""
    input:
        lambda wildcards: mark_of("coverage_table"),
    log:
        "logs/joint_coverage.log",
    localrule: True
    params:
        folder=lambda wildcards: folder_of("coverage_table"),
        name=config["name"],
    shell:
        "python -m slapshot.publish_version --name {params.name:q} --folder joint-coverage "
        "--beside coverage.csv "
        "--beside coverage.md "
        "--log {log} {params.folder:q}"


rule hit_coverage:
    """How many 90 % intervals of effects on hits hold the true value, to figures/hit_coverage.csv and .md."""
    input:
        lambda wildcards: mark_of("hit_coverage_table"),
    log:
        "logs/hit_coverage.log",
    localrule: True
    params:
        folder=lambda wildcards: folder_of("hit_coverage_table"),
        name=config["name"],
    shell:
        "python -m slapshot.publish_version --name {params.name:q} --folder hit-coverage "
        "--beside hit_coverage.csv "
        "--beside hit_coverage.md "
        "--log {log} {params.folder:q}"


rule circle:
    """Three arms: what was found by the diagnosis of a recording, and what it is worth to adaptation."""
    input:
        marks_of(STAGES["arms"]),
    log:
        "logs/circle.log",
    localrule: True
    params:
        versions=[
            f"{name}={folder_of(f'arms/{name}')}" for name in plan.names_of("arms")
        ],
        name=config["name"],
    shell:
        "for pair in {params.versions:q}; do "
        "python -m slapshot.publish_version --name {params.name:q} --folder circle-${{pair%%=*}} "
        '--log {log} "${{pair#*=}}"; done'
