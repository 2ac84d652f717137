"""Estimated time left in a run, from the durations of earlier versions of its stages."""

import logging
import sys
import time
from collections import Counter
from typing import Any

import numpy as np

from slapshot.dag.stages import STAGES
from slapshot.store.folder import Store


class TimeLeft:
    """Prints how many jobs of a run are done and the estimated time left, in place of Snakemake's line.

    The duration of a stage's jobs is estimated from its versions of any configuration that were in the store
    when the run began and those made since; jobs are assumed to use all cores.

    Args:
        store: of the versions.
        cores: of the run.
    """

    def __init__(self, store: Store, cores: int) -> None:
        self._store, self._cores = store, cores
        self._left: Counter[str] = Counter()  # jobs by stage
        self._total = 0
        self._took: dict[str, list[float]] = {}  # durations in s by stage
        self._began: dict[int, tuple[str, float]] = {}  # stage and start time of running jobs, by number

    def __call__(self, record: logging.LogRecord) -> bool:
        """Filter of Snakemake's log: records its events, and drops only its progress line."""
        said: dict[str, Any] = vars(record)
        match str(said.get("event", "")):
            case "run_info":
                stats = dict(said["stats"])
                self._total = int(stats.pop("total"))
                jobs = {_stage_of(str(rule)): int(count) for rule, count in stats.items()}
                self._left = Counter({stage: n for stage, n in jobs.items() if stage in STAGES})
                self._took = self._of_store()
            case "job_info":
                self._began[said["jobid"]] = _stage_of(said["rule_name"]), time.monotonic()
            case "job_finished":
                stage, began = self._began.pop(said["job_id"], ("", 0.0))
                if stage in self._left:
                    self._left[stage] -= 1
                    self._took.setdefault(stage, []).append(time.monotonic() - began)
            case "progress":
                return not self.say(said["done"])
        return True

    def say(self, done: int = 0) -> bool:
        """Print the progress line unless no stage is left; return whether it was printed."""
        left = +self._left
        if not left:
            return False
        print(f"{done} of {self._total} jobs done{self._time(left)}", file=sys.stderr, flush=True)
        return True

    def _time(self, left: Counter[str]) -> str:
        seconds = sum(
            float(np.mean(self._took[stage])) * count * min(STAGES[stage].threads, self._cores) / self._cores
            for stage, count in left.items()
            if stage in self._took
        )
        unknown = sum(count for stage, count in left.items() if stage not in self._took)
        if unknown == sum(left.values()):
            return ""
        length = f"{seconds / 60:.0f} minutes" if seconds > 90 else "a minute"
        if not unknown:
            return f", about {length} left"
        return f", more than {length} left ({unknown} {'job' if unknown == 1 else 'jobs'} of unknown length)"

    def _of_store(self) -> dict[str, list[float]]:
        took: dict[str, list[float]] = {}
        for folder, version in self._store.versions():
            if folder.parent.name in self._left:
                took.setdefault(folder.parent.name, []).append(version["seconds"])
        return took


def _stage_of(rule: str) -> str:
    return rule.removesuffix("_version")
