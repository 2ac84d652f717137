"""The shared face of the methods: its loops, its loss, and how a method is found and configured."""

from dataclasses import dataclass, fields

import pytest
import torch
from slapshot.adaptation.kalman import Kalman
from slapshot.adaptation.maml import Maml
from slapshot.adaptation.method import AdaptationMethod, Sizes, load_method
from slapshot.adaptation.names import method_file
from slapshot.errors import InputError
from slapshot.validation import Model, validated
from torch import Tensor, nn

SIZES = Sizes(state=2, action=3, outcome=2)


@dataclass(frozen=True)
class SumBelief:
    total: Tensor  # (M, B, do)
    count: int


class SumSettings(Model):
    scale: float


class RunningSum(AdaptationMethod[SumBelief]):
    """Predicts the sum of what it has observed: every prediction is known in advance."""

    Settings = SumSettings

    def __init__(self, sizes, settings, models, generator):
        super().__init__(sizes, settings, models, generator)
        self.offset = nn.Parameter(torch.zeros(models, 1, 1, sizes.outcome))
        self.fixed = nn.Parameter(torch.zeros(models, 4), requires_grad=False)

    def prior(self, tasks):
        return SumBelief(torch.zeros(self.models, tasks, self.sizes.outcome), 0)

    def update(self, belief, state, action, observed):
        return SumBelief(belief.total + observed, belief.count + 1)

    def predict(self, belief, state, action):
        return belief.total[:, :, None] + self.offset + 0 * state[..., :1] * action[..., :1]

    def hidden(self, belief):
        return belief.total


@pytest.fixture(autouse=True)
def one_thread():
    """Tensors this small only wait for a second thread, very long where another process has it."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture
def method() -> RunningSum:
    return RunningSum(SIZES, SumSettings(scale=1.0), 2, torch.Generator())


@pytest.fixture
def data() -> tuple[Tensor, Tensor, Tensor]:
    generator = torch.Generator().manual_seed(0)
    sizes = (SIZES.state, SIZES.action, SIZES.outcome)
    # Small integers: float32 sums of them are exact.
    state, action, observed = (torch.randint(-9, 9, (2, 4, 6, d), generator=generator).float() for d in sizes)
    return state, action, observed


def test_predictions_use_earlier_samples_only(method, data):
    predictions = method.sequence_predictions(*data)
    expected = data[2].cumsum(2) - data[2]
    assert torch.equal(predictions, expected)


def test_adapt_returns_the_belief_after_each_number_of_samples(method, data):
    beliefs = method.adapt(*data)
    assert [belief.count for belief in beliefs] == list(range(7))
    assert torch.equal(method.hidden(beliefs[0]), torch.zeros(2, 4, 2))
    for n in range(1, 7):
        assert torch.equal(method.hidden(beliefs[n]), data[2][:, :, :n].sum(2))


def test_loss_is_the_squared_error_of_all_predictions_summed_over_models():
    predictions = torch.zeros(2, 3, 4, 2)
    outcome = torch.zeros(2, 3, 4, 2)
    outcome[0, 1, 0, 0] = 6.0  # an error of the prior's prediction counts: 36 / (3 * 4 * 2)
    outcome[1, :, 3] = 2.0  # and one of the last: 4 * 6 / 24
    losses = AdaptationMethod.model_losses(predictions, outcome)
    assert losses.tolist() == [1.5, 1.0]
    assert AdaptationMethod.sequence_loss(predictions, outcome) == 2.5


def test_gradient_of_a_model_does_not_depend_on_their_number(data):
    def gradient(models: int) -> Tensor:
        method = RunningSum(SIZES, SumSettings(scale=1.0), models, torch.Generator())
        parts = tuple(x[:models] for x in data)
        method.sequence_loss(method.sequence_predictions(*parts), parts[2]).backward()
        assert method.offset.grad is not None
        return method.offset.grad[0]

    torch.testing.assert_close(gradient(1), gradient(2))
    assert gradient(1).abs().min() > 0


def test_parameter_count_is_per_model_and_counts_trained_ones(method):
    assert method.parameter_count() == SIZES.outcome


def test_interface_cannot_be_instantiated():
    with pytest.raises(TypeError, match="abstract"):
        AdaptationMethod(SIZES, None, 1, torch.Generator())


def test_load_method_finds_a_file_by_its_name():
    assert load_method("kalman") is Kalman


def test_what_follows_an_underscore_tells_methods_of_one_file_apart():
    assert [method_file(name) for name in ("maml", "maml_8", "maml_8_long")] == ["maml"] * 3
    assert load_method("maml_8") is load_method("maml_1") is Maml


@pytest.mark.parametrize("name", ["nonsense", "layers", "method", "../kalman", "", "_kalman"])
def test_load_method_names_what_exists(name):
    with pytest.raises(InputError, match=r"there are: .*\bkalman\b") as caught:
        load_method(name)
    assert "layers" not in str(caught.value).split("there are:")[1]


# --- the contract of every method -----------------------------------------------------------------

CONFIGURATIONS = {
    "kalman": {"latent": 4, "hidden": [16, 16], "drift": 1e-3},
    "lstm": {"state": 12, "hidden": [16]},
    "maml_1": {"hidden": [16, 16], "batch": 1, "steps": 3, "step_size": 0.1},
}
every_method = pytest.mark.parametrize("name", CONFIGURATIONS)
# MAML adapts without end in an evaluation, but stops after some steps in training.
both_modes = pytest.mark.parametrize("training", [True, False], ids=["train", "eval"])


def build(name: str, models: int = 2, seed: int = 0) -> AdaptationMethod:
    generator = torch.Generator().manual_seed(seed)
    kind = load_method(name)
    return kind(SIZES, validated(kind.Settings, CONFIGURATIONS[name], name), models, generator)


def draw(models: int, tasks: int, samples: int, dtype=torch.float64) -> tuple[Tensor, ...]:
    generator = torch.Generator().manual_seed(1)
    return tuple(
        torch.randn(models, tasks, samples, d, generator=generator, dtype=dtype)
        for d in (SIZES.state, SIZES.action, SIZES.outcome)
    )


def train(method: AdaptationMethod, data: tuple[Tensor, ...]) -> None:
    optimiser = torch.optim.SGD(method.parameters(), lr=0.1)
    for _ in range(10):
        optimiser.zero_grad()
        method.sequence_loss(method.sequence_predictions(*data), data[2]).backward()
        optimiser.step()


@every_method
def test_parameters_depend_on_the_generator_only(name):
    before = torch.get_rng_state()
    first = build(name, seed=1).state_dict()
    assert torch.equal(before, torch.get_rng_state())
    torch.rand(3)
    again, other = build(name, seed=1).state_dict(), build(name, seed=2).state_dict()
    assert all(torch.equal(value, again[key]) for key, value in first.items())
    assert any(not torch.equal(value, other[key]) for key, value in first.items())


@every_method
def test_shapes(name):
    method = build(name)
    state, action, observed = draw(2, 3, 6, torch.float32)
    beliefs = method.adapt(state, action, observed)
    assert len(beliefs) == 7
    hidden = torch.stack([method.hidden(belief) for belief in beliefs])
    assert hidden.shape[:3] == (7, 2, 3)
    assert torch.isfinite(hidden).all()
    assert method.predict(beliefs[3], state[:, :, :5], action[:, :, :5]).shape == (2, 3, 5, 2)
    assert method.sequence_predictions(state, action, observed).shape == (2, 3, 6, 2)
    assert all(p.shape[0] == 2 for p in method.parameters())


@every_method
@both_modes
def test_fast_loops_agree_with_the_plain_ones(name, training):
    method, data = build(name).double().train(training), draw(2, 3, 6)
    plain = AdaptationMethod.sequence_predictions(method, *data)
    # The same numbers in another order: float64 rounding of six well-conditioned steps.
    torch.testing.assert_close(method.sequence_predictions(*data), plain, rtol=0, atol=1e-12)
    beliefs = zip(method.adapt(*data), AdaptationMethod.adapt(method, *data), strict=True)
    for fast, slow in beliefs:
        for field in fields(fast):
            a, b = getattr(fast, field.name), getattr(slow, field.name)
            torch.testing.assert_close(a, b, rtol=0, atol=1e-12)


@every_method
@pytest.mark.parametrize("plain", [False, True])
def test_prediction_uses_earlier_observations_only(name, plain):
    method = build(name).eval()
    owner = AdaptationMethod if plain else type(method)
    state, action, observed = draw(2, 3, 6, torch.float32)
    before = owner.sequence_predictions(method, state, action, observed)
    for i in range(6):
        changed = observed.clone()
        changed[:, :, i] += 1.0
        after = owner.sequence_predictions(method, state, action, changed)
        # The same operations on the same numbers: equal to the last bit.
        assert torch.equal(after[:, :, : i + 1], before[:, :, : i + 1])
        # And not by ignoring the data: every later prediction moves.
        assert (after[:, :, i + 1 :] != before[:, :, i + 1 :]).any(-1).all()


@every_method
def test_first_prediction_is_the_priors(name):
    method = build(name)
    state, action, observed = draw(2, 3, 1, torch.float32)
    first = method.sequence_predictions(state, action, observed)
    torch.testing.assert_close(first, method.predict(method.prior(3), state, action))


@every_method
def test_gradients_of_the_models_do_not_mix(name):
    method, data = build(name), draw(2, 3, 5, torch.float32)
    method.model_losses(method.sequence_predictions(*data), data[2])[0].backward()
    for key, parameter in method.named_parameters():
        assert parameter.grad is not None
        assert (parameter.grad[0] != 0).any(), key
        assert (parameter.grad[1] == 0).all(), key


@every_method
def test_training_together_equals_training_alone(name):
    together = build(name, models=3).double()
    start = {key: p.detach().clone() for key, p in together.named_parameters()}
    data = draw(3, 4, 6)
    train(together, data)
    trained = dict(together.named_parameters())
    for m in range(3):
        alone = build(name, models=1, seed=9).double()
        alone.load_state_dict({key: p[m : m + 1] for key, p in start.items()})
        train(alone, tuple(x[m : m + 1] for x in data))
        for key, parameter in alone.named_parameters():
            assert not torch.equal(parameter[0], start[key][m]), key
            # Ten smooth steps in float64: rounding of 1e-16 grows to at most some 1e-13.
            torch.testing.assert_close(parameter[0], trained[key][m], rtol=0, atol=1e-11)
