rule diagnoses:
    """Reports on what the scene lacks, of the recordings in the configuration (of stand-ins, the first rig)."""
    input:
        marks("diagnosis"),


rule diagnosis_version:
    input:
        ancient(upstream("diagnosis")),
    output:
        version("diagnosis"),
    log:
        "logs/diagnosis/{id}.log",
    benchmark:
        "logs/diagnosis/{id}.tsv"
    threads: workflow.cores
    params:
        recipe=recipe("diagnosis"),
    shell:
        "python -m slapshot.diagnosis.pucks.stage_report --recipe {params.recipe:q} --cores {threads} --log {log}"
