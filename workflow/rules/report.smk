# What `snakemake --report report.html` shows. Copies, because a version's folder is not Snakemake's own.


def shown(label):
    """Version of a figure or of the claims, as <stage>/<id>."""
    return f"{plan.recipes[label].stage}/{plan.recipes[label].id}"


def reported():
    """Every copy that the configuration asks for."""
    labels = [label.split("/") for label in plan.of_stage("figure")]
    copies = [f"data/report/{domain}-{figure}.png" for _, domain, figure in labels]
    return copies + (["data/report/claims.html"] if "claims" in plan.recipes else [])


report: "../report/workflow.rst"


for figure in FIGURES:

    rule:
        name:
            f"report_{figure}"
        input:
            lambda wildcards, figure=figure: ancient(
                f"data/store/{shown(f'figure/{wildcards.domain}/{figure}')}.ok"
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
            version=lambda wildcards, figure=figure: shown(
                f"figure/{wildcards.domain}/{figure}"
            ),
        shell:
            "cp data/store/{params.version}/*.png {output} 2> {log}"


rule report_claims:
    input:
        lambda wildcards: ancient(f"data/store/{shown('claims')}.ok"),
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
        version=lambda wildcards: shown("claims"),
    shell:
        "cp data/store/{params.version}/claims.html {output} 2> {log}"
