"""Stage `trajectory_model`: train the VAE on the demonstrations and measure its quality."""

import logging
import math

import pandas as pd
import torch

from slapshot.command import Run, stage_command
from slapshot.config.trajectories import TrajectoryModelSettings
from slapshot.parquet import read_table
from slapshot.progress import progress
from slapshot.scenes.scene import Scene
from slapshot.trajectories.vae import TrajectoryVae, VaeSizes

log = logging.getLogger("slapshot")

_HELD_OUT = 10  # every tenth demonstration is held out to measure the quality


def produce(run: Run) -> None:
    """Write the model and quality.csv (measure, dimension, value)."""
    settings = run.settings(TrajectoryModelSettings)
    torch.set_num_threads(1)  # for layers this small, threads cost more time than they save
    scene = Scene.load(run.inputs["scene"])
    column = read_table(run.inputs["demonstrations"] / "demonstrations.parquet")["waypoints"]
    size = column.type.list_size
    flat = torch.from_numpy(column.combine_chunks().flatten().to_numpy().reshape(-1, size).copy())
    joints = scene.info.commands
    sizes = VaeSizes(
        waypoints=flat.shape[1] // joints,
        joints=joints,
        latent=settings.latent,
        hidden=settings.hidden,
        duration=settings.duration_s,
    )
    held_out = torch.arange(len(flat)) % _HELD_OUT == 0
    model = train(flat[~held_out], sizes, settings)
    quality = measure(model, flat[held_out])
    model.save(run.out)
    quality.to_csv(run.out / "quality.csv", index=False, float_format="%.6g")
    for row in quality.itertuples():
        log.info("%s %s: %.4g", row.measure, row.dimension, row.value)


def train(flat: torch.Tensor, sizes: VaeSizes, settings: TrajectoryModelSettings) -> TrajectoryVae:
    """Fit a VAE to flat waypoints (count, waypoints * joints) in rad."""
    generator = torch.Generator().manual_seed(settings.seed)
    with torch.random.fork_rng():
        torch.manual_seed(settings.seed)  # nn.Linear draws from the global generator only
        model = TrajectoryVae(sizes)
    model.set_normalisation(flat)
    optimiser = torch.optim.Adam(model.parameters(), lr=settings.learning_rate)
    steps, batch = settings.steps, min(settings.batch, len(flat))
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, settings.learning_rate, total_steps=steps, pct_start=0.1
    )
    for step in progress(range(steps), steps, "trajectory VAE"):
        # The decoder's variance is annealed: with the final variance from the start the latent space folds.
        share = min(1.0, step / (0.5 * steps))
        noise = settings.noise * math.exp((1 - share) * math.log(30.0))
        rows = torch.randint(len(flat), (batch,), generator=generator)
        reconstruction, divergence = model.loss(flat[rows], noise, generator)
        optimiser.zero_grad()
        # The factor noise^2 keeps the gradient's size as the variance decreases.
        ((reconstruction + divergence) * noise**2).backward()
        optimiser.step()
        schedule.step()
    model.standardise_latent(flat)
    return model.eval()


@torch.no_grad()
def measure(model: TrajectoryVae, flat: torch.Tensor) -> pd.DataFrame:
    """Whether the latent is used and close to a unit Gaussian, on held-out demonstrations.

    kl_nats: information that a dimension carries (0: unused). mean, sd: of the encoder's samples over all
    demonstrations (unit Gaussian: 0 and 1). reconstruction_rms: of the decoded encoder mean, in the unit of
    waypoints.
    """
    mean, log_variance = model.encode(flat)
    information = model.divergence(mean, log_variance).mean(0)
    spread = (mean.var(0) + log_variance.exp().mean(0)).sqrt()
    rows = [("kl_nats", i, float(v)) for i, v in enumerate(information)]
    rows += [("latent_mean", i, float(v)) for i, v in enumerate(mean.mean(0))]
    rows += [("latent_sd", i, float(v)) for i, v in enumerate(spread)]
    residual = (model.decode(mean) - flat).square().mean().sqrt()
    rows.append(("reconstruction_rms", -1, float(residual)))
    return pd.DataFrame(rows, columns=["measure", "dimension", "value"])


if __name__ == "__main__":
    stage_command("trajectory_model", produce)
