"""Columns of the errors of laws: what the data tell apart, along any trajectory."""

from dataclasses import replace

import numpy as np
from slapshot.diagnosis.fit.law_columns import law_columns
from slapshot.diagnosis.fit.noise import LARGEST_LAW_ERROR
from slapshot.diagnosis.model.hypothesis import Hypothesis
from slapshot.diagnosis.selection.problem import Problem
from slapshot.recordings.channels import Channel

from .mechanisms import control_channel, joint
from .test_linear import arm_situation

CHANNELS: dict[str, Channel] = {
    "s": joint("shoulder"), "e": joint("elbow"), "servo": control_channel("rad", actuator="servo"),
}  # fmt: skip


def problem() -> Problem:
    rig, segments, _, _ = arm_situation(120)
    return Problem.of(rig, CHANNELS, segments)


def test_they_are_the_same_wherever_they_are_asked_for():
    of = problem()
    there = of.law_columns
    assert there.W.shape[-1] > 0
    again = there.on(of.simulator, Hypothesis(of.rig), np.zeros(0), of.segments, of.trajectory)
    np.testing.assert_allclose(again, there.W, rtol=1e-6, atol=1e-9 * np.abs(there.W).max())


def test_less_noise_tells_more_shapes_apart_and_none_that_there_are_not():
    of = problem().along(problem().trajectory, fine=True)
    shapes = sum(map(len, of.laws))
    counts = []
    for white in (1e-1, 1e-3, 1e-5):
        noise = replace(of.initial_noise, white=np.full(2, white), jitter_s=0.0)
        found = law_columns(of.simulator, of.segments, of.trajectory, of.torque, of.laws, noise)
        counts.append(found.W.shape[-1])
    assert counts[0] < counts[1] < counts[2] <= shapes


def test_the_less_laws_err_the_fewer_columns_are_told():
    of = problem().along(problem().trajectory, fine=True)
    every = of.law_columns
    information = np.concatenate(every.information)
    # Information goes with the square of the errors: where that of half of them falls below a tenth.
    half = LARGEST_LAW_ERROR * np.sqrt(0.1 / np.median(information))
    few = of.with_law_error(float(half)).law_columns
    assert few.W.shape[-1] == np.sum(information > np.median(information)) < every.W.shape[-1]
    # Those that are left are the same, and can be had along another trajectory.
    again = few.on(of.simulator, Hypothesis(of.rig), np.zeros(0), of.segments, of.trajectory)
    np.testing.assert_allclose(again, few.W, rtol=1e-6, atol=1e-9 * np.abs(few.W).max())
