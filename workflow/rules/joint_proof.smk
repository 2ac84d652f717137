# Concealed cases of joints, diagnosed and scored. Only the last of these rules opens the seals.


rule joint_case:
    """Recordings of the proof for joints, and the sealed truths behind them."""
    input:
        marks("joint_case"),


rule joint_case_version:
    input:
        ancient(upstream("joint_case")),
    output:
        version("joint_case"),
    log:
        "logs/joint_case/{id}.log",
    benchmark:
        "logs/joint_case/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("joint_case"),
    shell:
        "OPENBLAS_NUM_THREADS={threads} OMP_NUM_THREADS={threads} "
        "python -m slapshot.lab.joints.stage_case --recipe {params.recipe:q} --cores {threads} --log {log}"


rule joint_verdict:
    """What the diagnosis says of the recordings of the proof for joints."""
    input:
        marks("joint_verdict"),


rule joint_verdict_version:
    input:
        ancient(upstream("joint_verdict")),
    output:
        version("joint_verdict"),
    log:
        "logs/joint_verdict/{id}.log",
    benchmark:
        "logs/joint_verdict/{id}.tsv"
    # One core, on which a verdict says how long it took.
    threads: 1
    params:
        recipe=recipe("joint_verdict"),
    shell:
        "OPENBLAS_NUM_THREADS={threads} OMP_NUM_THREADS={threads} "
        "python -m slapshot.diagnosis.stage_verdict --recipe {params.recipe:q} --cores {threads} --log {log}"


rule joint_score:
    """The proof for joints, not published."""
    input:
        marks("joint_score"),


rule joint_score_version:
    input:
        ancient(upstream("joint_score")),
    output:
        version("joint_score"),
    log:
        "logs/joint_score/{id}.log",
    benchmark:
        "logs/joint_score/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("joint_score"),
    shell:
        "python -m slapshot.proof.joints --recipe {params.recipe:q} --cores {threads} --log {log}"


rule proof_joints:
    """Concealed cases of joints diagnosed and then scored, to figures/proof.csv and figures/proof_joints.md."""
    input:
        lambda wildcards: mark_of("joint_score"),
    log:
        "logs/proof_joints.log",
    localrule: True
    params:
        folder=lambda wildcards: folder_of("joint_score"),
        name=config["name"],
    shell:
        "python -m slapshot.publish_version --name {params.name:q} --folder proof-joints "
        "--measures proof.csv --beside proof_joints.md --log {log} {params.folder:q}"
