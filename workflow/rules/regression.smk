rule regression:
    """The linear regression walkthrough."""
    input:
        marks("regression"),


rule regression_version:
    input:
        ancient(upstream("regression")),
    output:
        version("regression"),
    log:
        "logs/regression/{id}.log",
    benchmark:
        "logs/regression/{id}.tsv"
    threads: workflow.cores
    params:
        recipe=recipe("regression"),
    shell:
        "python -m slapshot.adaptation.regression --recipe {params.recipe:q} --cores {threads} --log {log}"
