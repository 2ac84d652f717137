rule demonstrations:
    """Scripted task trajectories."""
    input:
        marks("demonstrations"),


rule demonstrations_version:
    input:
        ancient(upstream("demonstrations")),
    output:
        version("demonstrations"),
    log:
        "logs/demonstrations/{id}.log",
    benchmark:
        "logs/demonstrations/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("demonstrations"),
    shell:
        "python -m slapshot.trajectories.demonstrations --recipe {params.recipe:q} --cores {threads} --log {log}"


rule trajectory_model:
    """The trajectory VAE."""
    input:
        marks("trajectory_model"),


rule trajectory_model_version:
    input:
        ancient(upstream("trajectory_model")),
    output:
        version("trajectory_model"),
    log:
        "logs/trajectory_model/{id}.log",
    benchmark:
        "logs/trajectory_model/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("trajectory_model"),
    shell:
        "python -m slapshot.trajectories.fit --recipe {params.recipe:q} --cores {threads} --log {log}"


rule swings:
    """The pool of safe sampled latents, each executed once."""
    input:
        marks("swings"),


rule swings_version:
    input:
        ancient(upstream("swings")),
    output:
        version("swings"),
    log:
        "logs/swings/{id}.log",
    benchmark:
        "logs/swings/{id}.tsv"
    # Takes all cores: earlier than what could fill one core beside another.
    priority: 1
    threads: workflow.cores
    params:
        recipe=recipe("swings"),
    shell:
        "python -m slapshot.trajectories.pool --recipe {params.recipe:q} --cores {threads} --log {log}"
