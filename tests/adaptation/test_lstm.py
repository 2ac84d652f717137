"""The LSTM method, against the cell of PyTorch."""

from pathlib import Path

import pytest
import torch
from pydantic import ValidationError
from slapshot.adaptation.lstm import Lstm
from slapshot.adaptation.method import Sizes, load_method
from slapshot.config.files import load_config
from slapshot.config.methods import LstmSettings
from torch import nn

ROOT = Path(__file__).parents[2]
SIZES = Sizes(state=2, action=3, outcome=2)
SETTINGS = LstmSettings(state=5, hidden=(8,))
M, B, N = 2, 3, 6


@pytest.fixture(autouse=True)
def one_thread():
    """Tensors this small only wait for a second thread, very long where another process has it."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture
def method() -> Lstm:
    g = torch.Generator().manual_seed(0)
    method = Lstm(SIZES, SETTINGS, M, g).double()
    with torch.no_grad():  # as after some training: a prior that is not zero
        method.prior_h.normal_(generator=g)
        method.prior_c.normal_(generator=g)
    return method


@pytest.fixture
def data() -> list[torch.Tensor]:
    g = torch.Generator().manual_seed(1)
    sizes = (SIZES.state, SIZES.action, SIZES.outcome)
    return [torch.randn(M, B, N, d, generator=g, dtype=torch.float64) for d in sizes]


def test_every_model_is_the_lstm_of_pytorch(method, data):
    beliefs = method.adapt(*data)
    predictions = method.sequence_predictions(*data)
    for m in range(M):
        theirs = nn.LSTM(7, SETTINGS.state, batch_first=True, dtype=torch.float64)
        head = nn.Sequential(
            nn.Linear(10, 8, dtype=torch.float64), nn.SiLU(), nn.Linear(8, 2, dtype=torch.float64)
        )
        copied = {
            theirs.weight_ih_l0: method.input_weight[m].mT,
            theirs.weight_hh_l0: method.recurrent_weight[m].mT,
            theirs.bias_ih_l0: method.bias[m, 0],
            theirs.bias_hh_l0: torch.zeros(20),
            head[0].weight: method.prediction_net.weights[0][m].mT,
            head[0].bias: method.prediction_net.biases[0][m, 0],
            head[2].weight: method.prediction_net.weights[1][m].mT,
            head[2].bias: method.prediction_net.biases[1][m, 0],
        }
        with torch.no_grad():
            for parameter, value in copied.items():
                parameter.copy_(value)
            start = [prior[m].expand(1, B, -1).contiguous() for prior in (method.prior_h, method.prior_c)]
            outputs, (_, c) = theirs(torch.cat([x[m] for x in data], dim=-1), tuple(start))
            h = torch.cat([start[0][0][:, None], outputs], dim=1)  # after 0, ..., N samples
            expected = head(torch.cat([data[0][m], data[1][m], h[:, :-1]], dim=-1))
        # Float64 rounding of six steps whose gates contract.
        for i, belief in enumerate(beliefs):
            torch.testing.assert_close(method.hidden(belief)[m], h[:, i], rtol=0, atol=1e-13)
        torch.testing.assert_close(beliefs[-1].c[m], c[0], rtol=0, atol=1e-13)
        torch.testing.assert_close(predictions[m], expected, rtol=0, atol=1e-13)


def test_forget_gates_start_open():
    bias = Lstm(SIZES, SETTINGS, M, torch.Generator().manual_seed(0)).bias
    gates = bias.unflatten(-1, (4, SETTINGS.state))
    assert (gates[:, :, 1] == 1).all()
    # The others are drawn, within 1 / sqrt(H) of 0.
    others = gates[:, :, [0, 2, 3]]
    assert others.std() > 0
    assert others.abs().max() <= 5**-0.5


@pytest.mark.parametrize("wrong", [{"state": 0}, {"hidden": (8, 0)}])
def test_impossible_settings_are_refused(wrong):
    with pytest.raises(ValidationError):
        LstmSettings(**({"state": 2, "hidden": (8,)} | wrong))


def test_parameter_count(method):
    H = SETTINGS.state
    cell = (7 + H + 1) * 4 * H + 2 * H  # with the prior's h and c
    assert method.parameter_count() == cell + (5 + H + 1) * 8 + (8 + 1) * 2


def test_sizes_of_the_default_methods_are_alike(monkeypatch):
    """Differences between methods are not to be differences of size, as far as whole widths allow."""
    monkeypatch.chdir(ROOT)
    methods = load_config().domains["hockey"].methods
    counts = {}
    for name, settings in methods.items():
        g = torch.Generator().manual_seed(0)
        counts[name] = load_method(name)(SIZES, settings.own, 1, g).parameter_count()
    assert {"kalman", "lstm", "maml_1", "maml_4", "maml_8"} <= set(counts)
    assert counts["lstm"] == pytest.approx(counts["kalman"], rel=0.03)
    # Four layers of 128 are 12 % smaller.
    for maml in ("maml_1", "maml_4", "maml_8"):
        assert counts[maml] == pytest.approx(counts["kalman"], rel=0.15)
