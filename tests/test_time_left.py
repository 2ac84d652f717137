"""What a run says of the time it still takes, from what the store and the run itself know."""

import logging

import pytest
from slapshot.dag.time_left import TimeLeft


class Made:
    """A store that holds versions of stages that took so many seconds."""

    def __init__(self, root, **seconds: list[float]) -> None:
        self._root, self._seconds = root, seconds

    def versions(self):
        for stage, took in self._seconds.items():
            for i, s in enumerate(took):
                yield self._root / stage / f"{i:012}", {"seconds": s}


def event(name: str, **of: object) -> logging.LogRecord:
    return logging.makeLogRecord({"event": name, **of})


@pytest.fixture
def clock(monkeypatch):
    now = [0.0]
    monkeypatch.setattr("slapshot.dag.time_left.time.monotonic", lambda: now[0])
    return now


def test_jobs_of_one_core_share_the_cores_and_those_of_all_do_not(tmp_path, capsys):
    left = TimeLeft(Made(tmp_path, train=[500, 700], rollouts=[300]), cores=2)
    assert left(
        event("run_info", stats={"train_version": 4, "rollouts_version": 1, "figures": 1, "total": 6})
    )
    assert left.say()
    # 4 x 600 s on two cores, and 300 s on both.
    assert capsys.readouterr().err == "0 of 6 jobs done, about 25 minutes left\n"


def test_it_takes_the_place_of_the_line_of_progress_and_learns_from_the_run(tmp_path, capsys, clock):
    left = TimeLeft(Made(tmp_path), cores=1)
    left(event("run_info", stats={"train_version": 3, "scene_version": 1, "figures": 1, "total": 5}))
    assert left.say()
    assert capsys.readouterr().err == "0 of 5 jobs done\n"
    left(event("job_info", jobid=7, rule_name="train_version"))
    clock[0] = 120.0
    assert left(event("job_finished", job_id=7))
    assert left(event("progress", done=1, total=5)) is False
    expected = "1 of 5 jobs done, more than 4 minutes left (1 job of unknown length)\n"
    assert capsys.readouterr().err == expected


def test_where_only_publishing_is_left_the_line_of_progress_stays(tmp_path, capsys):
    left = TimeLeft(Made(tmp_path), cores=1)
    left(event("run_info", stats={"figures": 1, "total": 1}))
    assert left.say() is False
    assert left(event("progress", done=1, total=1)) is True
    assert capsys.readouterr().err == ""
