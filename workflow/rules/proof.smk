# Concealed cases, diagnosed and scored. Only the last of these rules opens the seals.


onstart:
    for target, stages in {
        "proof": ("case", "verdict"),
        "proof_joints": ("joint_case", "joint_verdict"),
    }.items():
        if target in workflow.dag_settings.targets:
            from slapshot.proof.hours import hours_left

            count, hours = hours_left(store, plan, stages, workflow.cores)
            print(
                f"{target}: {count} cases to do, about {hours:.1f} hours on {workflow.cores} cores"
            )


rule signatures:
    """How launches change with every effect, for the pool of commands of the concealed cases."""
    input:
        of_figures("signatures"),


rule signatures_version:
    input:
        ancient(upstream("signatures")),
    output:
        version("signatures"),
    log:
        "logs/signatures/{id}.log",
    benchmark:
        "logs/signatures/{id}.tsv"
    # Takes all cores: earlier than what could fill one core beside another.
    priority: 1
    threads: workflow.cores
    params:
        recipe=recipe("signatures"),
    shell:
        "python -m slapshot.diagnosis.pucks.stage_signatures --recipe {params.recipe:q} --cores {threads} --log {log}"


rule case:
    """Recordings of the small proof, and the sealed truths behind them."""
    input:
        of_figures("case"),


rule case_version:
    input:
        ancient(upstream("case")),
    output:
        version("case"),
    log:
        "logs/case/{id}.log",
    benchmark:
        "logs/case/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("case"),
    shell:
        "python -m slapshot.lab --recipe {params.recipe:q} --cores {threads} --log {log}"


rule verdict:
    """What the diagnosis says of the recordings of the small proof."""
    input:
        of_figures("verdict"),


rule verdict_version:
    input:
        ancient(upstream("verdict")),
    output:
        version("verdict"),
    log:
        "logs/verdict/{id}.log",
    benchmark:
        "logs/verdict/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("verdict"),
    shell:
        "OPENBLAS_NUM_THREADS={threads} OMP_NUM_THREADS={threads} "
        "python -m slapshot.diagnosis.pucks.stage_verdict --recipe {params.recipe:q} --cores {threads} --log {log}"


rule score:
    """The small proof."""
    input:
        of_figures("score"),


rule score_version:
    input:
        ancient(upstream("score")),
    output:
        version("score"),
    log:
        "logs/score/{id}.log",
    benchmark:
        "logs/score/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("score"),
    shell:
        "python -m slapshot.proof --recipe {params.recipe:q} --cores {threads} --log {log}"


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
