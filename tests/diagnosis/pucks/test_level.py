"""What may be named beside another effect, and when a name is dropped."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest
from slapshot.diagnosis.pucks.headline import explained, names_hold
from slapshot.diagnosis.pucks.selection.level import (
    LEAST_SHIFT,
    Level,
    least_gain,
    least_shift,
    refuted_note,
    unnamed_explains_more,
    without_hidden,
)
from slapshot.diagnosis.pucks.selection.search import ADD, CLASS, Candidate, Screen, Search
from slapshot.diagnosis.pucks.slide.slide_model import Column
from slapshot.diagnosis.pucks.verdict import Errors, Interval
from slapshot.effects.catalogue import catalogue


@dataclass(frozen=True)
class Named:
    """A candidate, as far as these rules look at it."""

    effects: tuple[str, ...]


@dataclass
class Told:
    """A search: law errors, shifts in m and gains in nats by effect."""

    law: dict[str, float]
    moves: dict[str, float]
    gains: dict[str, float]
    deleted: list[str] = field(default_factory=list)
    beyond: float = 0.0  # nats that no error of the other's law can make

    def gain_beyond(self, at, name, other):
        return self.beyond

    def known_to(self, name):
        return self.law[name]

    def shift(self, at, name):
        return self.moves[name]

    def gain(self, at, name):
        return self.gains[name]

    def without(self, at, name):
        self.deleted.append(name)
        return Named(tuple(n for n in at.effects if n != name))


def told(companion_moves, companion_gain, law=0.15):
    return Told(
        {"tilt": law, "curl": 0.15},
        {"tilt": 0.1, "curl": companion_moves},
        {"tilt": 2000.0, "curl": companion_gain},
    )


BOTH = Named(("curl", "tilt"))


@pytest.mark.parametrize(
    ("moves", "gain", "kept"),
    [(0.02, 60.0, True), (0.01, 60.0, False), (0.02, 40.0, False)],  # of 15 mm and 45 nats
)
def test_a_companion_must_do_more_than_the_law_beside_it_errs_by(moves, gain, kept):
    search = told(moves, gain)
    assert (without_hidden(search, BOTH) == BOTH) == kept
    assert search.deleted == ([] if kept else ["curl"])


def test_what_no_error_of_the_law_beside_it_can_make_needs_no_more_than_anything():
    search = told(0.02, 40.0)
    search.beyond = 2 * ADD
    assert without_hidden(search, BOTH) == BOTH
    assert least_shift(search, BOTH, "curl") == LEAST_SHIFT
    assert least_gain(search, BOTH, "curl") == ADD


def test_beside_an_exact_law_anything_that_matters_may_be_named():
    search = told(0.004, 5.0, law=0.0)
    assert least_shift(search, BOTH, "curl") == LEAST_SHIFT
    assert least_gain(search, BOTH, "curl") == ADD
    # The tilt must still do more than the curl's law errs by.
    assert without_hidden(search, BOTH) == BOTH


def test_law_errors_add_up_as_independent_ones():
    search = told(0.02, 60.0)
    squares = LEAST_SHIFT**2 + (0.15 * 0.1) ** 2 + (0.15 * 0.02) ** 2
    assert least_shift(search, BOTH) == pytest.approx(squares**0.5)
    assert least_gain(search, BOTH) == pytest.approx(0.15**2 * 2060)


def errors(rest):
    same = Interval(0.01, 0.009, 0.011)
    return Errors(same, rest, None, Interval(1.0, 0.5, 1.5), Interval(1.0, 0.9, 1.1), None, None)


def test_a_name_that_makes_an_error_larger_than_its_interval_without_it_does_not_hold():
    before = errors(Interval(0.0077, 0.006, 0.0092))
    fit = {"refitted": before, "augmented": replace(before, rest_rmse_m=Interval(0.0093, 0.007, 0.012))}
    assert not names_hold(fit)
    assert names_hold(fit | {"augmented": replace(before, rest_rmse_m=Interval(0.0091, 0.007, 0.012))})


def about(value):
    return Interval(value + 0.3, value, value + 0.6)


@pytest.mark.parametrize("by", ["camera_chi2", "encoder_chi2"])
@pytest.mark.parametrize(
    ("left", "is_explained"), [(1.8, True), (2.2, False)]
)  # of 1 + .3^2 * (12 - 1) = 1.99
def test_names_that_leave_more_than_laws_err_by_are_not_all_of_it(by, left, is_explained):
    rest = Interval(0.01, 0.009, 0.011)
    fit = {
        "refitted": replace(errors(rest), **{by: Interval(12.0, 9.0, 15.0)}),
        "augmented": replace(errors(rest), **{by: about(left)}),
    }
    assert explained(fit, 0.3) == is_explained


def test_what_cameras_see_is_not_explained_by_what_explains_encoders():
    """Encoders of a chi-squared of 12 that come to 1 say nothing of frames, which stay at 1.5."""
    same = errors(Interval(0.01, 0.009, 0.011))
    before = replace(same, camera_chi2=about(1.5), encoder_chi2=about(12.0))
    after = replace(same, camera_chi2=about(1.5), encoder_chi2=about(0.7))
    assert not explained({"refitted": before, "augmented": after}, 0.3)
    assert explained({"refitted": before, "augmented": replace(after, camera_chi2=about(0.9))}, 0.3)


class Refits(Search):
    """What effects promise by a linear screen, and gain once refitted."""

    def ahead(self, one, other):
        return one.log_evidence - other.log_evidence

    def __init__(self, gains):
        super().__init__(SimpleNamespace(effects=catalogue()), (), (), None)
        self.gains, self.tried = gains, []

    def _start_gain(self, at, name):
        return 0.0

    def at_bound(self, candidate):
        return False

    def refit(self, at, names, direction):
        self.tried.append(names[-1])
        return Candidate(tuple(names), None, self.gains[names[-1]], None)


@pytest.mark.parametrize(
    ("rival", "promised", "first_gains", "is_tried"),
    [
        ("camera_scale", 400.0, 1000.0, False),
        ("camera_scale", 400.0, 50.0, True),  # 400 nats are no rival of 1000, but of the 50 that it comes to
        ("camera_scale", 400.0, 390.0, True),
        # About no elasticity little is seen of what an elastic arm does: 250 nats may become more than 1000.
        ("joint_elasticity", 260.0, 1000.0, True),
        ("joint_elasticity", 240.0, 1000.0, False),
    ],
)
def test_what_may_explain_more_than_it_promises_is_tried(rival, promised, first_gains, is_tried):
    promise = {"linear_drag": 1000.0, "curl": 300.0, rival: promised, "tilt": 3.0}
    search = Refits({"linear_drag": first_gains, "curl": 200.0, rival: 395.0, "tilt": 3.0})
    screen = Screen(promise, dict.fromkeys(promise, 0.1), 0.002, {})
    best = search.grow(Candidate((), None, 0.0, None), screen, list(promise))[0]
    assert (rival in search.tried) == is_tried
    assert "tilt" not in search.tried
    assert best.effects == (max(search.tried, key=search.gains.get),)


class Sets(Search):
    """Evidence of sets of effects, of which any may be fitted; a screen promises a share of what they add."""

    def __init__(self, gains, share=0.7):
        super().__init__(SimpleNamespace(effects=catalogue()), [], (), None)
        self.catalogue = list(dict.fromkeys(name for names in gains for name in sorted(names)))
        self.gains, self.share, self.started = gains, share, []
        self.seen[()] = self.of(())

    def of(self, names):
        values = {
            name: {p.name: p.neutral + 0.1 * p.scale for p in catalogue()[name].parameters} for name in names
        }
        fit = SimpleNamespace(point=SimpleNamespace(effects=values))
        return Candidate(tuple(names), fit, self.gains.get(frozenset(names), -np.inf), None)

    def ahead(self, one, other):
        return one.log_evidence - other.log_evidence

    def _start_gain(self, at, name):
        return -np.inf

    def without(self, candidate, name):
        return self.of([n for n in candidate.effects if n != name])

    def _judged(self, at, hypotheses):
        added = {n: self.of([*at.effects, n]).log_evidence - at.log_evidence for n in hypotheses}
        promise = {n: self.share * gain for n, gain in added.items()}
        return Screen(promise, {}, 1.0, {n: {"by": gain} for n, gain in promise.items()}), [], None

    def refit(self, at, names, direction):
        self.started.append((at.effects, tuple(names), direction[names[-1]]))
        return self.of(tuple(sorted(names)))


DRAG, FIELD_, TILT, CURL = "quadratic_drag", "uneven_board", "tilt", "curl"
PAIRS = {
    frozenset(): 0.0, frozenset({FIELD_}): 1850.0, frozenset({TILT}): 1740.0, frozenset({CURL}): 300.0,
    frozenset({DRAG}): 900.0, frozenset({FIELD_, DRAG}): 2040.0, frozenset({TILT, DRAG}): 2240.0,
    frozenset({CURL, DRAG}): 950.0,
}  # fmt: skip


def test_what_explained_most_by_itself_makes_room_for_what_explains_more_beside_another():
    """A field took a part of a drag's place: with the drag, a tilt explains more than the field."""
    search = Sets(PAIRS)
    assert search.exchange(search.of((DRAG, FIELD_))).effects == (DRAG, TILT)
    # A curl promises far less than the field gains; the tilt begins where its screen beside the drag has it.
    assert search.started[0] == ((DRAG,), (DRAG, TILT), {"by": 0.7 * 1340.0})
    assert not any(CURL in names for _, names, _ in search.started)
    assert search.exchange(search.of((TILT,))).effects == (TILT,)
    search.gains = PAIRS | {frozenset({TILT, DRAG}): 2030.0}
    assert search.exchange(search.of((DRAG, FIELD_))).effects == (DRAG, FIELD_)


def test_beside_a_field_no_other_is_tried():
    search = Sets(
        {**PAIRS, frozenset({"place_friction"}): 1000.0, frozenset({"place_friction", FIELD_}): 9e3}
    )
    assert search.exchange(search.of((DRAG, FIELD_))).effects == (DRAG, TILT)
    assert not any({"place_friction", FIELD_} == set(names) for _, names, _ in search.started)


def test_the_name_that_is_needed_least_goes_first():
    """Of three of which any two explain all, the weaker of two that could go, whatever they are called."""
    gains = {
        frozenset({CURL, DRAG, TILT}): 1001.0, frozenset({DRAG, TILT}): 998.0,
        frozenset({CURL, TILT}): 1000.0, frozenset({CURL, DRAG}): 500.0,
        frozenset({TILT}): 990.0, frozenset({CURL}): 10.0, frozenset({DRAG}): 5.0,
    }  # fmt: skip
    search = Sets(gains)
    assert search.prune(search.of((CURL, DRAG, TILT))).effects == (CURL, TILT)


@pytest.mark.parametrize(
    ("by_itself", "more"),
    [(990.0, False), (1000.0 + CLASS + 22.0, False), (1000.0 + CLASS + 23.0, True)],  # .15^2 of 1000 nats
)
def test_a_free_form_must_explain_more_than_names_and_their_laws_errors(by_itself, more):
    search = Refits({"free_time": by_itself, "free_place": 900.0})
    search.free, search.fitter = ["free_place", "free_time"], SimpleNamespace(effects=catalogue())
    nominal, final = (Candidate(names, None, nats, None) for names, nats in (((), 0.0), (("tilt",), 1000.0)))
    search.seen[()] = nominal
    screen = Screen({"free_place": 900.0, "free_time": 800.0}, {}, 0.002, {})
    assert unnamed_explains_more(search, nominal, screen, final) == more
    assert search.tried == ["free_place", "free_time"]
    # What a linear screen promises far less than names gain is not refitted.
    unlike = replace(screen, log_evidence=dict.fromkeys(search.free, 400.0))
    search.tried.clear()
    assert not unnamed_explains_more(search, nominal, unlike, final)
    assert search.tried == []


class Leftover(Told):
    """A late swing was named, and free forms of places are left over."""

    free = ("free_place",)
    fitter = SimpleNamespace(effects={"free_place": SimpleNamespace(phase="slide", follows="place")})
    reached = False  # by what the swing's law errs by, once the form is fitted
    fits = True

    def gain_beyond(self, at, name, other):
        return 0.0 if self.reached else np.inf if name not in at.effects else 400.0

    def try_adding(self, at, name, direction):
        return Named((*at.effects, name)) if self.fits else None


def leftover_level(nats, moves):
    search = Leftover({"command_delay": 0.3}, {"command_delay": 0.1}, {"command_delay": 10_000.0})
    screen = Screen({"free_place": nats}, {"free_place": moves}, 0.002, {})
    mismatch = SimpleNamespace(found=True)
    return Level(search, Named(()), Named(("command_delay",)), screen, screen, mismatch)


def test_what_errors_of_a_law_do_not_reach_is_unknown_however_much_the_law_explains():
    """A delay of 10,000 nats may err by 900 nats and 30 mm, but of encoders and launches alone."""
    level = leftover_level(60.0, 0.01)
    assert level.unknown.flagged
    level.search.reached = True
    assert not level.unknown.flagged
    # Nor where the form takes the delay's place once it is fitted, and leaves the delay hardly any gain.
    level.search.gain = lambda at, name: 1.0 if "free_place" in at.effects else 10_000.0
    level.search.shift = lambda at, name: 1e-4 if "free_place" in at.effects else 0.1
    assert not level.unknown.flagged
    level.search.reached, level.search.fits = False, False
    assert not level.unknown.flagged
    assert not leftover_level(CLASS + ADD, 0.01).unknown.flagged
    assert not leftover_level(60.0, 0.9 * LEAST_SHIFT).unknown.flagged
    assert leftover_level(950.0, 0.04).unknown.flagged


def test_the_weaker_of_two_names_goes_first_where_names_do_not_hold():
    search = told(0.02, 60.0)
    search.settle = lambda at: at
    search.screen_beyond = lambda at: f"beyond {' '.join(at.effects)}"
    level = Level(search, Named(()), BOTH, "all", "nothing", None)
    assert "curl fitted beside tilt" in refuted_note(level)
    fewer = level.without_weakest_name()
    assert (fewer.final.effects, fewer.leftover) == (("tilt",), "beyond tilt")
    assert "tilt fitted best, but with it" in refuted_note(fewer)
    none = fewer.without_weakest_name()
    assert (none.final.effects, none.leftover) == ((), "all")


def test_evidence_is_compared_in_the_same_units_of_misfit():
    """Of 1000 readings; each alone is divided by what it leaves, and its few nats more come out as many."""

    def fit(objective):
        none = SimpleNamespace(information=np.zeros((1, 0, 0)), scores=np.zeros((1, 0)))
        return SimpleNamespace(
            objective=objective, dispersion=objective / 1000, columns=(), marginal=none, point=None
        )

    search = Search(SimpleNamespace(prior=lambda columns: (np.zeros(0), np.zeros(0))), (), (), None)
    search.seen[()] = nominal = Candidate((), fit(20_000.0), 0.0, None)
    worse, better = (Candidate((n,), fit(v), 0.0, None) for n, v in (("a", 4100.0), ("b", 4000.0)))
    assert search.ahead(better, worse) == pytest.approx(50 / 4.0)
    assert search.ahead(worse, better) == pytest.approx(-50 / 4.0)
    assert search.ahead(better, nominal) == pytest.approx(8000 / 4.0)
    alone = [search._log_evidence(one.fit, None) for one in (better, worse)]
    assert alone[0] - alone[1] > 4 * 50 / 4.0


def test_sizes_that_later_screens_choose_leave_evidence_of_fits_as_it_was():
    """A field was fitted with bumps of the largest size; beyond another effect a screen wants tiny ones."""
    sizes = {"size": 3.0}
    fitter = SimpleNamespace(
        effects=catalogue(),
        prior=lambda columns: (np.zeros(len(columns)), np.full(len(columns), sizes["size"] ** -2)),
    )
    search = Search(fitter, (), (), None)
    marginal = SimpleNamespace(information=np.full((1, 1, 1), 50.0), scores=np.zeros((1, 1)))
    point = SimpleNamespace(effects={"uneven_board": {"height_0": 0.01}})

    def fit(objective, *columns):
        return SimpleNamespace(
            objective=objective, dispersion=1.0, columns=columns, marginal=marginal, point=point
        )

    nothing = SimpleNamespace(information=np.zeros((1, 0, 0)), scores=np.zeros((1, 0)))
    nominal = replace(Candidate((), fit(1000.0), 0.0, None), precision=np.zeros(0))
    nominal.fit.marginal = nothing
    search.seen[()] = nominal
    field_fit = fit(900.0, Column("uneven_board", "height_0", -1, 0.001))
    precision = search._precision(field_fit)
    board = Candidate(("uneven_board",), field_fit, 0.0, None, precision=precision)
    before = search.ahead(board, nominal)
    sizes["size"] = 1e-4
    assert search.ahead(board, nominal) == before
    assert search.ahead(replace(board, precision=None), nominal) != pytest.approx(before, abs=1.0)


@pytest.mark.parametrize(
    ("name", "other", "nats"),
    [
        ("tilt", "command_delay", 35.0),
        ("camera_time", "blade_yaw", 35.0),
        ("offcentre_mass", "servo_gain", 35.0),
        ("command_delay", "tilt", 55.0),
        ("backlash", "restitution", 55.0),
        ("curl", "tilt", 0.0),
        ("tracking_lag", "servo_gain", 0.0),
        ("restitution", "tilt", 0.0),
        ("blade_yaw", "tracking_lag", 0.0),
    ],
)
def test_errors_of_a_law_do_not_reach_what_others_are_told_by(name, other, nats):
    fitter = SimpleNamespace(
        effects=catalogue(), gain_by_tracks=lambda fit, name: 70.0, gain_by_encoders=lambda fit, name: 110.0
    )
    search = Search(fitter, (), (), None)
    fit = SimpleNamespace(dispersion=2.0, point=SimpleNamespace(latents=np.zeros((100, 6))))
    at = Candidate((name, other), fit, 0.0, fitter)
    by_chance = len(catalogue()[name].parameters) / 2 * np.log(100)
    assert search.gain_beyond(at, name, other) == pytest.approx(nats - by_chance if nats else 0.0)
    # Before it is fitted there may be any.
    alone = replace(at, effects=(other,))
    assert search.gain_beyond(alone, name, other) == (float("inf") if nats else 0.0)


@pytest.mark.parametrize(
    ("name", "values", "is_another"),
    [
        ("lens_distortion", {"radial": 0.01, "middle_x": 0.5, "middle_y": 0.0}, True),
        ("lens_distortion", {"radial": 0.01, "middle_x": 0.49, "middle_y": 0.0}, False),
        ("offcentre_mass", {"offset_x": 0.001, "offset_y": 0.0, "log_inertia": -2.0}, True),
        ("joint_elasticity", {f"twist_{j}": 0.0 for j in range(1, 8)}, False),  # 0 is neutral
    ],
)
def test_what_fits_best_at_a_bound_of_what_is_possible_is_another_law(name, values, is_another):
    search = Search(SimpleNamespace(effects=catalogue()), (), (), None)
    fit = SimpleNamespace(point=SimpleNamespace(effects={name: values}))
    assert search.at_bound(Candidate((name,), fit, 0.0, None)) == is_another
    bumps = {p.name: p.high for p in catalogue()["uneven_board"].parameters}
    field = SimpleNamespace(point=SimpleNamespace(effects={"uneven_board": bumps}))
    assert not search.at_bound(Candidate(("uneven_board",), field, 0.0, None))


class Rounds(Search):
    """Rounds of simulation and fit whose values (in scales of a drag), error and objectives are given."""

    def __init__(self, ends, sd=0.0):
        self.sd = sd
        self.asked = []  # whether derivatives were simulated
        self.ends, self.scale = iter(ends), catalogue()["linear_drag"].parameters[0].scale
        super().__init__(SimpleNamespace(effects=catalogue(), sizes={}), (), (), None, about=self.simulated)

    def simulated(self, fit, derivatives):
        self.asked.append(derivatives)
        return SimpleNamespace(fit=lambda point, scatter, effects: self.at(*next(self.ends)))

    def at(self, value, objective):
        effects = {"linear_drag": {"rate": value * self.scale}}
        return SimpleNamespace(
            point=SimpleNamespace(effects=effects),
            scatter=None,
            objective=objective,
            columns=[Column("linear_drag", "rate", -1, 0.1)],
            covariance=np.array([[(self.sd * self.scale) ** 2]]),
        )

    def _precision(self, fit):
        return np.zeros(1)

    def _log_evidence(self, fit, precision):
        return -fit.objective


@pytest.mark.parametrize(
    ("ends", "chosen"),
    [
        # It went far first, so that it only seems to be best; then to and fro.
        ([(2.0, 100.0), (2.2, 200.0), (2.4, 210.0), (2.2, 190.0)], 200.0),
        ([(0.3, 300.0), (0.6, 250.0), (0.9, 200.0), (0.95, 199.0)], 199.0),  # it gains until it stays
        ([(float(2 * i), 100.0 - i) for i in range(1, 9)], 100.0 - 6),  # it never comes near
    ],
)
def test_the_best_of_those_rounds_counts_that_stay_where_they_were_simulated(ends, chosen):
    search = Rounds(ends)
    begin = Candidate(("linear_drag",), search.at(0.0, 500.0), 0.0, search.fitter, final=False)
    found = search.finish(begin)
    assert found.fit.objective == chosen
    assert found.final
    assert search.seen["linear_drag",] is found


def test_no_more_rounds_are_simulated_where_one_is_far_behind():
    """A round of -300 nats ends it where -210 are asked for, and not where -310 are, near or far.

    It needs no derivatives, which are simulated for what may be good enough.
    """
    for values in ([0.3, 0.6], [2.0, 4.0]):
        ends = list(zip(values, (300.0, 200.0), strict=True))
        search = Rounds(ends)
        begin = Candidate(("linear_drag",), search.at(0.0, 500.0), 0.0, search.fitter, final=False)
        assert search.finish(begin, least=-210.0).fit.objective == 300.0
        assert search.asked == [False]
        search = Rounds([*ends, (values[1], 200.0)])
        assert search.finish(begin, least=-310.0).fit.objective == 200.0
        assert search.asked == [False, True, True]


def test_a_value_stays_that_moves_by_less_than_half_its_standard_error():
    """By as much the scatter of contact moves it: two scales of an error of five."""
    search = Rounds([(2.0, 100.0), (4.0, 90.0)], sd=5.0)
    begin = Candidate(("linear_drag",), search.at(0.0, 500.0), 0.0, search.fitter, final=False)
    assert search.finish(begin).fit.objective == 100.0
