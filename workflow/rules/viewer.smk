rule recordings:
    """Rerun recordings of simulated and recorded hits; `slapshot browse` opens them."""
    input:
        marks("viewer"),


rule viewer_version:
    input:
        ancient(upstream("viewer")),
    output:
        version("viewer"),
    log:
        "logs/viewer/{id}.log",
    benchmark:
        "logs/viewer/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("viewer"),
    shell:
        "python -m slapshot.viewer --recipe {params.recipe:q} --cores {threads} --log {log}"
