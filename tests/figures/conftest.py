import matplotlib as mpl
import matplotlib.pyplot as plt
import pandas as pd
import pytest
from matplotlib.axes import Axes
from slapshot.plotting import save, use_style


@pytest.fixture(autouse=True)
def style():
    use_style()
    yield
    plt.close("all")


@pytest.fixture
def texts():
    def all_texts(figure):
        found = [t.get_text() for t in figure.findobj(match=lambda o: hasattr(o, "get_text"))]
        return "\n".join(found)

    return all_texts


@pytest.fixture
def panel():
    """Axes of a figure, by the beginning of their left title."""

    def find(figure, title: str) -> Axes:
        found = [
            axes
            for axes in figure.findobj(match=Axes)
            if axes.get_visible() and axes.get_title(loc="left").startswith(title)
        ]
        assert len(found) == 1, title
        return found[0]

    return find


@pytest.fixture
def assert_same_bytes(tmp_path):
    """Draws twice: equal bytes, and a CSV that is the drawing's table."""

    def check(draw) -> None:
        mpl.rcParams["savefig.dpi"] = 40
        for name in ("first", "second"):
            (tmp_path / name).mkdir(exist_ok=True)
            drawing = draw()
            save(drawing, tmp_path / name)
        for suffix in ("png", "pdf", "csv"):
            file = f"{drawing.name}.{suffix}"
            assert (tmp_path / "first" / file).read_bytes() == (tmp_path / "second" / file).read_bytes()
        table = pd.read_csv(tmp_path / "first" / f"{drawing.name}.csv")
        assert list(table) == list(drawing.table)
        assert len(table) == len(drawing.table)

    return check
