"""Stage `claim`: evaluate one claim."""

import logging
from importlib import import_module

import pandas as pd

from slapshot.claims.statement import ClaimModule, Statement
from slapshot.command import Run, stage_command
from slapshot.config.results import ClaimSettings
from slapshot.parquet import write_table
from slapshot.statistics import Interval

log = logging.getLogger("slapshot")

# Of a claim without statements, too: one about methods that the configuration lacks.
_COLUMNS = list(Statement("", "", Interval(0, 0, 0)).row())


def produce(run: Run) -> None:
    """Write statements.parquet: a row for each statement, with its verdict."""
    settings = run.settings(ClaimSettings)
    module: ClaimModule = import_module(settings.module)
    statements = module.evaluate(run.inputs)
    rows = [statement.row() for statement in statements]
    table = pd.DataFrame(rows, columns=_COLUMNS).assign(title=module.TITLE, domain=settings.domain)
    write_table(table, run.out / "statements.parquet")
    for statement in statements:
        log.info("%s: %s", statement.verdict, statement.text)


if __name__ == "__main__":
    stage_command("claim", produce)
