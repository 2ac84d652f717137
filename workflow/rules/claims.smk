rule claim_version:
    input:
        ancient(upstream("claim")),
    output:
        version("claim"),
    log:
        "logs/claim/{id}.log",
    benchmark:
        "logs/claim/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("claim"),
    shell:
        "python -m slapshot.claims --recipe {params.recipe:q} --cores {threads} --log {log}"


rule claims:
    """The verdict on each claim of the paper."""
    input:
        marks("claims"),


rule claims_version:
    input:
        ancient(upstream("claims")),
    output:
        version("claims"),
    log:
        "logs/claims/{id}.log",
    benchmark:
        "logs/claims/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("claims"),
    shell:
        "python -m slapshot.claims.report --recipe {params.recipe:q} --cores {threads} --log {log}"
