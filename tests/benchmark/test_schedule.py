"""Hours of jobs that wait for one another, where the answer is known by hand."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from slapshot.benchmark.scale import LEAST_CORES, long_jobs, stage_hours
from slapshot.benchmark.schedule import Job, core_seconds, critical_path, makespan
from slapshot.config.files import load_config
from slapshot.dag import STAGES, make_plan

ROOT = Path(__file__).parents[2]
HOUR = 3600.0

# a, then b on all cores, then three side by side, one of which another one waits for.
JOBS = {
    "a": Job(4),
    "b": Job(6, threads=6, after=("a",)),
    "c": Job(3, after=("b",)),
    "d": Job(3, after=("b",)),
    "e": Job(3, after=("b",)),
    "f": Job(2, after=("c",)),
}


def test_all_that_is_done_is_counted_on_one_core():
    assert core_seconds(JOBS) == 4 + 6 + 3 * 3 + 2


@pytest.mark.parametrize(
    ("cores", "path", "span"),
    [
        (1, 4 + 6 + 3 + 2, 21),
        (2, 4 + 3 + 3 + 2, 13),  # c and d, then e and f
        (3, 4 + 2 + 3 + 2, 11),
        (6, 4 + 1 + 3 + 2, 10),
    ],
)
def test_the_longest_chain_and_the_end_of_all(cores, path, span):
    assert critical_path(JOBS, cores) == path
    assert makespan(JOBS, cores) == span


def test_independent_jobs_run_side_by_side():
    """Four of 13 hours on two cores are 26: one after another they would be 52."""
    assert makespan({str(i): Job(13.0) for i in range(4)}, 2) == 26
    assert makespan({}, 2) == 0


def test_a_job_of_many_threads_waits_for_all_cores_and_others_fill_them_meanwhile():
    jobs = {"long": Job(5), "many": Job(2, threads=2), "short": Job(3)}
    # 0 to 5 long and short, 5 to 6 many.
    assert makespan(jobs, 2) == 6


def test_a_job_takes_no_more_cores_than_it_has_threads():
    jobs = {"a": Job(6, threads=2), "b": Job(3), "c": Job(3)}
    assert makespan(jobs, 4) == 3
    assert critical_path(jobs, 200) == 3


@pytest.fixture(scope="module")
def scales():
    """Name -> configuration and its plan."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        configs = {name: load_config(Path(f"config/{name}.yaml")) for name in ("default", "paper")}
        return {name: (config, make_plan(config)) for name, config in configs.items()}


@pytest.fixture(scope="module")
def paper(scales):
    return scales["paper"][1]


COSTS = {"demonstrations": 9, "trajectory_model": 1, "swings": 1, "rollouts": 2,
         "policy": 4, "train_kalman": 13, "train_lstm": 5, "train_maml_1": 6,
         "train_maml_4": 8, "train_maml_8": 10}  # fmt: skip


def test_the_hours_of_a_configuration_at_the_paper_s_scale(paper):
    """Of four models, trained one a job; four rigs are made again from Kalman's ranges."""
    jobs = long_jobs(paper, "hockey", {k: HOUR * v for k, v in COSTS.items()}, "kalman")
    found = {m.measure: m.value for m in stage_hours("x", jobs, 2)}
    assert found.pop("x_long_stages_core_hours") == 9 + 1 + 1 + 2 + 4 * 4 + 4 * 42 + 4 * (2 + 4 * 13)
    # demonstrations, model, swings, rollouts, Kalman, refined rollouts and models.
    path = 9 + 1 + 0.5 + 1 + 13 + 1 + 13
    assert found.pop("x_long_stages_critical_path_hours_on_2_cores") == pytest.approx(path)
    whole = found.pop("x_long_stages_hours_on_2_cores")
    work = 1 + 2 + 4 * 4 + 4 * 42 + 4 * (2 + 4 * 13)
    assert max(path, (9 + 1) + work / 2) <= whole < 9 + 1 + work / 2 + 14
    assert found == {
        "x_demonstrations_hours": 9,
        "x_trajectory_model_hours": 1,
        "x_swings_hours": 0.5,
        "x_rollouts_hours": 1,
        "x_policy_hours": 8,
        **{
            f"x_train_{m}_hours": 2 * COSTS[f"train_{m}"]  # two at a time
            for m in ("kalman", "lstm", "maml_1", "maml_4", "maml_8")
        },
        "x_refined_hours": 4 * 1 + 8 * 13,  # on two cores
    }


def test_hours_are_told_for_two_cores_and_for_those_that_there_are(paper):
    jobs = long_jobs(paper, "fetchslide", {"rollouts": HOUR}, None)
    names = [m.measure for m in stage_hours("x", jobs, 16)]
    assert [n for n in names if "_on_" in n] == [
        f"x_long_stages_{what}_on_{cores}_cores"
        for cores in (LEAST_CORES, 16)
        for what in ("critical_path_hours", "hours")
    ]
    assert [m.value for m in stage_hours("x", jobs, 16) if m.measure == "x_rollouts_hours"] == [1 / 16]


def test_published_hours_add_up(scales):
    """Of figures/benchmark.csv: what all stages take together follows from what each takes (to 4 digits)."""
    value = pd.read_csv(ROOT / "figures/benchmark.csv").set_index("measure")["value"]
    for name, (config, plan) in scales.items():
        for domain, settings in config.domains.items():
            prefix = f"{domain}_{name}"
            turns = np.ceil(settings.training.jobs / 2)
            costs = {
                f"train_{m}": HOUR * value[f"{prefix}_train_{m}_hours"] / turns for m in settings.methods
            }
            for part in ("demonstrations", "trajectory_model", "swings", "rollouts"):
                costs[part] = HOUR * value[f"{prefix}_{part}_hours"] * min(2, STAGES[part].threads)
            if settings.acting is not None:
                turns = settings.acting.policy.models / 2
                costs["policy"] = HOUR * value[f"{prefix}_policy_hours"] / turns
            refined = None if settings.refinement is None else settings.refinement.method
            for measure, found, _ in stage_hours(prefix, long_jobs(plan, domain, costs, refined), 2):
                assert value[measure] == pytest.approx(found, rel=1e-3), measure
