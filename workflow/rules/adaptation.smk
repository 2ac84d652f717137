rule train:
    """An ensemble of each method."""
    input:
        of_figures("train"),


rule train_version:
    input:
        ancient(upstream("train")),
    output:
        version("train"),
    log:
        "logs/train/{id}.log",
    benchmark:
        "logs/train/{id}.tsv"
    # One each: small matrices gain nothing from a second thread, a second method beside does.
    threads: 1
    params:
        recipe=recipe("train"),
    shell:
        "python -m slapshot.adaptation.train --recipe {params.recipe:q} --cores {threads} --log {log}"


rule evaluate:
    """Error against samples in simulation."""
    input:
        marks("evaluate"),


rule evaluate_version:
    input:
        ancient(upstream("evaluate")),
    output:
        version("evaluate"),
    log:
        "logs/evaluate/{id}.log",
    benchmark:
        "logs/evaluate/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("evaluate"),
    shell:
        "python -m slapshot.adaptation.evaluate --recipe {params.recipe:q} --cores {threads} --log {log}"


rule evaluate_recording:
    """Error against samples on recordings."""
    input:
        of_figures("evaluate_recording"),


rule evaluate_recording_version:
    input:
        ancient(upstream("evaluate_recording")),
    output:
        version("evaluate_recording"),
    log:
        "logs/evaluate_recording/{id}.log",
    benchmark:
        "logs/evaluate_recording/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("evaluate_recording"),
    shell:
        "python -m slapshot.adaptation.evaluate_recording --recipe {params.recipe:q} --cores {threads} --log {log}"
