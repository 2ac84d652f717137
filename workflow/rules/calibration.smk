# Are p-values of joints p-values, and do intervals hold what they say? Both take hours; blocks resume.


rule null_p_values:
    """P-values of null recordings."""
    input:
        marks("null_p_values"),


rule null_p_values_version:
    input:
        ancient(upstream("null_p_values")),
    output:
        version("null_p_values"),
    log:
        "logs/null_p_values/{id}.log",
    benchmark:
        "logs/null_p_values/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("null_p_values"),
    shell:
        "OPENBLAS_NUM_THREADS={threads} NUMBA_NUM_THREADS={threads} "
        "python -m slapshot.calibration.stage_null_p_values --recipe {params.recipe:q} --cores {threads} --log {log}"


rule null_table:
    """Whether they are uniform, not yet published."""
    input:
        marks("null_table"),


rule null_table_version:
    input:
        ancient(upstream("null_table")),
    output:
        version("null_table"),
    log:
        "logs/null_table/{id}.log",
    benchmark:
        "logs/null_table/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("null_table"),
    shell:
        "OPENBLAS_NUM_THREADS={threads} NUMBA_NUM_THREADS={threads} "
        "python -m slapshot.calibration.stage_null_table --recipe {params.recipe:q} --cores {threads} --log {log}"


rule nulls:
    """P-values of null recordings against uniform ones, to figures/joint_nulls.*; takes hours."""
    input:
        lambda wildcards: mark_of("null_table"),
    log:
        "logs/nulls.log",
    localrule: True
    params:
        folder=lambda wildcards: folder_of("null_table"),
        name=config["name"],
    shell:
        "python -m slapshot.publish_version --name {params.name:q} --folder nulls "
        "--beside joint_nulls.csv "
        "--beside joint_nulls.md "
        "--beside joint_nulls.png "
        "--beside joint_nulls.pdf "
        "--log {log} {params.folder:q}"


rule law_intervals:
    """Intervals of fits to recordings of every effect's own law."""
    input:
        marks("law_intervals"),


rule law_intervals_version:
    input:
        ancient(upstream("law_intervals")),
    output:
        version("law_intervals"),
    log:
        "logs/law_intervals/{id}.log",
    benchmark:
        "logs/law_intervals/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("law_intervals"),
    shell:
        "OPENBLAS_NUM_THREADS={threads} NUMBA_NUM_THREADS={threads} "
        "python -m slapshot.calibration.stage_law_intervals --recipe {params.recipe:q} --cores {threads} --log {log}"


rule coverage_table:
    """How many hold the truth, not yet published."""
    input:
        marks("coverage_table"),


rule coverage_table_version:
    input:
        ancient(upstream("coverage_table")),
    output:
        version("coverage_table"),
    log:
        "logs/coverage_table/{id}.log",
    benchmark:
        "logs/coverage_table/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("coverage_table"),
    shell:
        "OPENBLAS_NUM_THREADS={threads} NUMBA_NUM_THREADS={threads} "
        "python -m slapshot.calibration.stage_coverage_table --recipe {params.recipe:q} --cores {threads} --log {log}"


rule joint_coverage:
    """How many 90 % intervals hold the true value, to figures/coverage.csv and .md; takes hours."""
    input:
        lambda wildcards: mark_of("coverage_table"),
    log:
        "logs/joint_coverage.log",
    localrule: True
    params:
        folder=lambda wildcards: folder_of("coverage_table"),
        name=config["name"],
    shell:
        "python -m slapshot.publish_version --name {params.name:q} --folder joint-coverage "
        "--beside coverage.csv "
        "--beside coverage.md "
        "--log {log} {params.folder:q}"
