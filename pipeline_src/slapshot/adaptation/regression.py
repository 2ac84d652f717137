"""Stage `regression`: the Kalman method on straight lines, where the exact posterior is known (paper, S9).

Section "Linear regression" of the paper: y = w x + b is predicted from a few noisy observations of y.
The Kalman method is used unchanged, with s = x, no action, and s' = y; nothing here has a unit.

The noise is unknown to the model, as in the paper, and a filter's gain does not learn it from the
residuals. The best estimate linear in y depends on the noise through its mean variance only, so it is
that of Bayesian regression with the variance noise_variance_max / 2: a walkthrough at that level can be
compared with the exact posterior. Predictions and loss depend on ratios of Sigma_phi, Sigma_z and Q only;
the width of the belief itself is determined by nothing but its fixed Q.
"""

import copy
import dataclasses
from collections.abc import Callable, Sequence
from typing import NamedTuple

import pandas as pd
import torch
from torch import Tensor

from slapshot.adaptation.checkpoint import save_ensemble
from slapshot.adaptation.data import Batch, Standardiser
from slapshot.adaptation.kalman import Kalman, KalmanBelief
from slapshot.adaptation.method import Sizes
from slapshot.adaptation.optimise import fit
from slapshot.command import Run, stage_command
from slapshot.config.methods import KalmanSettings
from slapshot.config.regression import RegressionSettings, WalkthroughTraining
from slapshot.parquet import write_table

SIZES = Sizes(state=1, action=0, outcome=1)
COUNTS = (0, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
"""Numbers of samples in contraction.parquet."""

# Draws of phi and points in x, for the one task in the figure and for each of the many in the contraction
# table. A standard deviation from n draws has a relative error of 1 / sqrt(2 n): 2 % and 6 %; the latter
# hardly affects ratios, because every belief is sampled with the same random numbers.
_FINE, _COARSE = (2048, 41), (128, 9)


@dataclasses.dataclass(frozen=True)
class Lines:
    """Tasks y = w x + b with w ~ N(0, slope_sd^2), b ~ N(0, intercept_sd^2), x ~ U(-x_range, x_range)."""

    slope_sd: float
    intercept_sd: float
    x_range: float

    def draw(
        self, lead: tuple[int, int], samples: int, noise_variance: Tensor, generator: torch.Generator
    ) -> "Tasks":
        """Draw (M, B) = `lead` tasks with `samples` observations each.

        Args:
            lead: number of models and of tasks.
            samples: N.
            noise_variance: of the observed y, broadcasts against (M, B, N, 1).
            generator: on the CPU.
        """
        spread = torch.tensor([self.slope_sd, self.intercept_sd])
        line = spread * torch.randn(*lead, 2, generator=generator)
        x = self.x_range * (2 * torch.rand(*lead, samples, 1, generator=generator) - 1)
        noise = noise_variance.sqrt() * torch.randn(*lead, samples, 1, generator=generator)
        y = values(line, x)
        return Tasks(line, Batch(x, x[..., :0], y + noise, y))

    def grid(self, points: int) -> Tensor:
        """Evenly spaced x, (points,)."""
        return torch.linspace(-self.x_range, self.x_range, points)


class Tasks(NamedTuple):
    """True (w, b), (M, B, 2), and sequences of samples, (M, B, N, d)."""

    line: Tensor
    batch: Batch


class LineBelief(NamedTuple):
    """Gaussian belief about (w, b): mean (..., 2) and covariance (..., 2, 2)."""

    mean: Tensor
    covariance: Tensor


class Curve(NamedTuple):
    """Predicted y on a grid of x: mean and standard deviation, (..., points)."""

    mean: Tensor
    sd: Tensor


def values(line: Tensor, x: Tensor) -> Tensor:
    """Y = w x + b for (w, b) (..., 2) and x (..., N, 1)."""
    return line[..., None, :1] * x + line[..., None, 1:]


def exact_beliefs(lines: Lines, x: Tensor, observed: Tensor, noise_variance: float) -> LineBelief:
    """Posterior of (w, b) after 0, 1, ..., N samples with known noise variance v.

    Sigma^-1 = Sigma_0^-1 + X'X / v,   mu = Sigma X'y / v,   with rows (x_i, 1) of X.

    Args:
        lines: the prior.
        x: inputs, (..., N, 1).
        observed: noisy y, (..., N, 1).
        noise_variance: v.

    Returns:
        Beliefs (..., N + 1, 2), in float64.
    """
    X = torch.cat([x, torch.ones_like(x)], -1).double()
    precision = torch.tensor([lines.slope_sd, lines.intercept_sd], dtype=torch.float64).pow(-2).diag()
    information = _running(X[..., :, None] * X[..., None, :]) / noise_variance
    covariance = torch.linalg.inv(precision + information)
    moment = _running(X * observed.double()) / noise_variance
    return LineBelief((covariance @ moment[..., None])[..., 0], covariance)


def _running(terms: Tensor) -> Tensor:
    """Sums of the first 0, 1, ..., N terms along the sample dimension, the first after (M, B)."""
    return torch.cat([torch.zeros_like(terms[:, :, :1]), terms.cumsum(2)], 2)


def exact_curve(belief: LineBelief, grid: Tensor) -> Curve:
    """Mean and standard deviation of w x + b, (..., points)."""
    X = torch.stack([grid, torch.ones_like(grid)], -1).double()
    mean = belief.mean @ X.mT
    variance = torch.einsum("pi,...ij,pj->...p", X, belief.covariance, X)
    return Curve(mean, variance.sqrt())


def learned_curve(
    method: Kalman, belief: KalmanBelief, grid: Tensor, draws: int, generator: torch.Generator
) -> Curve:
    """Prediction at the mean of phi, and the spread of y over phi ~ N(mu_phi, Sigma_phi), (M, B, points).

    The paper's shaded area: "one standard deviation in state space projected onto the output domain".
    """
    x = grid[:, None]
    phi = method.sample_phi(belief, draws, generator)[:, :, :, None]
    drawn = method.outcome(phi, x, x[..., :0])[..., 0]
    mean = method.outcome(belief.mean[:, :, None], x, x[..., :0])[..., 0]
    return Curve(mean, drawn.std(2))


def with_drift(method: Kalman, drift: float) -> Kalman:
    """The same weights with another Q = drift I."""
    twin = copy.deepcopy(method)
    twin.settings = method.settings.model_copy(update={"drift": drift})
    return twin


def train(
    lines: Lines, kalman: KalmanSettings, training: WalkthroughTraining, seed: int
) -> tuple[Kalman, pd.DataFrame]:
    """An ensemble trained on lines with noise variances ~ U(0, noise_variance_max) (eq. sigma_s)."""
    generator = torch.Generator().manual_seed(seed)
    lead = (training.models, training.tasks)
    method = Kalman(SIZES, kalman, lead[0], generator)

    def draw() -> Batch:
        variance = training.noise_variance_max * torch.rand(*lead, 1, 1, generator=generator)
        return lines.draw(lead, training.sequence, variance, generator).batch

    losses = fit(method, draw, draw(), training.steps, training.learning_rate, "regression")
    return method.eval(), losses


@torch.no_grad()
def walkthrough(
    method: Kalman,
    lines: Lines,
    tasks: Tasks,
    counts: Sequence[int],
    noise_variance: float,
    generator: torch.Generator,
) -> dict[str, pd.DataFrame]:
    """Tables belief, prediction and observed of one model and one task.

    Args:
        method: an ensemble; model 0 is shown.
        lines: the exact prior.
        tasks: task 0 is shown; it has at least as many samples as the largest count.
        counts: numbers of samples seen.
        noise_variance: of the tasks, known to the exact posterior only.
        generator: draws phi.
    """
    seen, (draws, points) = max(counts), _FINE
    shown, grid = _each(tasks.batch, lambda t: t[:, :1, :seen]), lines.grid(points)
    learned = method.adapt(shown.state, shown.action, shown.observed)
    exact = exact_curve(exact_beliefs(lines, shown.state, shown.observed, noise_variance), grid)
    truth = values(tasks.line, grid[:, None])[0, 0, :, 0]
    latents = range(method.settings.latent)
    beliefs, predictions = [], []
    for n in counts:
        mean, covariance = learned[n].mean[0, 0], learned[n].covariance[0, 0]
        beliefs.append(
            {"samples": n}
            | {f"mean_{i + 1}": mean[i].item() for i in latents}
            | {f"covariance_{i + 1}_{j + 1}": covariance[i, j].item() for i in latents for j in latents}
        )
        curve = learned_curve(method, learned[n], grid, draws, generator)
        columns = {
            "x": grid,
            "true_y": truth,
            "mean_y": curve.mean[0, 0],
            "sd_y": curve.sd[0, 0],
            "exact_mean_y": exact.mean[0, 0, n],
            "exact_sd_y": exact.sd[0, 0, n],
        }
        table = pd.DataFrame({name: column.double().numpy() for name, column in columns.items()})
        predictions.append(table.assign(samples=n))
    columns = {"x": shown.state, "observed_y": shown.observed, "true_y": shown.outcome}
    observed = {name: column[0, 0, :, 0].double().numpy() for name, column in columns.items()}
    return {
        "belief": pd.DataFrame(beliefs),
        "prediction": pd.concat(predictions, ignore_index=True),
        "observed": pd.DataFrame({"sample": range(1, seen + 1), **observed}),
    }


@torch.no_grad()
def contraction(
    method: Kalman, lines: Lines, tasks: Tasks, counts: Sequence[int], noise_variance: float, seed: int
) -> pd.DataFrame:
    """Contraction of belief and prediction with samples (claim C1), by drift, model, task, samples.

    Once with the trained drift and once without drift, with the same weights. Errors are mean squares over
    the grid against the true line, standard deviations of y are means over the grid. Arguments as in
    `walkthrough`; every belief is sampled with the same `seed`, so that ratios vary little.
    """
    draws, points = _COARSE
    batch, grid = tasks.batch, lines.grid(points)
    truth = values(tasks.line, grid[:, None])[..., 0]
    exact = exact_curve(exact_beliefs(lines, batch.state, batch.observed, noise_variance), grid)
    lead = [range(size) for size in batch.state.shape[:2]]
    index = pd.MultiIndex.from_product(lead, names=["model", "task"])
    tables = []
    for drift in dict.fromkeys((method.settings.drift, 0.0)):
        filtered = with_drift(method, drift)
        beliefs = filtered.adapt(batch.state, batch.action, batch.observed)
        for n in counts:
            generator = torch.Generator().manual_seed(seed)
            curve = learned_curve(filtered, beliefs[n], grid, draws, generator)
            eigenvalues = torch.linalg.eigvalsh(beliefs[n].covariance.double())
            columns = {
                "log_determinant": eigenvalues.log().sum(-1),
                "trace": eigenvalues.sum(-1),
                "smallest_eigenvalue": eigenvalues[..., 0],
                "sd_y": curve.sd.mean(-1),
                "exact_sd_y": exact.sd[:, :, n].mean(-1),
                "squared_error": (curve.mean - truth).square().mean(-1),
                "exact_squared_error": (exact.mean[:, :, n] - truth).square().mean(-1),
            }
            table = pd.DataFrame({k: v.double().flatten().numpy() for k, v in columns.items()}, index)
            tables.append(table.reset_index().assign(drift=drift, samples=n))
    return pd.concat(tables, ignore_index=True)


def produce(run: Run) -> None:
    """Write the ensemble, losses.csv, and the tables belief, prediction, observed, contraction."""
    settings = run.settings(RegressionSettings)
    shown = settings.walkthrough
    # Tensors are too small to gain from a second thread.
    torch.set_num_threads(1)
    lines = Lines(settings.slope_sd, settings.intercept_sd, settings.x_range)
    method, losses = train(lines, settings.kalman, settings.training, settings.seed)
    losses.to_csv(run.out / "losses.csv", index=False, float_format="%.6g")
    save_ensemble(run.out, "kalman", method, _as_it_is())

    variance = shown.noise_variance
    # A seed separate from that of training: the tasks stay the same when the training changes. All models
    # see the same tasks.
    generator = torch.Generator().manual_seed(settings.seed + 1)
    drawn = lines.draw((1, settings.tasks), max(COUNTS), torch.tensor(variance), generator)
    every = (method.models, -1, -1)
    tasks = Tasks(drawn.line.expand(every), _each(drawn.batch, lambda t: t.expand(*every, -1)))
    counts = sorted({0, *shown.samples})
    tables = walkthrough(method, lines, tasks, counts, variance, generator)
    tables["contraction"] = contraction(method, lines, tasks, COUNTS, variance, settings.seed)
    for name, table in tables.items():
        write_table(table, run.out / f"{name}.parquet")


def _each(batch: Batch, change: Callable[[Tensor], Tensor]) -> Batch:
    return Batch(*(change(t) for t in (batch.state, batch.action, batch.observed, batch.outcome)))


def _as_it_is() -> Standardiser:
    """Identity standardiser: lines need no scaling, but a saved ensemble needs a standardiser."""
    sizes = dataclasses.asdict(SIZES)
    return Standardiser(
        {k: torch.zeros(n) for k, n in sizes.items()}, {k: torch.ones(n) for k, n in sizes.items()}
    )


if __name__ == "__main__":
    stage_command("regression", produce)
