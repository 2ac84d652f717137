rule calibrate:
    """Prediction intervals, calibrated on validation data, and what they cover."""
    input:
        marks("calibrate"),


rule calibrate_version:
    input:
        ancient(upstream("calibrate")),
    output:
        version("calibrate"),
    log:
        "logs/calibrate/{id}.log",
    benchmark:
        "logs/calibrate/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("calibrate"),
    shell:
        "python -m slapshot.adaptation.calibrate --recipe {params.recipe:q} --cores {threads} --log {log}"


rule predictions:
    """What one model believed of single hits before and after adaptation."""
    input:
        marks("predictions"),


rule predictions_version:
    input:
        ancient(upstream("predictions")),
    output:
        version("predictions"),
    log:
        "logs/predictions/{id}.log",
    benchmark:
        "logs/predictions/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("predictions"),
    shell:
        "python -m slapshot.adaptation.predictions --recipe {params.recipe:q} --cores {threads} --log {log}"


rule beliefs:
    """Hidden states of test conditions and recordings."""
    input:
        of_figures("beliefs"),


rule beliefs_version:
    input:
        ancient(upstream("beliefs")),
    output:
        version("beliefs"),
    log:
        "logs/beliefs/{id}.log",
    benchmark:
        "logs/beliefs/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("beliefs"),
    shell:
        "python -m slapshot.adaptation.beliefs --recipe {params.recipe:q} --cores {threads} --log {log}"
