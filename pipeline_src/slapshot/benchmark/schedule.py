"""How long jobs that wait for one another take on some cores, from the time of each."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Job:
    """One job of a workflow.

    Attributes:
        core_seconds: that it takes on one core.
        threads: most cores that it takes; it is that much faster.
        after: names of the jobs that it waits for.
    """

    core_seconds: float
    threads: int = 1
    after: tuple[str, ...] = ()

    def seconds(self, cores: int) -> float:
        """That it takes where there are so many cores."""
        return self.core_seconds / self.cores(cores)

    def cores(self, cores: int) -> int:
        """That it takes where there are so many."""
        return min(self.threads, cores)


def core_seconds(jobs: Mapping[str, Job]) -> float:
    """What all jobs take together, counted on one core."""
    return sum(job.core_seconds for job in jobs.values())


def critical_path(jobs: Mapping[str, Job], cores: int) -> float:
    """Seconds of the longest chain of jobs that wait for one another: no schedule is faster.

    Args:
        jobs: by name, each after those that it waits for.
        cores: that one job may take.
    """
    return max(_paths(jobs, cores).values(), default=0.0)


def makespan(jobs: Mapping[str, Job], cores: int) -> float:
    """Seconds from the first start to the last end, if no core waits for a job that could start.

    Of the jobs that can start, the one with the longest chain from its start on comes first.

    Args:
        jobs: by name, each after those that it waits for.
        cores: that there are.
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
    after = dict.fromkeys(jobs, 0.0)  # the longest chain that waits for it
    paths = {}
    for name in reversed(list(jobs)):
        paths[name] = jobs[name].seconds(cores) + after[name]
        for earlier in jobs[name].after:
            after[earlier] = max(after[earlier], paths[name])
    return paths
