# What the paper proposes to do with an adapted model: act on it, explore by it.


rule inverse:
    """A network from a target and a belief to a latent."""
    input:
        of_figures("inverse"),


rule inverse_version:
    input:
        ancient(upstream("inverse")),
    output:
        version("inverse"),
    log:
        "logs/inverse/{id}.log",
    benchmark:
        "logs/inverse/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("inverse"),
    shell:
        "python -m slapshot.acting.train_inverse --recipe {params.recipe:q} --cores {threads} --log {log}"


rule exploration:
    """Error against samples that a belief chooses."""
    input:
        of_figures("exploration"),


rule exploration_version:
    input:
        ancient(upstream("exploration")),
    output:
        version("exploration"),
    log:
        "logs/exploration/{id}.log",
    benchmark:
        "logs/exploration/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("exploration"),
    shell:
        "python -m slapshot.acting.exploration --recipe {params.recipe:q} --cores {threads} --log {log}"


rule acting:
    """Every stand-in rig hit anew."""
    input:
        of_figures("acting"),


rule acting_version:
    input:
        ancient(upstream("acting")),
    output:
        version("acting"),
    log:
        "logs/acting/{id}.log",
    benchmark:
        "logs/acting/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("acting"),
    shell:
        "python -m slapshot.acting --recipe {params.recipe:q} --cores {threads} --log {log}"
