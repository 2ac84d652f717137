"""Scores, elimination and the test of a mismatch, against least squares, known laws and planted effects."""

from typing import NamedTuple

import numpy as np
import pytest
from scipy import stats
from slapshot.diagnosis.fit.filter import Covariances, Linear, innovations
from slapshot.diagnosis.inference.mismatch_test import (
    Draws,
    Eliminated,
    Elimination,
    Scores,
    group_statistics,
    mismatch_test,
    overdispersion,
    scores,
)

GROUPS = (np.array([0]), np.array([1, 2]), np.array([3, 4, 5]))
CANDIDATES, NUISANCE = 6, 4
IS_NUISANCE = np.arange(CANDIDATES + NUISANCE) >= CANDIDATES


class Columns(NamedTuple):
    """Whitened columns of S segments, (S, n, p), in units of the priors."""

    z: np.ndarray

    @property
    def whole(self) -> np.ndarray:
        return self.z.reshape(-1, self.z.shape[-1])

    def scores(self, e: np.ndarray) -> Scores:
        b, H = np.einsum("snp,sn->sp", self.z, e), np.einsum("snp,snq->spq", self.z, self.z)
        return Scores(b, H, np.ones(self.z.shape[-1]), IS_NUISANCE)


def columns(
    seed: int, *, segments: int = 12, size: int = 20, nuisance: float = 1.0, alike: float = 0.4
) -> Columns:
    """Columns that are alike, as those of damping and friction are, segments of unlike strength."""
    rng = np.random.default_rng(seed)
    p = CANDIDATES + NUISANCE
    mix = np.eye(p) + alike * rng.normal(size=(p, p))
    z = rng.normal(size=(segments, size, p)) @ mix
    z *= rng.uniform(0.5, 1.5, (segments, 1, 1)) * np.where(IS_NUISANCE, nuisance, 1.0)
    return Columns(z)


def null_data(of: Columns, rng: np.random.Generator, scale: float = 1.0) -> np.ndarray:
    """(S, n) noise and nuisance, one value of each nuisance for the whole recording."""
    values = np.where(IS_NUISANCE, rng.standard_normal(of.z.shape[-1]), 0.0)
    return scale * (rng.standard_normal(of.z.shape[:2]) + of.z @ values)


def test_scores_of_innovations():
    """One state that stays where it is, seen once: everything in closed form."""
    rng = np.random.default_rng(1)
    S, L, p = 3, 5, 2
    r, psi = rng.normal(size=(S, L, 1)), rng.normal(size=(S, L, 1, p))
    r[1, 2] = np.nan
    zero = np.zeros((S, L, 1, 1))
    system = Linear(zero, zero, zero[..., 0], zero, r, np.zeros((S, L, 1, p)), psi)
    noise = Covariances(np.ones(1), np.zeros(1), np.full((S, L, 1), 0.25), np.zeros(1), np.ones(1))
    sd, nuisance = np.array([3.0, 0.1]), np.array([False, True])
    found = scores(innovations(system, noise), sd, nuisance)
    z = np.where(np.isnan(r), 0, psi[:, :, 0]) * sd / 0.5
    e = np.nan_to_num(r[..., 0]) / 0.5
    np.testing.assert_allclose(found.b, np.einsum("slp,sl->sp", z, e), atol=1e-12)
    np.testing.assert_allclose(found.H, np.einsum("slp,slq->spq", z, z), atol=1e-12)
    assert found.nuisance is nuisance


@pytest.mark.parametrize("nuisance", [0.01, 0.3, 30.0])
def test_elimination_is_generalised_least_squares(nuisance):
    """Nuisance of variance 1 is noise with covariance Z Zᵀ; whether the data know it well or not at all."""
    of = columns(2, nuisance=nuisance)
    e = null_data(of, np.random.default_rng(3))
    found = Elimination(of.scores(e))(of.scores(e).b)
    candidates, others = of.whole[:, :CANDIDATES], of.whole[:, CANDIDATES:]
    weight = np.linalg.inv(np.eye(len(others)) + others @ others.T)
    np.testing.assert_allclose(found.segment.sum(0), candidates.T @ weight @ e.ravel(), atol=1e-8)
    np.testing.assert_allclose(found.information, candidates.T @ weight @ candidates, atol=1e-8)


def test_without_nuisance_nothing_is_eliminated():
    of = columns(4)
    e = np.random.default_rng(5).standard_normal(of.z.shape[:2])
    part = of.scores(e)
    kept = Scores(part.b, part.H, part.prior_sd, np.zeros(len(IS_NUISANCE), bool))
    found = Elimination(kept)(kept.b)
    np.testing.assert_array_equal(found.segment, part.b)
    np.testing.assert_array_equal(found.information, part.H.sum(0))


def test_draws_have_the_moments_of_the_null():
    of = columns(6, segments=2, nuisance=0.3)
    given = of.scores(np.zeros(of.z.shape[:2]))
    draw = Draws(given, np.random.default_rng(7))
    many = np.concatenate([draw(10_000), draw(30_000)]).reshape(40_000, -1)
    # All segments share one value of each nuisance.
    stacked = np.concatenate(list(given.H))
    others = stacked[:, IS_NUISANCE]
    covariance = others @ others.T
    p = len(IS_NUISANCE)
    for s in range(2):
        covariance[s * p : (s + 1) * p, s * p : (s + 1) * p] += given.H[s]
    spread = np.sqrt(np.diag(covariance))
    assert np.all(np.abs(many.mean(0)) < 5 * spread / np.sqrt(40_000))
    # A correlation of 40,000 draws has a standard deviation of at most 1/200.
    found = np.cov(many.T) / np.outer(spread, spread)
    np.testing.assert_allclose(found, covariance / np.outer(spread, spread), atol=5 / 200 * np.sqrt(2))


def test_the_statistic_of_one_column_is_students_t_test():
    rng = np.random.default_rng(8)
    for segments in (2, 5, 40):
        each = rng.normal(0.2, 1.3, size=(segments, 1))
        found = group_statistics(Eliminated(each, np.array([[7.0]])), [np.array([0])])
        expected = -np.log(stats.ttest_1samp(each[:, 0], 0.0).pvalue)
        np.testing.assert_allclose(found, [expected], rtol=1e-9)


@pytest.mark.parametrize("segments", [2, 4, 30])
def test_statistics_of_several_columns_follow_the_f_distribution(segments):
    """Under the null e to the minus statistic is uniform, whatever the units and the size of the noise."""
    rng, k = np.random.default_rng(9), 3
    root = rng.normal(size=(k, k))
    each = 17.0 * rng.standard_normal((4000, segments, k)) @ root.T
    found = group_statistics(Eliminated(each, root @ root.T), [np.arange(k)])
    assert stats.kstest(np.exp(-found[:, 0]), "uniform").pvalue > 1e-3


@pytest.mark.parametrize("louder", [0.5, 1.0, 3.0])
def test_what_the_nuisance_has_of_a_sum_is_not_judged_by_the_spread_of_segments(louder):
    """All segments share it, so that it is in no spread; before, a third of such nulls had p below 0.05."""
    rng, segments, draws = np.random.default_rng(12), 40, 4000
    nuisance = np.diag([0.95, 0.3])
    noise = louder * rng.standard_normal((draws, segments, 2)) * np.sqrt((1 - np.diag(nuisance)) / segments)
    each = noise + rng.standard_normal((draws, 1, 2)) * np.sqrt(np.diag(nuisance)) / segments
    found = group_statistics(Eliminated(each, np.eye(2), None, nuisance), [np.arange(2)])[:, 0]
    # The standard error of the share is 0.0034.
    assert 0.035 < np.mean(np.exp(-found) < 0.05) < 0.065
    unshared = group_statistics(Eliminated(each, np.eye(2)), [np.arange(2)])[:, 0]
    assert louder > 1 or np.mean(np.exp(-unshared) < 0.05) > 0.15


def test_one_outlying_segment_makes_no_case():
    rng = np.random.default_rng(10)
    each = rng.standard_normal((20, 1))
    each[3] = 1000.0
    found = group_statistics(Eliminated(each, np.array([[20.0]])), [np.array([0])])
    # The mean of 20 numbers of which one is 1000 is one standard error from 0.
    assert found[0] == pytest.approx(-stats.f.logsf(1, 1, 19), rel=0.05)


def test_segments_that_agree_on_a_value_make_a_case_though_they_tell_unequally_much():
    of = columns(21, segments=6, alike=0.1)
    of.z[...] *= np.array([1.0, 3.0, 0.3, 2.0, 0.1, 1.5])[:, None, None]
    e = null_data(of, np.random.default_rng(22)) + 500 * of.z[..., 0]
    found = Elimination(of.scores(e))(of.scores(e).b)
    assert group_statistics(found, GROUPS)[0] > 10
    # Each segment's information sums to that of all.
    for group in GROUPS:
        whole = found.information[np.ix_(group, group)]
        np.testing.assert_allclose(found.by_segment(group).sum(0), whole, rtol=1e-9, atol=1e-9)


def test_a_single_segment_can_speak():
    """Without a spread between segments the noise is taken at its word."""
    for score, k in ((3.0, 1), (0.5, 1)):
        found = group_statistics(Eliminated(np.array([[score]]), np.array([[1.0]])), [np.array([0])])
        assert found[0] == pytest.approx(-stats.chi2.logsf(score**2, k), rel=1e-9)


def test_columns_that_change_nothing_say_nothing():
    """As those of an actuator that is never driven."""
    of = columns(11)
    of.z[..., 0] = 0
    of.z[..., 1] = 0
    given = of.scores(null_data(of, np.random.default_rng(12)))
    found = mismatch_test(given, GROUPS, np.random.default_rng(13), 199)
    assert found.statistics[0] == 0
    assert np.isfinite(found.statistics).all()
    assert found.p_value > 0.05
    nothing = mismatch_test(given, GROUPS[:1], np.random.default_rng(14), 19)
    assert nothing.p_value == 1


def test_a_column_that_repeats_another_adds_nothing():
    of = columns(15)
    e = null_data(of, np.random.default_rng(16))
    of.z[..., 2] = of.z[..., 1]
    eliminate = Elimination(of.scores(e))
    found = group_statistics(eliminate(of.scores(e).b), [np.array([1]), np.array([1, 2])])
    assert found[1] == pytest.approx(found[0], rel=1e-6)


@pytest.mark.parametrize("scale", [1.0, 2.5])
def test_p_values_are_uniform_under_the_null(scale):
    """Also where the noise is larger than was thought: its size is in numerator and denominator."""
    of, rng = columns(17, segments=10, size=15, nuisance=0.5), np.random.default_rng(18)
    found = [mismatch_test(of.scores(null_data(of, rng, scale)), GROUPS, rng, 99).p_value for _ in range(200)]
    # p-values are hundredths; half a step makes them uniform on average.
    assert stats.kstest(np.array(found) - 0.005, "uniform").pvalue > 1e-3
    assert min(found) >= 0.01


def test_a_planted_effect_is_found_where_it_is():
    of, rng = columns(19, segments=40, alike=0.1), np.random.default_rng(20)
    information = Elimination(of.scores(np.zeros(of.z.shape[:2]))).information
    for group, member in ((0, 0), (1, 2), (2, 4)):
        # Ten standard errors, against 39 degrees of freedom between segments.
        size = 10 / np.sqrt(information[member, member])
        planted = size * of.z[..., member]
        found = mismatch_test(of.scores(null_data(of, rng) + planted), GROUPS, rng, 199)
        assert found.p_value == 1 / 200
        assert found.largest == group


def test_large_nuisance_does_not_pass_for_an_effect():
    """A nuisance of four prior standard deviations, in columns that are like those of the candidates."""
    of, rng = columns(21), np.random.default_rng(22)
    values = np.where(IS_NUISANCE, 4.0, 0.0)
    low = 0
    for _ in range(40):
        e = rng.standard_normal(of.z.shape[:2]) + of.z @ values
        low += mismatch_test(of.scores(e), GROUPS, rng, 99).p_value <= 0.05
    # 40 trials at a twentieth: 2, and more than 7 once in a thousand.
    assert low <= 7


def test_the_number_of_draws_is_what_was_asked_for():
    of = columns(23)
    given = of.scores(null_data(of, np.random.default_rng(24)))
    for count in (19, 100, 250):
        found = mismatch_test(given, GROUPS, np.random.default_rng(25), count)
        assert (found.p_value * (count + 1)) == pytest.approx(round(found.p_value * (count + 1)))
    same = [mismatch_test(given, GROUPS, np.random.default_rng(26), 99).p_value for _ in range(2)]
    assert same[0] == same[1]


@pytest.mark.parametrize("scale", [1.5, 3.0])
def test_scores_that_spread_more_than_the_noise_says_are_told(scale):
    """Noise that is larger than thought by a factor: the mean over draws, with its own standard error."""
    rng, of = np.random.default_rng(5), columns(6, segments=40)
    found = [overdispersion(of.scores(null_data(of, rng, scale)), np.arange(40) // 4) for _ in range(200)]
    assert np.mean(found) == pytest.approx(scale**2, abs=4 * np.std(found) / np.sqrt(len(found)))
    # 40 segments of 6 candidates: some 39 x 6 degrees of freedom.
    assert np.std(found) == pytest.approx(scale**2 * np.sqrt(2 / (39 * CANDIDATES)), rel=0.3)


def test_blocks_that_disagree_are_told_though_segments_hardly_do():
    """An effect of another size in each of twenty blocks, as large as the noise of a segment."""
    rng, block = np.random.default_rng(9), np.arange(160) // 8
    by_block, by_chance = [], 0
    for _ in range(400):
        noise, effect = rng.standard_normal((160, 1)), rng.standard_normal((20, 1))[block]
        told = [
            Scores(b, np.ones((160, 1, 1)), np.ones(1), np.zeros(1, bool)) for b in (noise, noise + effect)
        ]
        by_chance += overdispersion(told[0], block) > overdispersion(told[0], np.arange(160))
        by_block.append(overdispersion(told[1], block))
    # The sum of eight has a variance of 8 + 64, of which 8 would be noise; what chance may make is left out.
    expected = 9 / (stats.chi2.isf(0.05, 19) / 19)
    assert np.mean(by_block) == pytest.approx(expected, abs=4 * np.std(by_block) / 20)
    # At a twentieth, 20 are expected, and more than 35 once in a thousand.
    assert by_chance <= 35


def test_one_segment_cannot_disagree():
    of = columns(7, segments=1)
    assert overdispersion(of.scores(3 * null_data(of, np.random.default_rng(8))), np.zeros(1, int)) == 1.0


def test_scores_are_drawn_where_rounding_makes_information_indefinite():
    """Two columns that are one but for single precision: draws have the variances of the scores."""
    H = np.array([[[4.0, 4.0 * (1 + 1e-6)], [4.0 * (1 + 1e-6), 4.0]]])
    assert np.linalg.eigvalsh(H).min() < -1e-8
    of = Scores(np.zeros((1, 2)), H, np.ones(2), np.zeros(2, bool))
    drawn = Draws(of, np.random.default_rng(0))(4000)
    # The variance of 4000 draws is right to 3 sqrt(2 / 4000) of itself.
    np.testing.assert_allclose(drawn[:, 0].var(axis=0), 4.0, rtol=3 * np.sqrt(2 / 4000))
