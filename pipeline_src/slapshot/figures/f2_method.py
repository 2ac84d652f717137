"""F2: the architecture, drawn from the shapes of the code's tensors (paper, figure 2).

The method is built from the configuration, and the shapes of its parameters and outputs are shown; only the
layout is defined here.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import torch
from matplotlib.axes import Axes
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

from slapshot.adaptation.kalman import Kalman
from slapshot.adaptation.layers import StackedMLP
from slapshot.adaptation.method import Sizes
from slapshot.config.results import MethodFigureSettings
from slapshot.plotting import Drawing

# The paper's colours of the three parts: line and fill.
MEASUREMENT, INTEGRATION, PREDICTION = "measurement", "integration", "prediction"
_COLOURS = {
    MEASUREMENT: ("#00785A", "#E3F3EC", "#A9DCC8"),
    INTEGRATION: ("#B57A00", "#FDF3DC", "#F8D98C"),
    PREDICTION: ("#005A8E", "#E2EFF7", "#A6CDE6"),
}
_MODULES = {"measurement_net": MEASUREMENT, "prediction_net": PREDICTION}
_ACTIVATIONS = {"relu": "ReLU", "silu": "SiLU"}
_INK = "#333333"

# Inches, the origin in the lower left corner.
_SIZE = (10.6, 4.3)
_BOTTOM, _TOP = 0.66, 4.2  # of the panels
_AXIS = 2.45  # height at which the parts are joined
_PANELS = {MEASUREMENT: (0.98, 2.1), INTEGRATION: (3.86, 3.0), PREDICTION: (7.66, 2.05)}  # left, width
_TALLEST = 2.12  # the widest layer; the others' heights go with the logarithm of their widths
_DIGIT = 0.09  # width of a digit
_CHIP = (0.5, 0.32)  # width, height of a box that names one tensor


@dataclass(frozen=True)
class Shapes:
    """Shapes of a method's parameters and of the tensors between its parts.

    Attributes:
        parameters: part, layer, shape, parameters; one row a trained tensor of one model.
        signals: name -> shape of what flows along an arrow, for one task.
        widths: part -> widths of its network's layers, input and output included.
        activation: kind of the networks' layers, in words.
        drift: epsilon of Q = epsilon I.
    """

    parameters: pd.DataFrame
    signals: dict[str, tuple[int, ...]]
    widths: dict[str, list[int]]
    activation: str
    drift: float

    @classmethod
    def of(cls, method: Kalman) -> "Shapes":
        """Collect the shapes of parameters, and of the outputs of one step on zeros."""
        rows = []
        for name, value in method.named_parameters():
            # prediction_net.weights.0 of a network, prior_mean of the filter
            module, *layer = name.split(".")
            rows.append(
                {
                    "part": _MODULES.get(module, INTEGRATION),
                    "layer": f"layer {int(layer[1]) + 1} {layer[0]}" if layer else name,
                    "shape": _times(value.shape[1:], " x "),
                    "parameters": value[0].numel(),
                }
            )
        sizes = method.sizes
        state, action, observed = (torch.zeros(1, 1, n) for n in (sizes.state, sizes.action, sizes.outcome))
        belief = method.prior(1)
        with torch.no_grad():
            mean, factor = method.measure(state, action, observed)
            predicted = method.predict(belief, state[:, :, None], action[:, :, None])[:, :, 0]
        signals = {
            "state": state, "action": action, "observed": observed, "mu_z": mean, "Sigma_z": factor,
            "L": factor[..., *torch.tril_indices(*factor.shape[-2:])],
            "mu_phi": belief.mean, "Sigma_phi": belief.covariance, "predicted": predicted,
        }  # fmt: skip
        return cls(
            pd.DataFrame(rows),
            {name: tuple(value.shape[2:]) for name, value in signals.items()},
            {part: _widths(getattr(method, module)) for module, part in _MODULES.items()},
            f"fully connected, {_ACTIVATIONS[method.prediction_net.activation.__name__]}",
            method.settings.drift,
        )

    def count(self, part: str) -> int:
        """Number of trained parameters of one part of one model."""
        return int(self.parameters.loc[self.parameters["part"] == part, "parameters"].sum())

    def table(self) -> pd.DataFrame:
        """All numbers of the picture; signals and settings have no trained parameters."""
        signals = [
            {"part": "signal", "layer": name, "shape": _times(shape, " x "), "parameters": 0}
            for name, shape in self.signals.items()
        ]
        drift = {"part": "setting", "layer": "drift", "parameters": 0, "value": self.drift}
        return pd.concat([self.parameters, pd.DataFrame([*signals, drift])], ignore_index=True)


def _widths(net: StackedMLP) -> list[int]:
    return [weight.shape[1] for weight in net.weights] + [net.weights[-1].shape[2]]


def _times(shape: tuple[int, ...], sign: str = "×") -> str:
    return sign.join(str(n) for n in shape)


Settings = MethodFigureSettings


def draw(inputs: Mapping[str, Path], settings: MethodFigureSettings) -> Drawing:
    """Measurement network, Kalman filter, prediction network, and what passes between them."""
    generator = torch.Generator().manual_seed(0)  # of weights that are not shown
    method = Kalman(Sizes(**settings.sizes.model_dump()), settings.kalman, 1, generator)
    shapes = Shapes.of(method)
    figure = plt.figure(figsize=_SIZE)
    figure.set_layout_engine("none")
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, _SIZE[0]), ylim=(0, _SIZE[1]))
    axes.axis("off")
    _measurement(axes, shapes)
    _integration(axes, shapes)
    _prediction(axes, shapes)
    total = sum(shapes.count(part) for part in _COLOURS)
    notes = (
        rf"{total:,} parameters, trained end to end on $(\hat{{s}}^{{\,\prime}} - s')^2$",
        rf"$\Sigma_z^{{-1}} = L L^\top$, {_times(shapes.signals['L'])} entries of $L$",
        "numbers: widths of layers, sizes of tensors",
    )
    _text(axes, _SIZE[0] / 2, 0.32, "      ·      ".join(notes))
    return Drawing(f"F2-{settings.domain}-method", figure, shapes.table())


def _measurement(axes: Axes, shapes: Shapes) -> None:
    """Sample, measurement network, and its Gaussian on the way to the filter."""
    slabs = _network(
        axes,
        MEASUREMENT,
        shapes,
        "Measurement network",
        r"$\mu_z,\ \Sigma_z = f^m(s_i, a_i, \tilde{s}_i^{\,\prime})$",
    )
    for name, symbol, offset in (
        ("state", "$s_i$", 0.44),
        ("action", "$a_i$", 0.0),
        ("observed", r"$\tilde{s}_i^{\,\prime}$", -0.44),
    ):
        _source(axes, 0.1, _AXIS + offset, symbol, shapes.signals[name], slabs[0])
    _text(axes, 0.1 + _CHIP[0] / 2, _AXIS + 0.76, "sample $i$")
    end = _PANELS[INTEGRATION][0] + 0.14
    for symbol, name, offset in ((r"$\mu_z$", "mu_z", 0.28), (r"$\Sigma_z$", "Sigma_z", -0.28)):
        _arrow(axes, (slabs[1], _AXIS + offset), (end, _AXIS + offset))
        middle = (sum(_PANELS[MEASUREMENT]) + _PANELS[INTEGRATION][0]) / 2
        _text(axes, middle, _AXIS + offset + 0.12, f"{symbol}  {_times(shapes.signals[name])}")


def _integration(axes: Axes, shapes: Shapes) -> None:
    """Drift and update of the belief, which returns for the next sample."""
    left, _ = _panel(
        axes, INTEGRATION, shapes, "State integration", "Kalman filter, recurrent over the samples",
        rf"$A = I,\ \ Q = \epsilon I,\ \ \epsilon = {shapes.drift:g}$",
    )  # fmt: skip
    left, width = left + 0.14, 1.98
    top, belief = _AXIS + 0.98, left + width + 0.2
    _box(axes, (left, _AXIS - 0.5), (width, 1.0), INTEGRATION)
    for offset, equation in (
        (0.3, r"$K = P C_z^\top (C_z P C_z^\top + \Sigma_z)^{-1}$"),
        (0.0, r"$\mu_\phi \leftarrow \mu_\phi + K (\mu_z - C_z \mu_\phi)$"),
        (-0.3, r"$\Sigma_\phi \leftarrow (I - K C_z) P$"),
    ):
        _text(axes, left + width / 2, _AXIS + offset, equation)
    _box(axes, (left + 0.92, top - 0.17), (width - 0.92, 0.34), INTEGRATION)
    _text(axes, left + 0.92 + (width - 0.92) / 2, top, r"$P = \Sigma_\phi + Q$")
    _arrow(axes, (left + 1.45, top - 0.17), (left + 1.45, _AXIS + 0.5))
    _box(axes, (left, top - 0.17), (0.72, 0.34), None)
    _text(axes, left + 0.36, top, r"$\mu_\phi^0,\ \Sigma_\phi^0$")
    _arrow(axes, (left + 0.72, top), (left + 0.92, top))
    _text(axes, left + 0.36, top - 0.28, "learned prior", size=7.5)
    _box(axes, (left + width / 2 - 0.45, _AXIS - 1.1), (0.9, 0.34), None)
    _text(axes, left + width / 2, _AXIS - 0.93, f"$C_z$  {_shape_of(shapes, 'C')}")
    _text(axes, left + width / 2 + 0.72, _AXIS - 0.93, "learned", size=7.5)
    _arrow(axes, (left + width / 2, _AXIS - 0.76), (left + width / 2, _AXIS - 0.5))
    _box(axes, (belief, _AXIS - 0.42), (0.56, 0.84), INTEGRATION)
    x = belief + 0.28
    for offset, text in ((0.26, r"$\mu_\phi$"), (-0.1, r"$\Sigma_\phi$")):
        name = "mu_phi" if offset > 0 else "Sigma_phi"
        _text(axes, x, _AXIS + offset, text)
        _text(axes, x, _AXIS + offset - 0.17, _times(shapes.signals[name]), size=7.5)
    _text(axes, x, _AXIS - 0.56, "belief", size=7.5)
    _arrow(axes, (left + width, _AXIS), (belief, _AXIS))
    axes.plot([x, x], [_AXIS + 0.42, top], color=_INK, lw=1.1, solid_capstyle="butt")
    _arrow(axes, (x, top), (left + width, top))
    _text(axes, x, top + 0.13, "next sample", size=7.5)


def _prediction(axes: Axes, shapes: Shapes) -> None:
    """Prediction network at the mean of the belief, for the next state and action."""
    slabs = _network(
        axes, PREDICTION, shapes, "Prediction network",
        r"$\hat{s}_{i+1}^{\,\prime} = f^p(s_{i+1}, a_{i+1}, \mu_\phi)$",
    )  # fmt: skip
    start = sum(_PANELS[INTEGRATION])
    _arrow(axes, (start - 0.12, _AXIS + 0.32), (slabs[0], _AXIS + 0.32))
    _text(
        axes,
        (start + _PANELS[PREDICTION][0]) / 2,
        _AXIS + 0.44,
        rf"$\mu_\phi$  {_times(shapes.signals['mu_phi'])}",
    )
    for name, symbol, offset in (("state", "$s_{i+1}$", -0.1), ("action", "$a_{i+1}$", -0.5)):
        _source(axes, start + 0.07, _AXIS + offset, symbol, shapes.signals[name], slabs[0])
    _text(axes, start + 0.07 + _CHIP[0] / 2, _AXIS - 0.8, "query")
    _arrow(axes, (slabs[1], _AXIS), (_SIZE[0] - 0.1 - _CHIP[0], _AXIS))
    _box(axes, (_SIZE[0] - 0.1 - _CHIP[0], _AXIS - _CHIP[1] / 2), _CHIP, None)
    _text(axes, _SIZE[0] - 0.1 - _CHIP[0] / 2, _AXIS, r"$\hat{s}_{i+1}^{\,\prime}$")
    _text(axes, sum(_PANELS[PREDICTION]) + 0.1, _AXIS + 0.12, _times(shapes.signals["predicted"]), size=7.5)


def _network(axes: Axes, part: str, shapes: Shapes, title: str, formula: str) -> tuple[float, float]:
    """A panel with a slab for each layer; returns where the first begins and the last ends."""
    left, width = _panel(axes, part, shapes, title, shapes.activation, formula)
    widths = shapes.widths[part]
    pitch = (width - 0.3) / len(widths)
    slab = min(0.32, 0.7 * pitch)
    widest = max(n for layers in shapes.widths.values() for n in layers)
    starts = [left + 0.15 + pitch * i + (pitch - slab) / 2 for i in range(len(widths))]
    for i, (x, n) in enumerate(zip(starts, widths, strict=True)):
        height = _TALLEST * (0.4 + 0.6 * np.log(n) / np.log(widest))
        _box(axes, (x, _AXIS - height / 2), (slab, height), part)
        _text(axes, x + slab / 2, _AXIS, str(n), rotation=90 if _DIGIT * len(str(n)) > slab else 0)
        if i:
            _arrow(axes, (starts[i - 1] + slab, _AXIS), (x, _AXIS))
    return starts[0], starts[-1] + slab


def _panel(axes: Axes, part: str, shapes: Shapes, title: str, kind: str, formula: str) -> tuple[float, float]:
    """The area of a part with its title, equation and number of parameters; returns left, width."""
    line, fill, _ = _COLOURS[part]
    left, width = _PANELS[part]
    _box(axes, (left, _BOTTOM), (width, _TOP - _BOTTOM), None, face=fill, edge=line, round_by=0.1)
    middle = left + width / 2
    _text(axes, middle, _TOP - 0.2, title, color=line, weight="bold", size=9.5)
    _text(axes, middle, _TOP - 0.42, kind, size=7.5)
    _text(axes, middle, _BOTTOM + 0.44, formula)
    _text(axes, middle, _BOTTOM + 0.18, f"{shapes.count(part):,} parameters", color=line)
    return left, width


def _source(axes: Axes, x: float, y: float, symbol: str, shape: tuple[int, ...], end: float) -> None:
    """A box that names an input, and its arrow with the size above."""
    _box(axes, (x, y - _CHIP[1] / 2), _CHIP, None)
    _text(axes, x + _CHIP[0] / 2, y, symbol)
    _arrow(axes, (x + _CHIP[0], y), (end, y))
    _text(axes, x + _CHIP[0] + 0.13, y + 0.12, _times(shape), size=7.5)


def _box(
    axes: Axes,
    corner: tuple[float, float],
    size: tuple[float, float],
    part: str | None,
    face: str = "white",
    edge: str = _INK,
    round_by: float = 0.05,
) -> None:
    """A rounded box in the colour of its part."""
    if part is not None:
        edge, _, face = _COLOURS[part]
    style = f"round,pad=0,rounding_size={round_by}"
    axes.add_patch(FancyBboxPatch(corner, *size, boxstyle=style, facecolor=face, edgecolor=edge, lw=1))


def _arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float]) -> None:
    style = "-|>,head_length=4,head_width=2"
    axes.add_patch(
        FancyArrowPatch(start, end, arrowstyle=style, color=_INK, lw=1.1, shrinkA=0, shrinkB=0, zorder=3)
    )


def _text(
    axes: Axes, x: float, y: float, text: str, size: float = 8.5, color: str = _INK, **style: Any
) -> None:
    axes.text(x, y, text, ha="center", va="center", fontsize=size, color=color, zorder=4, **style)


def _shape_of(shapes: Shapes, layer: str) -> str:
    return str(shapes.parameters.set_index("layer")["shape"][layer]).replace(" x ", "×")
