"""The times of a run whose every job is known."""

import pytest
from slapshot.benchmark.figures_run import Made, run_measures
from slapshot.benchmark.scale import cluster_hours
from slapshot.benchmark.schedule import Job
from slapshot.errors import InputError

# A scene, then rollouts on all cores, then two trainings side by side and a figure of the longer one.
RUN = {
    "scene": Made("scene", 1012.0, 12.0),
    "rollouts": Made("rollouts", 1080.0, 60.0, ("scene",)),
    "train/kalman": Made("train", 1390.0, 300.0, ("rollouts",)),
    "train/lstm": Made("train", 1210.0, 120.0, ("rollouts",)),
    "figure": Made("figure", 1402.0, 6.0, ("train/kalman",)),
}


def test_wall_time_chain_and_core_minutes_of_a_run():
    found = {row.measure: row.value for row in run_measures(RUN, 2)}
    assert found == {
        "figures_wall_minutes": pytest.approx((1402 - 1000) / 60),
        "figures_core_minutes": pytest.approx((12 + 2 * 60 + 300 + 120 + 6) / 60),
        "figures_critical_path_minutes": pytest.approx((12 + 60 + 300 + 6) / 60),
        "figures_scene_core_minutes": pytest.approx(12 / 60),
        "figures_rollouts_core_minutes": pytest.approx(2 * 60 / 60),
        "figures_train_core_minutes": pytest.approx(420 / 60),
        "figures_figure_core_minutes": pytest.approx(6 / 60),
    }


def test_a_run_that_was_interrupted_has_no_wall_time():
    later = {name: made for name, made in RUN.items() if name != "figure"}
    later["figure"] = Made("figure", 1390.0 + 7200.0, 6.0, ("train/kalman",))
    with pytest.raises(InputError, match="not made in one go: nothing was made for 120 minutes"):
        run_measures(later, 2)


def test_hours_of_all_domains_are_those_of_one_schedule():
    """Two domains, a chain of two jobs each: four hours of one core, two of enough cores."""

    def of_one(domain: str) -> dict[str, Job]:
        chains = {d: (f"rollouts/{d}", f"train/{d}") for d in ("a", "b")}
        return {
            name: Job(3600.0 if d == domain else 0.0, after=chain[:k])
            for d, chain in chains.items()
            for k, name in enumerate(chain)
        }

    found = {row.measure: row.value for row in cluster_hours("paper", [of_one("a"), of_one("b")])}
    assert found.pop("paper_core_hours") == 4
    assert set(found.values()) == {2}
    assert set(found) == {
        f"paper_{what}_{cores}_cores" for what in ("critical_path_hours", "hours") for cores in (2, 16, 200)
    }
