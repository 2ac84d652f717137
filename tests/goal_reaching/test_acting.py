"""Acting and exploring, held against closed forms, brute force and a world whose answer is known."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import torch
from slapshot.adaptation.data import Batch
from slapshot.adaptation.kalman import Kalman, KalmanBelief
from slapshot.adaptation.method import Sizes
from slapshot.claims import s12, s13
from slapshot.config.acting import Inverse
from slapshot.config.methods import KalmanSettings, Training
from slapshot.errors import InputError
from slapshot.figures import a1_acting, a2_exploration
from slapshot.goal_reaching.expected_cost import (
    believed_cost,
    cheapest,
    choose_by_gradient,
    draw_phi,
    expected_cost,
    predicted_cost,
)
from slapshot.goal_reaching.exploration import INFORMED, SAMPLED
from slapshot.goal_reaching.explore import at_random, explore, informed
from slapshot.goal_reaching.goals import goals_of
from slapshot.goal_reaching.inverse import Standardisation, train_inverse
from slapshot.goal_reaching.rigs import Robot
from slapshot.goal_reaching.uncertainty import outcome_jacobian, predicted_variance, variance_after
from told import FIGURE

MODELS, TASKS, LATENT, PHI = 2, 3, 3, 4


@pytest.fixture
def method() -> Kalman:
    settings = KalmanSettings(latent=PHI, hidden=(16,), drift=0.001)
    made = Kalman(Sizes(2, LATENT, 2), settings, MODELS, torch.Generator().manual_seed(3))
    return made.requires_grad_(False)


def normal(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


@pytest.fixture
def belief(method) -> KalmanBelief:
    state, action, observed = (normal(MODELS, TASKS, 3, n, seed=n) for n in (2, LATENT, 2))
    return method.adapt(state, action, observed)[-1]


def test_the_jacobian_is_that_of_automatic_differentiation(method, belief):
    state, action = normal(MODELS, TASKS, 5, 2), normal(MODELS, TASKS, 5, LATENT, seed=1)
    found = outcome_jacobian(method, belief, state, action)

    def outcome(mean: torch.Tensor) -> torch.Tensor:
        return method.outcome(mean[:, :, None], state, action)

    full = torch.autograd.functional.jacobian(outcome, belief.mean)  # (M, B, Q, do, M, B, h)
    for m in range(MODELS):
        for b in range(TASKS):
            torch.testing.assert_close(found[m, b], full[m, b, :, :, m, b], atol=2e-3, rtol=0)


def test_predicted_variance_is_that_of_a_cloud_where_the_model_is_linear():
    """tr(J Sigma J') against the spread of J phi over many draws; 6 sd of a variance estimate."""
    rng = np.random.default_rng(0)
    jacobian = rng.normal(size=(1, 1, 6, 2, PHI))
    factor = rng.normal(size=(PHI, PHI))
    covariance = factor @ factor.T
    draws = rng.normal(size=(200_000, PHI)) @ factor.T
    cloud = np.einsum("qoh,nh->nqo", jacobian[0, 0], draws)
    expected = cloud.var(0).sum(-1).mean()
    found = predicted_variance(torch.tensor(jacobian), torch.tensor(covariance)[None, None])
    assert float(found) == pytest.approx(expected, rel=6 * np.sqrt(2 / 200_000))


def test_variance_after_is_what_the_filter_has_after_the_hit_that_was_expected(method, belief):
    """By hand, candidate for candidate: update with the expected outcome, then the predictive variance."""
    states = normal(MODELS, TASKS, 7, 2, seed=5)
    actions = normal(MODELS, TASKS, 7, LATENT, seed=6)
    asked = normal(MODELS, TASKS, 4, 2, seed=7), normal(MODELS, TASKS, 4, LATENT, seed=8)
    jacobian = outcome_jacobian(method, belief, *asked)
    found = variance_after(method, belief, jacobian, states, actions)
    for c in range(7):
        state, action = states[:, :, c], actions[:, :, c]
        expected = method.predict(belief, state[:, :, None], action[:, :, None])[:, :, 0]
        after = method.update(belief, state, action, expected)
        by_hand = predicted_variance(jacobian, after.covariance)
        torch.testing.assert_close(found[:, :, c], by_hand, rtol=1e-4, atol=1e-6)


def test_a_hit_never_makes_predictions_less_sure_than_the_drift_does(method, belief):
    states, actions = normal(MODELS, TASKS, 20, 2), normal(MODELS, TASKS, 20, LATENT, seed=2)
    jacobian = outcome_jacobian(method, belief, states[:, :, :4], actions[:, :, :4])
    drifted = belief.covariance + method.settings.drift * torch.eye(PHI)
    before = predicted_variance(jacobian, drifted)
    after = variance_after(method, belief, jacobian, states, actions)
    assert (after <= before[:, :, None] * (1 + 1e-5)).all()


def test_the_informed_choice_is_the_best_of_those_left_and_none_is_taken_twice(method, belief):
    candidates = {
        "state": normal(MODELS, TASKS, 6, 2),
        "action": normal(MODELS, TASKS, 6, LATENT, seed=1),
        "outcome": normal(MODELS, TASKS, 6, 2, seed=2),
    }
    asked = candidates["state"][:, :, :3], normal(MODELS, TASKS, 3, LATENT, seed=9)
    seen: list[torch.Tensor] = []
    choose = informed(method, candidates, asked)

    def watched(now: KalmanBelief, used: torch.Tensor) -> torch.Tensor:
        chosen = choose(now, used)
        jacobian = outcome_jacobian(method, now, *asked)
        left = variance_after(method, now, jacobian, candidates["state"], candidates["action"])
        least = left.masked_fill(used, np.inf).amin(-1)
        assert (left.gather(2, chosen[..., None])[..., 0] <= least).all()
        seen.append(chosen)
        return chosen

    beliefs = explore(method, candidates, watched, 6)
    assert len(beliefs) == 7
    order = torch.stack(seen, dim=-1)
    assert (torch.sort(order, -1)[0] == torch.arange(6)).all()
    # The same hits in the same order give the same belief as adapting to them.
    taken = [
        candidates[k].gather(2, order[..., None].expand(-1, -1, -1, candidates[k].shape[-1]))
        for k in ("state", "action", "outcome")
    ]
    torch.testing.assert_close(beliefs[-1].mean, method.adapt(*taken)[-1].mean)


def test_latent_sampling_takes_every_candidate_equally_often():
    choose = at_random(torch.Generator().manual_seed(0))
    used = torch.zeros(4000, 1, 5, dtype=torch.bool)
    used[:, :, 2] = True
    counts = torch.bincount(choose(None, used).ravel(), minlength=5)
    assert counts[2] == 0
    # Binomial with p = 1/4: 6 sd of 1000 are 164.
    assert (counts[[0, 1, 3, 4]] - 1000).abs().max() < 164


class Linear:
    """A world s' = a[:2] + phi[:2] + |a[2]| phi[2:]: the third number of an action only adds uncertainty."""

    models = 1

    def outcome(self, phi: torch.Tensor, state: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
        return action[..., :2] + phi[..., :2] + action[..., 2:].abs() * phi[..., 2:]


def test_the_gradient_finds_the_action_that_is_on_target_and_surest():
    phi = 0.3 * normal(1, 1, 64, PHI) + torch.tensor([0.5, -0.2, 0.0, 0.0])
    target = torch.tensor([[[1.0, 0.4], [-0.3, 0.2]]])
    corner = torch.full((LATENT,), 2.0)
    cost = believed_cost(Linear(), phi, torch.zeros(2), target)
    found = choose_by_gradient(cost, normal(32, LATENT, seed=3), 1, 2, (-corner, corner))
    expected = target - phi[0, 0, :, :2].mean(0)
    torch.testing.assert_close(found[..., :2], expected, atol=0.03, rtol=0)
    assert found[..., 2].abs().max() < 0.15


def test_the_gradient_stays_within_bounds_and_never_loses_to_its_candidates(method, belief):
    phi = draw_phi(method, belief, 8, torch.Generator().manual_seed(0))
    target, candidates = 3 * normal(TASKS, 4, 2), normal(16, LATENT, seed=4)
    corner = torch.full((LATENT,), 0.7)
    candidates = candidates.clamp(-0.7, 0.7)
    cost = believed_cost(method, phi, torch.zeros(2), target)
    found = choose_by_gradient(cost, candidates, TASKS, 4, (-corner, corner))
    assert (found.abs() <= 0.7 + 1e-6).all()
    tried = cost(candidates.expand(TASKS, 4, 16, LATENT)).amin(-1)
    assert (cost(found[:, :, None])[..., 0] <= tried * 1.05).all()


def test_expected_cost_is_squared_error_of_the_mean_plus_variance(method, belief):
    phi = draw_phi(method, belief, 500, torch.Generator().manual_seed(0))
    action, target = normal(MODELS, TASKS, 2, 3, LATENT), normal(MODELS, TASKS, 2, 2, seed=1)
    found = expected_cost(method, phi, torch.zeros(2), action, target)
    cloud = method.outcome(phi[:, :, None, None], torch.zeros(2), action[..., None, :])
    by_hand = (cloud.mean(-2) - target[:, :, :, None]).square().sum(-1) + cloud.var(-2, correction=0).sum(-1)
    torch.testing.assert_close(found, by_hand, rtol=1e-3, atol=1e-5)


def test_what_predictions_cost_is_their_squared_distance_from_the_target(method, belief):
    """By hand, target for target and candidate for candidate, the mean over models."""
    state, target, actions = normal(2), normal(TASKS, 2, 2, seed=1), normal(TASKS, 2, 3, LATENT, seed=2)
    found = predicted_cost(method, belief, state, target)(actions)
    for t in range(2):
        for c in range(3):
            action = actions[:, t, c].expand(MODELS, TASKS, LATENT)[:, :, None]
            outcome = method.predict(belief, state.expand(MODELS, TASKS, 1, 2), action)[:, :, 0]
            by_hand = (outcome - target[:, t]).square().sum(-1).mean(0)
            torch.testing.assert_close(found[:, t, c], by_hand)


def test_a_hit_that_the_camera_misses_is_made_again():
    asked: list[list[str]] = []

    def blink(motions, object_ids, rng):
        asked.append(list(object_ids))
        rests = np.array([[m[0], m[1]] for m in motions], float)
        if len(asked) == 1:
            rests[0] = np.nan
        return rests

    model = SimpleNamespace(motion=lambda latent: latent, sizes=SimpleNamespace(latent=2))
    check = SimpleNamespace(report=lambda motion: SimpleNamespace(safe=True))
    robot = Robot(SimpleNamespace(execute=blink), model, check)
    latents = np.array([[0.1, 0.2], [0.3, 0.4]])
    assert np.array_equal(robot.hit(latents, ["red", "blue"], np.random.default_rng(0)), latents)
    assert asked == [["red", "blue"], ["red"]]
    blind = SimpleNamespace(execute=lambda motions, ids, rng: np.full((len(ids), 2), np.nan))
    with pytest.raises(InputError, match="camera misses where 2 hits end"):
        Robot(blind, model, check).hit(latents, ["red", "blue"], np.random.default_rng(0))


def test_a_sampled_latent_that_leads_out_of_view_is_drawn_anew():
    """Unlike a chosen one, which is what it is: here nothing beyond 0.5 is ever seen."""
    model = SimpleNamespace(motion=lambda latent: latent, sizes=SimpleNamespace(latent=2))
    check = SimpleNamespace(report=lambda motion: SimpleNamespace(safe=True))

    def execute(motions, object_ids, rng):
        return np.array([m if m[0] < 0.5 else np.full(2, np.nan) for m in motions])

    latents, rests = Robot(SimpleNamespace(execute=execute), model, check).sample(
        50, "red", np.random.default_rng(0)
    )
    assert np.array_equal(latents, rests)
    assert (latents[:, 0] < 0.5).all()
    assert len(np.unique(latents, axis=0)) == 50
    blind = SimpleNamespace(execute=lambda motions, ids, rng: np.full((len(ids), 2), np.nan))
    with pytest.raises(InputError, match="camera misses where 3 hits end"):
        Robot(blind, model, check).sample(3, "red", np.random.default_rng(0))


def test_goals_are_the_same_for_everybody_and_apart_from_elsewhere():
    actions = np.repeat(np.arange(10.0)[:, None], 2, axis=0) * np.ones(3)  # every command twice
    data = {"action": actions.astype(np.float32), "outcome": actions[:, :2].astype(np.float32)}
    task = SimpleNamespace(data=data, object="red")
    robot = SimpleNamespace(certain=lambda latents, ids: latents[:, :2] + 0.5)
    goals, again = (goals_of(robot, task, 4, [1, 2]) for _ in range(2))
    assert np.array_equal(goals.targets, again.targets)
    assert not np.array_equal(goals.targets, goals_of(robot, task, 4, [1, 3]).targets)
    assert np.array_equal(goals.targets, goals.latents[:, :2] + 0.5)
    commands = {*goals.latents[:, 0], *goals.elsewhere[:, 0]}
    assert len(commands) == 10
    assert (len(goals.latents), len(goals.elsewhere)) == (4, 6)
    assert len(goals_of(robot, task, 99, [1]).latents) == 5


def test_the_cheapest_of_several_is_taken():
    cost = torch.tensor([[[3.0, 1.0, 2.0], [0.5, 4.0, 9.0]]])
    action = torch.arange(6.0).reshape(1, 2, 3, 1)
    assert cheapest(cost, action).tolist() == [[[1.0], [3.0]]]


def test_an_inverse_model_learns_to_hit_targets(method):
    """In the world of a fixed forward model: after training it misses by far less than at first."""

    class Sampler:
        def draw(self, models, tasks, length, noise, generator):
            state, action = (torch.zeros(models, tasks, length, 2), normal(models, tasks, length, LATENT))
            belief = method.prior(tasks)
            outcome = method.predict(belief, state, action)
            return Batch(state, action, outcome, outcome)

    settings = Inverse(hidden=(32,), steps=300, learning_rate=0.01, draws=2)
    training = Training(models=MODELS, steps=300, tasks=8, sequence=6, noise_variance_max=0.0)
    identity = Standardisation(torch.zeros(LATENT), torch.ones(LATENT))
    generator = torch.Generator().manual_seed(0)
    inverse, losses = train_inverse(method, Sampler(), identity, settings, training, generator)
    assert np.mean(losses[-20:]) < 0.7 * np.mean(losses[:20])
    again, _ = train_inverse(
        method, Sampler(), identity, settings, training, torch.Generator().manual_seed(0)
    )
    for name, value in inverse.state_dict().items():
        torch.testing.assert_close(again.state_dict()[name], value)


def test_an_unsafe_latent_is_shrunk_until_it_is_safe():
    model = SimpleNamespace(motion=lambda latent: latent, sizes=SimpleNamespace(latent=2))
    check = SimpleNamespace(report=lambda motion: SimpleNamespace(safe=np.linalg.norm(motion) < 1))
    robot = Robot(None, model, check)
    latent, _ = robot.safe(np.array([3.0, 4.0]))
    assert 0.85 < np.linalg.norm(latent) < 1
    assert latent[1] / latent[0] == pytest.approx(4 / 3)
    assert robot.safe(np.array([0.3, 0.4]))[0].tolist() == [0.3, 0.4]
    found = robot.candidates(50, np.random.default_rng(0))
    assert (np.linalg.norm(found, axis=1) < 1).all()


def exploration_table(rigs: int = 6) -> pd.DataFrame:
    """Informed sampling has after n hits what the other arm has after 2 n."""
    rng = np.random.default_rng(0)
    rows = [
        {"recording": "lab", "rig": rig, "object": "red", "stand_in": True, "arm": arm, "repeat": 0,
         "model": model, "samples": n, "error_m": 0.3 / (1 + n * (1.0 if arm == SAMPLED else 2.0))
         + 0.002 * rng.normal()}
        for rig in range(rigs) for arm in (INFORMED, SAMPLED) for model in range(3) for n in range(13)
    ]  # fmt: skip
    return pd.DataFrame(rows)


def test_the_verdict_on_exploration_is_the_share_of_samples(tmp_path):
    exploration_table().to_parquet(tmp_path / "exploration.parquet")
    statements = s13.evaluate({"exploration": tmp_path})
    assert len(statements) == 3
    for statement in statements:
        assert statement.interval.value == pytest.approx(0.5, abs=0.08)
        assert statement.interval.low <= statement.interval.value <= statement.interval.high


def acting_folders(tmp_path, gain: float) -> dict:
    folders = {}
    rng = np.random.default_rng(1)
    for rig in range(8):
        rows = [
            {"rig": rig, "object": "red", "method": method, "chooser": chooser, "samples": n, "target": t,
             "target_x_m": 1.0, "target_y_m": 0.0, "error_m": base * (1 + 0.1 * rng.normal())}
            for method, chooser, n, base in (
                ("", "oracle", -1, 0.07),
                *(("lstm", "gradient", n, 9.0) for n in (0, 4, 8, 16)),  # of another figure
                *(("kalman", c, n, 0.35 if n == 0 else gain * 0.07)
                  for c in s12.CHOOSERS for n in (0, 4, 8, 16)),
            )
            for t in range(6)
        ]  # fmt: skip
        folders[str(rig)] = tmp_path / str(rig)
        folders[str(rig)].mkdir()
        pd.DataFrame(rows).to_parquet(folders[str(rig)] / "acting.parquet")
    return folders


@pytest.mark.parametrize(("gain", "verdict"), [(1.5, "holds"), (3.0, "does not hold")])
def test_the_verdict_on_acting_is_the_ratio_to_the_oracle(tmp_path, gain, verdict):
    statements = s12.evaluate(acting_folders(tmp_path, gain))
    assert [s.verdict for s in statements] == [verdict] * 3
    # 35 cm before, 10.5 cm after 4: twice the oracle's 14 cm after 3.4; never, with 21 cm.
    assert statements[2].interval.value == pytest.approx(3.4 if gain < 2 else 16, abs=0.2)
    assert statements[0].interval.value == pytest.approx(gain, rel=0.1)
    assert "cm before any hit" in statements[0].note
    assert "8 stand-in rigs" in statements[0].note


def test_the_figures_show_their_tables(tmp_path, assert_drawn):
    drawing = a1_acting.draw(acting_folders(tmp_path, 1.5), FIGURE)
    assert_drawn(drawing, "A1-hockey-acting")
    assert set(drawing.table["chooser"]) == {"oracle", *s12.CHOOSERS}
    exploration_table().to_parquet(tmp_path / "exploration.parquet")
    drawing = a2_exploration.draw({"exploration": tmp_path}, FIGURE)
    assert_drawn(drawing, "A2-hockey-exploration")
    assert "stand-in" in drawing.figure.axes[0].get_title(loc="left")


@pytest.fixture
def assert_drawn():
    def check(drawing, name):
        assert drawing.name == name
        drawing.figure.canvas.draw()
        numbers = drawing.table.select_dtypes("number").to_numpy()
        assert np.isfinite(numbers).all()

    return check
