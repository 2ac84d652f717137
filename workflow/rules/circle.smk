# What a diagnosis found goes back into the rollouts; a model trained on them meets the recording again.


rule findings:
    """What the diagnosis of a recording found, for the stages that build on it."""
    input:
        marks("findings"),


rule findings_version:
    input:
        ancient(upstream("findings")),
    output:
        version("findings"),
    log:
        "logs/findings/{id}.log",
    benchmark:
        "logs/findings/{id}.tsv"
    threads: workflow.cores
    params:
        recipe=recipe("findings"),
    shell:
        "python -m slapshot.diagnosis.pucks.stage_findings --recipe {params.recipe:q} --cores {threads} --log {log}"


rule arm_rollouts:
    """Rollouts of the arms that a diagnosis changes."""
    input:
        marks("arm_rollouts"),


rule arm_rollouts_version:
    input:
        ancient(upstream("arm_rollouts")),
    output:
        version("arm_rollouts"),
    log:
        "logs/arm_rollouts/{id}.log",
    benchmark:
        "logs/arm_rollouts/{id}.tsv"
    threads: workflow.cores
    params:
        recipe=recipe("arm_rollouts"),
    shell:
        "python -m slapshot.retraining.rollouts --recipe {params.recipe:q} --cores {threads} --log {log}"


rule held_out:
    """Hits that took no part in the diagnosis that is built upon."""
    input:
        marks("held_out"),


rule held_out_version:
    input:
        ancient(upstream("held_out")),
    output:
        version("held_out"),
    log:
        "logs/held_out/{id}.log",
    benchmark:
        "logs/held_out/{id}.tsv"
    params:
        recipe=recipe("held_out"),
    shell:
        "python -m slapshot.retraining.held_out --recipe {params.recipe:q} --log {log}"


rule arms:
    """The comparison of arms, not yet published."""
    input:
        marks("arms"),


rule arms_version:
    input:
        ancient(upstream("arms")),
    output:
        version("arms"),
    log:
        "logs/arms/{id}.log",
    benchmark:
        "logs/arms/{id}.tsv"
    params:
        recipe=recipe("arms"),
    shell:
        "python -m slapshot.retraining --recipe {params.recipe:q} --log {log}"


rule circle:
    """Three arms: what was found by the diagnosis of a recording, and what it is worth to adaptation."""
    input:
        marks("arms"),
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
