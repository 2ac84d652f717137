"""The MAML method: its low-rank steps against closed forms and against weights that are really changed."""

import itertools

import pytest
import torch
from pydantic import ValidationError
from slapshot.adaptation import maml
from slapshot.adaptation.maml import Maml
from slapshot.adaptation.method import AdaptationMethod, Sizes
from slapshot.config.methods import MamlSettings
from torch import Tensor
from torch.nn import functional

SIZES = Sizes(state=2, action=3, outcome=2)
M, B, N = 2, 3, 11
STEP = 0.3  # large, so that what is compared has moved far from theta_0
both_modes = pytest.mark.parametrize("training", [True, False], ids=["train", "eval"])
batches = pytest.mark.parametrize("batch", [1, 3])


@pytest.fixture(autouse=True)
def one_thread():
    """Tensors this small only wait for a second thread, very long where another process has it."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def build(batch: int, training: bool, hidden: tuple[int, ...] = (7, 6), steps: int = 2) -> Maml:
    # Without hidden layers too, which a configuration may not ask for.
    settings = MamlSettings.model_construct(hidden=hidden, batch=batch, steps=steps, step_size=STEP)
    return Maml(SIZES, settings, M, torch.Generator().manual_seed(0)).double().train(training)


def draw(samples: int = N) -> tuple[Tensor, Tensor, Tensor]:
    g = torch.Generator().manual_seed(1)
    state, action, observed = (
        torch.randn(M, B, samples, d, generator=g, dtype=torch.float64)
        for d in (SIZES.state, SIZES.action, SIZES.outcome)
    )
    return state, action, observed


def test_steps_of_a_linear_model_are_the_closed_form():
    """Without hidden layers y = x W + b, and the gradient is 2 / (k do) x' (y - s~') summed over k."""
    k = 3
    method, data = build(k, training=False, hidden=()), draw(2 * k + 1)
    with torch.no_grad():
        predictions = method.sequence_predictions(*data)
        belief = method.adapt(*data)[-1]
    x, observed = torch.cat(data[:2], dim=-1), data[2]
    W_0, b_0 = method.network.weights[0].detach(), method.network.biases[0][:, 0].detach()
    for m, b in itertools.product(range(M), range(B)):
        W, bias, alpha = W_0[m], b_0[m], method.log_step_size[m].exp().detach()
        for t in range(3):
            batch = slice(t * k, (t + 1) * k)
            X, predicted = x[m, b, batch], x[m, b, batch] @ W + bias
            # Sums of some ten float64 products of order 1.
            torch.testing.assert_close(predictions[m, b, batch], predicted, rtol=0, atol=1e-13)
            if t < 2:
                error = predicted - observed[m, b, batch]
                W = W - alpha * 2 / (k * SIZES.outcome) * X.mT @ error
                bias = bias - alpha * 2 / (k * SIZES.outcome) * error.sum(0)
        torch.testing.assert_close(method.hidden(belief)[m, b], bias - b_0[m], rtol=0, atol=1e-13)


def plain_maml(method: Maml, data: tuple[Tensor, Tensor, Tensor]) -> Tensor:
    """Sequence predictions of the same thetas, task by task, with weights that are really changed."""
    settings = method.settings
    predictions = data[2].new_empty(data[2].shape)
    for m in range(M):
        network = zip(method.network.weights, method.network.biases, strict=True)
        theta_0 = [parameter[m] for layer in network for parameter in layer]
        alpha = method.log_step_size[m].exp()

        def predict(theta: list[Tensor], x: Tensor) -> Tensor:
            for layer in range(0, len(theta), 2):
                x = functional.silu(x) if layer else x
                x = x @ theta[layer] + theta[layer + 1]
            return x

        for b in range(B):
            theta, steps = theta_0, 0
            x, observed = torch.cat([data[0][m, b], data[1][m, b]], dim=-1), data[2][m, b]
            for i in range(N):
                if i and i % settings.batch == 0 and (steps < settings.steps or not method.training):
                    batch = slice(i - settings.batch, i)
                    loss = functional.mse_loss(predict(theta, x[batch]), observed[batch])
                    gradient = torch.autograd.grad(loss, theta, create_graph=True)
                    norm = torch.cat([g.flatten() for g in gradient]).norm()
                    step = alpha * (maml.LARGEST_GRADIENT / norm).clamp(max=1.0)
                    theta = [p - step * g for p, g in zip(theta, gradient, strict=True)]
                    steps += 1
                predictions[m, b, i] = predict(theta, x[i : i + 1])[0]
    return predictions


@both_modes
@batches
@pytest.mark.parametrize("largest_gradient", [0.5, 1e9], ids=["clipped", "free"])
def test_low_rank_steps_equal_changed_weights(batch, training, largest_gradient, monkeypatch):
    """Predictions, and the outer gradient through all inner steps; two other ways to the same numbers."""
    monkeypatch.setattr(maml, "LARGEST_GRADIENT", largest_gradient)
    method, data = build(batch, training), draw()
    target = draw()[2].flip(2)
    results = []
    ways = (
        lambda: plain_maml(method, data),
        lambda: method.sequence_predictions(*data),
        lambda: AdaptationMethod.sequence_predictions(method, *data),
    )
    for way in ways:
        method.zero_grad()
        predictions = way()
        method.sequence_loss(predictions, target).backward()
        results.append((predictions.detach(), {key: p.grad for key, p in method.named_parameters()}))
    expected, gradients = results[0]
    for predictions, found in results[1:]:
        # At most ten steps of well-conditioned float64 sums.
        torch.testing.assert_close(predictions, expected, rtol=0, atol=1e-12)
        for key, gradient in gradients.items():
            assert gradient.abs().max() > 0, key
            scale = gradient.abs().max().item()
            torch.testing.assert_close(found[key], gradient, rtol=0, atol=1e-11 * scale, msg=key)


@both_modes
@batches
def test_beliefs_of_the_fast_loop_are_those_of_single_updates(batch, training):
    method, data = build(batch, training), draw()
    beliefs = zip(method.adapt(*data), AdaptationMethod.adapt(method, *data), strict=True)
    for i, (fast, plain) in enumerate(beliefs):
        used = min(i, 2 * batch) if training else i
        assert plain.moves[0].shape[2] == used - used % batch
        assert plain.waiting.shape[2] == used % batch
        for a, b in zip(
            (*fast.inputs, *fast.moves, fast.waiting),
            (*plain.inputs, *plain.moves, plain.waiting),
            strict=True,
        ):
            torch.testing.assert_close(a, b, rtol=0, atol=1e-12)


def test_an_incomplete_batch_changes_no_prediction():
    method, (state, action, observed) = build(4, training=False), draw()
    with torch.no_grad():
        beliefs = method.adapt(state, action, observed)
        after = [method.predict(belief, state, action) for belief in beliefs]
    for i in range(1, N + 1):
        assert torch.equal(after[i], after[i - 1]) is (i % 4 != 0)


def test_training_stops_after_its_steps_and_an_evaluation_goes_on():
    data = draw()
    for training, moving in ((True, 2 * 3), (False, 3 * 3)):
        method = build(3, training)
        with torch.no_grad():
            hidden = [method.hidden(belief) for belief in method.adapt(*data)]
        moved = [i for i in range(1, N + 1) if not torch.equal(hidden[i], hidden[i - 1])]
        assert moved == list(range(3, moving + 1, 3))


def test_a_step_lowers_the_error_on_its_batch():
    method, data = build(N, training=True), draw()
    with torch.no_grad():
        prior, *_, last = method.adapt(*data)
        before, after = (
            (method.predict(belief, *data[:2]) - data[2]).square().mean((2, 3)) for belief in (prior, last)
        )
    assert (after < before).all()


def test_no_inner_loop_diverges():
    """Steps far too large, on samples that float32 could square only once or twice, for very long."""
    method, (state, action, observed) = build(1, training=False).float(), draw(200)
    method.log_step_size.data.fill_(3.0)
    data = [1e3 * x.float() for x in (state, action, observed)]
    predictions = method.sequence_predictions(*data)
    assert torch.isfinite(predictions).all()


@pytest.mark.parametrize("wrong", [{"hidden": (8, 0)}, {"batch": 0}, {"steps": 0}, {"step_size": 0.0}])
def test_impossible_settings_are_refused(wrong):
    with pytest.raises(ValidationError):
        MamlSettings(**({"hidden": (8,), "batch": 1, "steps": 3, "step_size": 0.1} | wrong))


def test_parameter_count():
    # Weights and biases of 5 -> 7 -> 6 -> 2, and the step size.
    assert build(1, True).parameter_count() == 6 * 7 + 8 * 6 + 7 * 2 + 1
