"""Stage `claim`: judge one claim."""

import logging
from importlib import import_module

import pandas as pd

from slapshot.claims.statement import ClaimModule
from slapshot.command import Run, stage_command

log = logging.getLogger("slapshot")


def produce(run: Run) -> None:
    """Write statements.parquet: a row for each statement, with its verdict."""
    module: ClaimModule = import_module(run.config["module"])
    statements = module.judge(run.inputs)
    rows = [statement.row() for statement in statements]
    table = pd.DataFrame(rows).assign(title=module.TITLE, domain=run.config["domain"])
    table.to_parquet(run.out / "statements.parquet", index=False)
    for statement in statements:
        log.info("%s: %s", statement.verdict, statement.text)


if __name__ == "__main__":
    stage_command("claim", produce)
