rule scene:
    """The MuJoCo scene of each domain."""
    input:
        marks("scene"),


rule scene_version:
    input:
        ancient(upstream("scene")),
    output:
        version("scene"),
    log:
        "logs/scene/{id}.log",
    benchmark:
        "logs/scene/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("scene"),
    shell:
        "python -m slapshot.scenes --recipe {params.recipe:q} --cores {threads} --log {log}"
