"""Addition and subtraction of states, against MuJoCo's own."""

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from slapshot.diagnosis.model.tangent import Tangent

# A free joint, a ball joint, a hinge and a slide, and an actuator with a state: nq = 13, nv = 11, na = 1.
MODEL = mujoco.MjModel.from_xml_string("""
<mujoco>
  <worldbody>
    <body><joint type="slide" name="slide"/><geom size="0.1"/>
      <body pos="1 0 0"><joint type="ball"/><geom size="0.1"/>
        <body pos="1 0 0"><joint type="hinge"/><geom size="0.1"/></body>
      </body>
    </body>
    <body pos="0 0 3"><freejoint/><geom size="0.1"/></body>
  </worldbody>
  <actuator><general joint="slide" dyntype="filter" dynprm="0.1"/></actuator>
</mujoco>
""")
TANGENT = Tangent(MODEL)
QUATERNIONS = (1, 9)  # where they begin in qpos


def vector(size: int, largest: float) -> st.SearchStrategy[np.ndarray]:
    number = st.floats(-largest, largest, allow_nan=False, width=32)
    return st.lists(number, min_size=size, max_size=size).map(np.array)


@st.composite
def states(draw) -> np.ndarray:
    x = draw(vector(TANGENT.size, 10.0))
    for q in QUATERNIONS:
        length = np.linalg.norm(x[q : q + 4])
        x[q : q + 4] = x[q : q + 4] / length if length > 1e-3 else [1, 0, 0, 0]
    return x


def same_rotations(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """b with the signs of a's quaternions: both signs stand for one rotation."""
    b = b.copy()
    for q in QUATERNIONS:
        b[q : q + 4] *= 1.0 if a[q : q + 4] @ b[q : q + 4] >= 0 else -1.0
    return b


def test_sizes():
    assert (TANGENT.size, TANGENT.dim) == (13 + 11 + 1, 11 + 11 + 1)


@given(states(), states())
def test_the_difference_added_leads_there(a, b):
    np.testing.assert_allclose(same_rotations(a, TANGENT.add(b, TANGENT.subtract(a, b))), a, atol=1e-9)


@given(states(), vector(TANGENT.dim, 1.0))
def test_what_was_added_is_the_difference(x, delta):
    # Rotation vectors have at most a length of √3 < π, beyond which the shorter way round is another.
    np.testing.assert_allclose(TANGENT.subtract(TANGENT.add(x, delta), x), delta, atol=1e-9)


@given(states(), vector(TANGENT.dim, 2.0))
def test_addition_is_mujocos_integration(x, delta):
    qpos = x[: MODEL.nq].copy()
    mujoco.mj_integratePos(MODEL, qpos, delta[: MODEL.nv], 1.0)
    moved = TANGENT.add(x, delta)
    np.testing.assert_allclose(moved[: MODEL.nq], qpos, atol=1e-9)
    np.testing.assert_allclose(moved[MODEL.nq :], x[MODEL.nq :] + delta[MODEL.nv :], atol=1e-12)


@given(states(), states())
def test_subtraction_is_mujocos_differentiation(a, b):
    change = np.empty(MODEL.nv)
    mujoco.mj_differentiatePos(MODEL, change, 1.0, b[: MODEL.nq], a[: MODEL.nq])
    ours = TANGENT.subtract(a, b)
    for v in (1, 8):  # half a turn is one rotation either way
        if abs(np.linalg.norm(change[v : v + 3]) - np.pi) < 1e-6 and change[v : v + 3] @ ours[v : v + 3] < 0:
            change[v : v + 3] *= -1
    np.testing.assert_allclose(ours[: MODEL.nv], change, atol=1e-7)


@pytest.mark.parametrize("size", [0.0, 1e-15, 1e-9, 1e-4])
def test_small_rotations_are_exact(size):
    x, delta = np.zeros(TANGENT.size), np.zeros(TANGENT.dim)
    x[list(QUATERNIONS)] = 1
    delta[1:4] = size * np.array([0.6, 0.0, -0.8])
    found = TANGENT.subtract(TANGENT.add(x, delta), x)
    np.testing.assert_allclose(found, delta, rtol=1e-12, atol=1e-300)


def test_many_at_once_are_each_by_itself():
    rng = np.random.default_rng(1)
    x, delta = rng.normal(size=(3, 1, TANGENT.size)), rng.normal(size=(4, TANGENT.dim))
    for q in QUATERNIONS:
        x[..., q : q + 4] /= np.linalg.norm(x[..., q : q + 4], axis=-1, keepdims=True)
    moved = TANGENT.add(x, delta)
    assert moved.shape == (3, 4, TANGENT.size)
    change = TANGENT.subtract(moved, x)
    for i in range(3):
        for j in range(4):
            np.testing.assert_allclose(moved[i, j], TANGENT.add(x[i, 0], delta[j]), atol=1e-14)
            np.testing.assert_allclose(change[i, j], TANGENT.subtract(moved[i, j], x[i, 0]), atol=1e-14)
