all_versions = [f"{r.stage}/{r.id}" for r in plan.of_figures().values()]


# What could be made is published even when something could not, and nothing stale stays behind; but a
# stage that was asked for alone leaves the figures as they are.
onerror:
    if set(workflow.dag_settings.targets) <= {"figures"}:
        shell(
            "python -m slapshot.publish --available --name {config[name]:q} --log logs/publish.log {all_versions:q}"
        )


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
