# Concealed cases, diagnosed and scored. Only the last of these rules opens the seals.


rule signatures_version:
    input:
        ancient(upstream("signatures")),
    output:
        version("signatures"),
    log:
        "logs/signatures/{id}.log",
    benchmark:
        "logs/signatures/{id}.tsv"
    threads: workflow.cores
    params:
        recipe=recipe("signatures"),
    shell:
        "python -m slapshot.diagnosis.stage_signatures --recipe {params.recipe:q} --cores {threads} --log {log}"


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
        "python -m slapshot.diagnosis.stage_verdict --recipe {params.recipe:q} --cores {threads} --log {log}"


rule proof_version:
    input:
        ancient(upstream("proof")),
    output:
        version("proof"),
    log:
        "logs/proof/{id}.log",
    benchmark:
        "logs/proof/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("proof"),
    shell:
        "python -m slapshot.proof --recipe {params.recipe:q} --cores {threads} --log {log}"


rule proof:
    """Concealed cases diagnosed and then scored, to figures/proof.csv and figures/proof.md; takes hours."""
    input:
        mark_of("proof/full"),
    log:
        "logs/proof.log",
    localrule: True
    params:
        folder=folder_of("proof/full"),
        # What is drawn anew does not replace what is published.
        name="fresh" if config["proof"] == "fresh" else config["name"],
    shell:
        "python -m slapshot.proof.publish --name {params.name:q} --log {log} {params.folder:q}"
