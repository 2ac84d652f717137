rule benchmark:
    """Speed, memory and error of the stages, as ratios measured in one run (default configuration)."""
    input:
        of_figures("swings"),
        mark_of("viewer/hockey"),
        of_figures("verdict"),
    log:
        "logs/benchmark.log",
    # Whole cores to itself: anything beside it would be measured as well.
    threads: cores
    params:
        cores=cores,
    shell:
        "python -m slapshot.benchmark --cores {params.cores} 2>&1 | tee {log}"


rule tuning:
    """The same search of the learning rate for every method (default configuration)."""
    input:
        of_figures("rollouts"),
    log:
        "logs/tuning.log",
    threads: cores
    params:
        cores=cores,
    shell:
        "python -m slapshot.benchmark.tuning --cores {params.cores} 2>&1 | tee {log}"


rule joint_peers:
    """Masses of a stand-in arm, fitted by mujoco.sysid and by the diagnosis, to figures/joint_peers.*."""
    log:
        "logs/joint_peers.log",
    # Whole cores to itself, as above.
    threads: cores
    shell:
        "OPENBLAS_NUM_THREADS=1 python -m slapshot.benchmark.joint_peers 2>&1 | tee {log}"
