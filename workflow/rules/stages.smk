# Every stage of the table in slapshot.dag.stages: a target for all its versions, and a rule that makes one.

chains = plan.chain_lengths()

for stage in STAGES.values():

    if stage.target is not None:

        rule:
            name:
                stage.target or stage.name
            input:
                marks_of(stage),

        workflow.get_rule(stage.target or stage.name).docstring = stage.says

    rule:
        name:
            f"{stage.name}_version"
        input:
            ancient(upstream(stage.name)),
        output:
            version(stage.name),
        log:
            f"logs/{stage.name}/{{version}}.log",
        benchmark:
            f"logs/{stage.name}/{{version}}.tsv"
        # What takes many cores goes first, since it cannot fill one beside another job; then what most others
        # wait for.
        priority: 100 * (stage.threads > 1) + chains[stage.name]
        threads: stage.threads
        resources:
            mem_mb=again_with_twice(stage.memory_mb),
            runtime=again_with_twice(stage.minutes),
        params:
            recipe=recipe(stage.name),
            label=label(stage.name),
            # Rendering finds its own GL library.
            environment="env -u MUJOCO_GL " if stage.renders else "",
            module=stage.module.removesuffix(".__main__"),
        message:
            "{params.label}"
        shell:
            "NUMBA_NUM_THREADS={threads} {params.environment}python -m {params.module} --recipe {params.recipe:q} "
            "--label {params.label:q} --cores {threads} --log {log} && touch {output}"
