"""F2: what it says is what the method is made of."""

import numpy as np
import pytest
import torch
from matplotlib.patches import FancyBboxPatch
from slapshot.adaptation.kalman import Kalman
from slapshot.adaptation.method import Sizes
from slapshot.config.methods import KalmanSettings
from slapshot.config.results import MethodFigureSettings
from slapshot.figures import f2_method
from slapshot.plotting import save, use_style
from slapshot.validation import validated

SIZES = {"state": 2, "action": 3, "outcome": 2}
KALMAN = {"latent": 16, "hidden": [128, 64], "drift": 1e-4}


@pytest.fixture(autouse=True)
def style():
    use_style()


def draw(sizes=SIZES, kalman=KALMAN):
    told = {"module": "any", "domain": "hockey", "sizes": sizes, "kalman": kalman}
    return f2_method.draw({}, validated(MethodFigureSettings, told, "figure"))


def texts(drawing):
    return [t.get_text() for t in drawing.figure.axes[0].texts]


@pytest.mark.parametrize(
    ("sizes", "kalman"),
    [(SIZES, KALMAN), ({"state": 1, "action": 0, "outcome": 1}, {"latent": 2, "hidden": [8], "drift": 0.0})],
)
def test_parameters_of_the_table_are_those_of_the_method(sizes, kalman):
    drawing = draw(sizes, kalman)
    method = Kalman(
        Sizes(**sizes), validated(KalmanSettings, kalman, "kalman"), 3, torch.Generator().manual_seed(0)
    )
    table = drawing.table
    assert table["parameters"].sum() == method.parameter_count()
    trained = table[table["parameters"] > 0]
    products = trained["shape"].map(lambda shape: np.prod([int(n) for n in shape.split(" x ")]))
    assert products.tolist() == trained["parameters"].tolist()
    assert len(trained) == len(list(method.parameters()))


def test_what_is_drawn_is_what_the_table_says():
    drawing = draw()
    seen, table = texts(drawing), drawing.table
    counts = table.groupby("part")["parameters"].sum()
    for part in ("measurement", "integration", "prediction"):
        assert f"{counts[part]:,} parameters" in seen
    assert any(f"{counts.sum():,} parameters" in text for text in seen)
    signals = table[table["part"] == "signal"].set_index("layer")["shape"]
    assert r"$\mu_z$  " + signals["mu_z"] in seen
    assert r"$\Sigma_z$  " + signals["Sigma_z"].replace(" x ", "×") in seen
    assert any(signals["L"] + " entries" in text for text in seen)
    assert signals["L"] == str(16 * 17 // 2)
    for part in ("measurement", "prediction"):
        layers = table[(table["part"] == part) & table["layer"].str.endswith("weights")]["shape"]
        widths = [shape.split(" x ")[0] for shape in layers] + [layers.iloc[-1].split(" x ")[1]]
        assert set(widths) <= set(seen)
    drift = table.set_index("layer").loc["drift", "value"]
    assert any(rf"\epsilon = {drift:g}" in text for text in seen)


@pytest.mark.parametrize("hidden", [[128, 128], [256, 256, 256]])
def test_no_text_runs_into_another_or_off_the_figure(hidden):
    drawing = draw(kalman=KALMAN | {"hidden": hidden})
    figure = drawing.figure
    figure.canvas.draw()
    boxes = [(t.get_text(), t.get_window_extent()) for t in figure.axes[0].texts]
    frames = [patch.get_window_extent() for patch in figure.axes[0].findobj(FancyBboxPatch)]
    for i, (text, box) in enumerate(boxes):
        assert box.x0 >= 0, text
        assert box.x1 <= figure.bbox.width, text
        # A text is in a box or out of it, not across its edge.
        for frame in frames:
            inside = frame.x0 <= box.x0 and box.x1 <= frame.x1 and frame.y0 <= box.y0 and box.y1 <= frame.y1
            assert inside or not box.padded(-1).overlaps(frame), text
        for other, other_box in boxes[:i]:
            # Neighbours may share a pixel row of their generous boxes.
            assert not box.padded(-1).overlaps(other_box.padded(-1)), (text, other)


def test_same_drawing_gives_the_same_bytes(tmp_path):
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        save(draw(), tmp_path / name)
    for suffix in ("png", "pdf", "csv"):
        name = f"F2-hockey-method.{suffix}"
        assert (tmp_path / "first" / name).read_bytes() == (tmp_path / "second" / name).read_bytes()
