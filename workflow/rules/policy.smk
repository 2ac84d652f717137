# The method that the paper compares with: a policy, and what it does on the stand-in rigs.


rule policy:
    """Policies meta-trained on-policy in simulation."""
    input:
        of_figures("policy"),


rule policy_version:
    input:
        ancient(upstream("policy")),
    output:
        version("policy"),
    log:
        "logs/policy/{id}.log",
    benchmark:
        "logs/policy/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("policy"),
    shell:
        "python -m slapshot.policy --recipe {params.recipe:q} --cores {threads} --log {log}"


rule policy_acting:
    """A policy that adapts to every stand-in rig by its own hits."""
    input:
        of_figures("policy_acting"),


rule policy_acting_version:
    input:
        ancient(upstream("policy_acting")),
    output:
        version("policy_acting"),
    log:
        "logs/policy_acting/{id}.log",
    benchmark:
        "logs/policy_acting/{id}.tsv"
    threads: 1
    params:
        recipe=recipe("policy_acting"),
    shell:
        "python -m slapshot.policy.rigs --recipe {params.recipe:q} --cores {threads} --log {log}"
