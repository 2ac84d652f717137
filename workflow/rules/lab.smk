rule lab:
    """Recordings of the stand-in rig, and the sealed truth behind them."""
    input:
        marks("lab"),


rule lab_version:
    input:
        ancient(upstream("lab")),
    output:
        version("lab"),
    log:
        "logs/lab/{id}.log",
    benchmark:
        "logs/lab/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("lab"),
    shell:
        "python -m slapshot.lab --recipe {params.recipe:q} --cores {threads} --log {log}"
