"""Errors of nominal laws among the nuisance of the mismatch test."""

import numpy as np
import pytest
from slapshot.diagnosis.inference.mismatch_test import Scores, mismatch_test
from slapshot.diagnosis.pucks.launch.strikes import TIMESTEP
from slapshot.diagnosis.pucks.selection.law_error import with_law_errors
from slapshot.diagnosis.pucks.slide.slide_model import Column

HITS, PRIOR = 150, 0.03  # s, of a delay
SD = 0.1 * TIMESTEP  # s, to which all hits together tell one


def scores(delay, rng, owner):
    """Of hits that are all late by some seconds, in units of the prior."""
    information = np.full((HITS, 1, 1), PRIOR**2 / SD**2 / HITS)
    score = information[:, :, 0] * delay / PRIOR + np.sqrt(information[:, :, 0]) * rng.normal(size=(HITS, 1))
    of = Scores(score, information, np.array([PRIOR]), np.zeros(1, bool))
    return with_law_errors(of, [Column(owner, "delay", -1, 1e-3)], [], np.log(0.3))


@pytest.mark.parametrize("owner", ["command_delay", "camera_time"])
@pytest.mark.parametrize(("steps", "seen"), [(1.0, False), (10.0, True)])
def test_a_delay_of_one_time_step_is_no_mismatch_and_one_of_ten_is(owner, steps, seen):
    """Of a normal prior of one step: ten of them have a probability of 1e-23, one of a third."""
    rng = np.random.default_rng(0)
    test = mismatch_test(scores(steps * TIMESTEP, rng, owner), [np.array([0])], rng, count=199)
    assert (test.p_value < 0.01) == seen


def test_other_delays_are_not_forgiven():
    rng = np.random.default_rng(0)
    test = mismatch_test(scores(TIMESTEP, rng, "shutter"), [np.array([0])], rng, count=199)
    assert test.p_value < 0.01
