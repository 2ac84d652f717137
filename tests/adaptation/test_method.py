"""The shared face of the methods: its loops, its loss, and how a method is found and configured."""

from dataclasses import dataclass

import pytest
import torch
from slapshot.adaptation.kalman import Kalman, KalmanSettings
from slapshot.adaptation.method import AdaptationMethod, Sizes, build_settings, load_method
from slapshot.errors import InputError
from torch import Tensor, nn

SIZES = Sizes(state=2, action=3, outcome=2)


@dataclass(frozen=True)
class SumBelief:
    total: Tensor  # (M, B, do)
    count: int


@dataclass(frozen=True)
class SumSettings:
    widths: tuple[int, ...]
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


@pytest.fixture
def method() -> RunningSum:
    return RunningSum(SIZES, SumSettings((), 1.0), 2, torch.Generator())


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
        method = RunningSum(SIZES, SumSettings((), 1.0), models, torch.Generator())
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


def test_settings_come_from_the_configuration():
    configuration = {"widths": [8, 9], "scale": 0.5}
    assert build_settings(SumSettings, configuration) == SumSettings((8, 9), 0.5)
    method = RunningSum.from_configuration(SIZES, configuration, 3, torch.Generator())
    assert isinstance(method, RunningSum)
    assert (method.settings.widths, method.models, method.sizes) == ((8, 9), 3, SIZES)


@pytest.mark.parametrize(
    ("configuration", "message"),
    [({"widths": [8], "scale": 1, "sclae": 2}, "sclae"), ({"widths": [8]}, "scale")],
)
def test_settings_refuse_unknown_and_missing_keys(configuration, message):
    with pytest.raises(InputError, match=message):
        build_settings(SumSettings, configuration)


def test_load_method_finds_a_file_by_its_name():
    assert load_method("kalman") is Kalman


@pytest.mark.parametrize("name", ["nonsense", "layers", "method", "../kalman", ""])
def test_load_method_names_what_exists(name):
    with pytest.raises(InputError, match=r"there are: .*\bkalman\b") as caught:
        load_method(name)
    assert "layers" not in str(caught.value).split("there are:")[1]


def test_fast_methods_agree_with_the_plain_loops():
    """Contract of the overridable loops, on the method that overrides them."""
    generator = torch.Generator().manual_seed(2)
    kalman = Kalman(SIZES, KalmanSettings(3, (8,), 0.01), 2, generator).double()
    data = tuple(
        torch.randn(2, 4, 6, d, generator=generator, dtype=torch.float64)
        for d in (SIZES.state, SIZES.action, SIZES.outcome)
    )
    # Well-conditioned 3 x 3 algebra, 6 steps: float64 rounding is far below 1e-12.
    torch.testing.assert_close(
        kalman.sequence_predictions(*data),
        AdaptationMethod.sequence_predictions(kalman, *data),
        rtol=0,
        atol=1e-12,
    )
    for fast, plain in zip(kalman.adapt(*data), AdaptationMethod.adapt(kalman, *data), strict=True):
        torch.testing.assert_close(fast.mean, plain.mean, rtol=0, atol=1e-12)
        torch.testing.assert_close(fast.covariance, plain.covariance, rtol=0, atol=1e-12)
