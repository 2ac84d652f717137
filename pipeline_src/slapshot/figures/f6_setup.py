"""F6: the simulated and the recorded set-up, and the two pucks (paper, figure 6)."""

from collections.abc import Mapping
from pathlib import Path

from slapshot.config.results import SetupFigureSettings

# First: it tells MuJoCo which GL library to use.
from slapshot.json_types import Row

from slapshot.figures.rendering import render  # isort: skip

import matplotlib.pyplot as plt
import mujoco
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from numpy.typing import NDArray

from slapshot.config.trajectories import ScriptedHits
from slapshot.domains.hockey import demonstrate
from slapshot.domains.hockey.demonstrations import CONTACT_AT
from slapshot.domains.hockey.model import PUCKS
from slapshot.plotting import OTHER_COLOURS, STAND_IN, Drawing
from slapshot.recordings.read import read_recording
from slapshot.scenes.scene import Scene
from slapshot.trajectories.motion import Motion

_WAYPOINTS, _DURATION = 17, 0.8
_HEIGHT, _WIDTH = 720, 900
_OBJECT_COLOURS = {"red": "#D62728", "blue": "#1F4FB4"}  # objects that are called by their colour


Settings = SetupFigureSettings


def draw(inputs: Mapping[str, Path], settings: SetupFigureSettings) -> Drawing:
    """Panels (a) the simulated rig just before a hit, (b) what the ceiling camera saw, (c) the pucks."""
    scene = Scene.load(inputs["scene"])
    model = scene.compile()
    data = mujoco.MjData(model)
    data.qpos[scene.layout.arm_q] = _pose_before_contact(scene)
    mujoco.mj_forward(model, data)
    recordings = {role: folder for role, folder in inputs.items() if role != "scene"}

    figure = plt.figure(figsize=(10.2, 3.6))
    ratios = [1.25, 1.25, 0.75] if recordings else [1.25, 0.75]
    axes = figure.subplots(1, len(ratios), width_ratios=ratios)
    _picture(axes[0], render(model, data, "overview", _HEIGHT, _WIDTH), "(a) simulated")
    rows = []
    if recordings:
        role, folder = next(iter(recordings.items()))
        rows = _recorded(axes[1], model, data, folder / "recording", role)
    pucks = _puck_model()
    puck_data = mujoco.MjData(pucks)
    mujoco.mj_forward(pucks, puck_data)
    _picture(axes[-1], render(pucks, puck_data, "close", _HEIGHT, _HEIGHT * 3 // 4),
             f"({'c' if recordings else 'b'}) the two pucks")  # fmt: skip
    for i, (name, puck) in enumerate(PUCKS.items()):
        text = f"{name}\n{2e3 * puck.radius:.1f} × {1e3 * puck.height:.1f} mm\n{1e3 * puck.mass:.0f} g"
        axes[-1].text(0.27 + 0.46 * i, 0.04, text, transform=axes[-1].transAxes, ha="center", fontsize=7)
        rows.append({"item": f"puck {name}", "x_m": 2 * puck.radius, "y_m": 2 * puck.radius,
                     "z_m": puck.height, "mass_kg": puck.mass, "note": puck.source})  # fmt: skip
    return Drawing(f"F6-{settings.domain}-setup", figure, pd.DataFrame(rows))


def _picture(axes: Axes, pixels: NDArray[np.uint8], title: str) -> None:
    axes.imshow(pixels)
    axes.set_title(title, loc="left")
    axes.set_axis_off()


def _pose_before_contact(scene: Scene) -> NDArray[np.float64]:
    task = {"heading": 0.15, "speed": 1.4, "contact_offset": 0.0}
    settings = ScriptedHits(
        heading_rad=task["heading"],
        speed_m_s=[task["speed"], task["speed"]],
        contact_offset_m=task["contact_offset"],
        duration_s=_DURATION,
        waypoints=_WAYPOINTS,
    )
    waypoints = demonstrate(scene, settings, [task])[0]
    assert waypoints is not None  # a hit nearly straight ahead is well within reach
    return Motion.through(waypoints, _DURATION).position(np.array([(CONTACT_AT - 0.12) * _DURATION]))[0]


def _recorded(axes: Axes, model: mujoco.MjModel, data: mujoco.MjData, folder: Path, name: str) -> list[Row]:
    """The ceiling camera's view with recorded rest points over it."""
    recording = read_recording(folder)
    _picture(axes, render(model, data, "ceiling", _HEIGHT, _WIDTH), f"(b) recording “{name}”")
    rows = []
    seen = recording.hits[recording.hits["rest_x"].notna()]
    for (object_id, hits), other in zip(seen.groupby("object_id"), OTHER_COLOURS, strict=False):
        colour = _OBJECT_COLOURS.get(str(object_id), other)
        pixels = _project(model, hits[["rest_x", "rest_y"]].to_numpy(float))
        axes.scatter(pixels[:, 0], pixels[:, 1], s=9, color=colour, edgecolor="black", linewidth=0.3,
                     label=f"{object_id} puck at rest")  # fmt: skip
        rows += [
            {"item": f"{name}: {object_id} at rest", "x_m": x, "y_m": y, "z_m": 0.0, "note": STAND_IN}
            for x, y in hits[["rest_x", "rest_y"]].to_numpy(float)
        ]
    axes.set_xlim(0, _WIDTH)
    axes.set_ylim(_HEIGHT, 0)
    axes.legend(loc="upper right", fontsize=7, frameon=True, framealpha=0.9)
    if recording.stand_in:
        axes.text(0.02, 0.95, STAND_IN, transform=axes.transAxes, fontsize=7, color="#A00000")
    return rows


def _project(model: mujoco.MjModel, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """World x, y (n, 2) on the board to pixels (n, 2) of the ceiling camera, which looks straight down."""
    camera = model.camera("ceiling")
    scale = _HEIGHT / 2 / (np.tan(np.deg2rad(camera.fovy[0]) / 2) * camera.pos[2])
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, camera.quat)
    local = (np.column_stack([points, np.zeros(len(points))]) - camera.pos) @ rotation.reshape(3, 3)
    return np.column_stack([_WIDTH / 2 + scale * local[:, 0], _HEIGHT / 2 - scale * local[:, 1]])


def _puck_model() -> mujoco.MjModel:
    """Both pucks side by side on a white board."""
    geoms = "".join(
        f'<geom type="cylinder" size="{p.radius} {p.height / 2}" rgba="{" ".join(map(str, p.rgba))}" '
        f'pos="{0.055 * (2 * i - 1)} 0 {p.height / 2}"/>'
        for i, p in enumerate(PUCKS.values())
    )
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><visual><headlight ambient=".5 .5 .5" diffuse=".5 .5 .5"/></visual><worldbody>
        <light pos="0.1 -0.3 0.5" dir="-0.2 0.5 -1" diffuse=".5 .5 .5"/>
        <geom type="plane" size="2 2 .1" rgba=".94 .95 .97 1"/>{geoms}
        <camera name="close" pos="0 -0.38 0.27" xyaxes="1 0 0 0 0.58 0.81" fovy="34"/>
        </worldbody></mujoco>"""
    )
