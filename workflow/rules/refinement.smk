# Range refinement: narrower randomisation from beliefs, and what models trained on it are worth.


rule refinement:
    """Ranges of randomisation that hold the recorded rigs."""
    input:
        of_figures("refinement"),


rule refinement_version:
    input:
        ancient(upstream("refinement")),
    output:
        version("refinement"),
    log:
        "logs/refinement/{id}.log",
    benchmark:
        "logs/refinement/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("refinement"),
    shell:
        "python -m slapshot.refinement --recipe {params.recipe:q} --cores {threads} --log {log}"


rule coverage:
    """Whether those ranges hold the truth about stand-in rigs."""
    input:
        of_figures("coverage"),


rule coverage_version:
    input:
        ancient(upstream("coverage")),
    output:
        version("coverage"),
    log:
        "logs/coverage/{id}.log",
    benchmark:
        "logs/coverage/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("coverage"),
    shell:
        "python -m slapshot.refinement.coverage --recipe {params.recipe:q} --cores {threads} --log {log}"


rule refined_rollouts:
    """Hits under the refined ranges of a rig."""
    input:
        of_figures("refined_rollouts"),


rule refined_rollouts_version:
    input:
        ancient(upstream("refined_rollouts")),
    output:
        version("refined_rollouts"),
    log:
        "logs/refined_rollouts/{id}.log",
    benchmark:
        "logs/refined_rollouts/{id}.tsv"
    threads: workflow.cores
    params:
        recipe=recipe("refined_rollouts"),
    shell:
        "python -m slapshot.refinement.rollouts --recipe {params.recipe:q} --cores {threads} --log {log}"


rule refined_train:
    """Models of refined ranges."""
    input:
        of_figures("refined_train"),


rule refined_train_version:
    input:
        ancient(upstream("refined_train")),
    output:
        version("refined_train"),
    log:
        "logs/refined_train/{id}.log",
    benchmark:
        "logs/refined_train/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("refined_train"),
    shell:
        "python -m slapshot.refinement.train --recipe {params.recipe:q} --cores {threads} --log {log}"


rule refined_errors:
    """New hits of a rig, predicted by models of all ranges and of refined ones."""
    input:
        of_figures("refined_errors"),


rule refined_errors_version:
    input:
        ancient(upstream("refined_errors")),
    output:
        version("refined_errors"),
    log:
        "logs/refined_errors/{id}.log",
    benchmark:
        "logs/refined_errors/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("refined_errors"),
    shell:
        "python -m slapshot.refinement.errors --recipe {params.recipe:q} --cores {threads} --log {log}"
