rule figures:
    """Every figure, published to figures/ with the table behind it; checks the data it stands on."""
    default_target: True
    input:
        marks(*STAGES),
    log:
        "logs/publish.log",
    localrule: True
    params:
        name=config["name"],
        versions=[f"{r.stage}/{r.id}" for r in plan.recipes.values()],
    shell:
        "python -m slapshot.publish --name {params.name:q} --log {log} {params.versions:q}"


rule figure_version:
    input:
        ancient(upstream("figure")),
    output:
        version("figure"),
    log:
        "logs/figure/{id}.log",
    benchmark:
        "logs/figure/{id}.tsv"
    params:
        recipe=recipe("figure"),
    # Rendering finds its own GL library.
    shell:
        "env -u MUJOCO_GL python -m slapshot.figures --recipe {params.recipe:q} --log {log}"
