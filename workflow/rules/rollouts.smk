rule rollouts:
    """Conditions x hits to Parquet."""
    input:
        marks("rollouts"),


rule rollouts_version:
    input:
        ancient(upstream("rollouts")),
    output:
        version("rollouts"),
    log:
        "logs/rollouts/{id}.log",
    benchmark:
        "logs/rollouts/{id}.tsv"
    # Takes all cores: earlier than what could fill one core beside another.
    priority: 1
    threads: workflow.cores
    params:
        recipe=recipe("rollouts"),
    shell:
        "python -m slapshot.rollouts --recipe {params.recipe:q} --cores {threads} --log {log}"
