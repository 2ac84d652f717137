# What `snakemake --report report.html` shows. Copies, because a version's folder is not Snakemake's own.


report: "../report/workflow.rst"


for figure in FIGURES:

    rule:
        name:
            f"report_{figure}"
        input:
            lambda wildcards, figure=figure: ancient(
                mark_of(f"figure/{wildcards.domain}/{figure}")
            ),
        output:
            report(
                f"data/report/{{domain}}-{figure}.png",
                caption=f"../report/{figure}.rst",
                category="Figures",
                labels={"figure": figure, "of": "{domain}"},
            ),
        log:
            f"logs/report/{{domain}}-{figure}.log",
        localrule: True
        params:
            folder=lambda wildcards, figure=figure: folder_of(
                f"figure/{wildcards.domain}/{figure}"
            ),
        shell:
            # Renamed, because another run may be writing the same copy.
            "(cp {params.folder}/*.png {output}.$$ && mv -f {output}.$$ {output}) 2> {log}"


rule report_claims:
    input:
        lambda wildcards: ancient(mark_of("claims")),
    output:
        report(
            "data/report/claims.html",
            caption="../report/claims.rst",
            category="Claims",
            labels={"figure": "verdicts", "of": "all domains"},
        ),
    log:
        "logs/report/claims.log",
    localrule: True
    params:
        folder=lambda wildcards: folder_of("claims"),
    shell:
        "(cp {params.folder}/claims.html {output}.$$ && mv -f {output}.$$ {output}) 2> {log}"
