"""Makespan of dependent jobs on a number of cores, from the time of each."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Job:
    """One job of a workflow.

    Attributes:
        core_seconds: duration on one core.
        threads: largest number of cores that it uses, with linear speed-up.
        after: names of the jobs that it depends on.
    """

    core_seconds: float
    threads: int = 1
    after: tuple[str, ...] = ()

    def seconds(self, cores: int) -> float:
        """Duration on a machine with this number of cores."""
        return self.core_seconds / self.cores(cores)

    def cores(self, cores: int) -> int:
        """Number of cores that it uses of these."""
        return min(self.threads, cores)


def core_seconds(jobs: Mapping[str, Job]) -> float:
    """Total duration of all jobs on one core."""
    return sum(job.core_seconds for job in jobs.values())


def critical_path(jobs: Mapping[str, Job], cores: int) -> float:
    """Seconds of the longest chain of dependent jobs: no schedule is faster.

    Args:
        jobs: by name, in topological order.
        cores: that one job may use.
    """
    return max(_paths(jobs, cores).values(), default=0.0)


def makespan(jobs: Mapping[str, Job], cores: int) -> float:
    """Seconds from the first start to the last end under list scheduling.

    No core is idle while a job can start; among those, the one that begins the longest chain is first.

    Args:
        jobs: by name, in topological order.
        cores: of the machine.
    """
    ahead = _paths(jobs, cores)
    waiting = sorted(jobs, key=lambda name: -ahead[name])
    running: dict[str, float] = {}
    done: set[str] = set()
    now, free = 0.0, cores
    while waiting or running:
        for name in list(waiting):
            job = jobs[name]
            width = job.cores(cores)
            if width <= free and done.issuperset(job.after):
                waiting.remove(name)
                running[name] = now + job.seconds(cores)
                free -= width
        now = min(running.values())
        for name in [name for name, end in running.items() if end == now]:
            del running[name]
            done.add(name)
            free += jobs[name].cores(cores)
    return now


def _paths(jobs: Mapping[str, Job], cores: int) -> dict[str, float]:
    """Seconds of the longest chain that begins with each job."""
    after = dict.fromkeys(jobs, 0.0)  # longest chain that depends on it
    paths = {}
    for name in reversed(list(jobs)):
        paths[name] = jobs[name].seconds(cores) + after[name]
        for earlier in jobs[name].after:
            after[earlier] = max(after[earlier], paths[name])
    return paths
