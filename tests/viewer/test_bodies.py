"""Every kind of geom, against MuJoCo's own idea of where it is."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import rerun as rr
from slapshot.scenes.scene import Scene
from slapshot.viewer.bodies import extent, log_shapes

from .conftest import read, values

MJCF = """
<mujoco><asset><mesh name="wedge" vertex="0 0 0  1 0 0  0 1 0  0 0 1" scale=".1 .1 .1"/></asset><worldbody>
<geom name="floor" type="plane" size="9 9 1"/>
<geom name="table" type="box" size="1 .5 .1" pos="2 0 -.1" euler="0 0 90"/>
<geom type="sphere" size=".1" pos="0 0 3" rgba="0 0 0 0"/>
<body name="arm" pos="1 2 3" euler="10 20 30"><joint name="q0"/>
<geom name="capsule" type="capsule" fromto="0 0 0 .1 .2 .3" size=".02"/>
<geom name="rod" type="cylinder" fromto="0 0 0 0 .2 0" size=".02"/><geom name="ball" size=".05" pos="0 .1 0"/>
<geom name="egg" type="ellipsoid" size=".1 .2 .3"/><geom name="wedge" type="mesh" mesh="wedge" pos=".3 0 0"/>
<body name="hand" pos="0 0 1" euler="90 0 0"><geom name="box" type="box" size=".1 .1 .1" pos=".1 0 0"/></body>
</body><body name="puck"><joint name="px"/><geom name="puck" type="cylinder" size=".1 .1"/></body>
</worldbody></mujoco>
"""


@pytest.fixture
def odd_scene(scene) -> Scene:
    made = Scene(xml=MJCF, info=replace(scene.info, start=(0.5, 0.0)))
    # Only what the viewer asks for.
    made.__dict__["layout"] = SimpleNamespace(object_body=made.compile().body("puck").id)
    return made


def test_geoms_are_where_mujoco_has_them(odd_scene, tmp_path):
    file = tmp_path / "scene.rrd"
    with rr.RecordingStream("test", recording_id="scene") as recording:
        recording.save(file)
        log_shapes(recording, odd_scene)
    table = read(file, None)
    model = odd_scene.compile()
    shapes = {c.split(":")[0] for c in table.columns if c.startswith("/scene/")}
    names = {"table", "capsule", "rod", "ball", "egg", "wedge", "box"}
    assert shapes == {f"/scene/{'world' if n == 'table' else 'arm'}/{n}" for n in names}

    def of(entity: str, column: str) -> np.ndarray:
        return values(table, f"/scene/arm/{entity}:{column}")[0]

    np.testing.assert_allclose(of("ball", "Ellipsoids3D:half_sizes")[0], 0.05, atol=1e-6)
    np.testing.assert_allclose(of("egg", "Ellipsoids3D:half_sizes")[0], [0.1, 0.2, 0.3], atol=1e-6)
    # The capsule begins at one end: at its start if drawn along +z, else at the other.
    ends = np.array([[0, 0, 0], [0.1, 0.2, 0.3]])
    begin = of("capsule", "Capsules3D:translations")[0]
    assert min(np.linalg.norm(ends - begin, axis=1)) < 1e-6
    assert of("capsule", "Capsules3D:lengths")[0] == pytest.approx(np.linalg.norm(ends[1]), abs=1e-6)
    np.testing.assert_allclose(of("rod", "Cylinders3D:centers")[0], [0, 0.1, 0], atol=1e-6)
    # The hand is welded to the arm: turned by 90 degrees about x, 1 m up.
    np.testing.assert_allclose(of("box", "Boxes3D:centers")[0], [0.1, 0, 1], atol=1e-6)
    vertices = of("wedge", "Mesh3D:vertex_positions")
    np.testing.assert_allclose(vertices.min(0), [0.3, 0, 0], atol=1e-6)
    np.testing.assert_allclose(vertices.max(0), [0.4, 0.1, 0.1], atol=1e-6)
    assert model.ngeom == len(names) + 3  # the plane, the one that cannot be seen, the puck


def test_extent_is_of_what_is_seen_and_stands_still(odd_scene):
    low, high = extent(odd_scene)
    np.testing.assert_allclose(low, [0.5, -1, -0.2], atol=1e-6)  # the object's start counts too
    np.testing.assert_allclose(high, [2.5, 1, 0], atol=1e-6)
