"""Rendering of MuJoCo models; the only module that needs a GL library."""

import ctypes
import os

from slapshot.errors import InputError

# Backend of MuJoCo -> the library it loads; tried in this order.
_BACKENDS = {"egl": "libEGL.so.1", "osmesa": "libOSMesa.so.8"}
_ADVICE = (
    "no GL library to render with: install libegl1 (Debian, Ubuntu: `apt-get install libegl1`) or "
    "libosmesa6, then run again; only figures that show the scene need it"
)


def _choose_backend() -> None:
    """Name a backend that can be loaded; MuJoCo reads the name when it is imported."""
    if os.environ.get("MUJOCO_GL", "disable") not in {"", "disable"}:
        return
    for backend, library in _BACKENDS.items():
        try:
            ctypes.CDLL(library)
        except OSError:
            continue
        os.environ["MUJOCO_GL"] = backend
        os.environ.setdefault("PYOPENGL_PLATFORM", backend)
        return
    raise InputError(_ADVICE)


_choose_backend()

import mujoco  # noqa: E402
import numpy as np  # noqa: E402
from numpy.typing import NDArray  # noqa: E402


def render(
    model: mujoco.MjModel, data: mujoco.MjData, camera: str, height: int, width: int
) -> NDArray[np.uint8]:
    """(height, width, 3) picture from a named camera.

    Raises:
        InputError: the GL library is there but does not work.
    """
    model.vis.global_.offheight = max(model.vis.global_.offheight, height)
    model.vis.global_.offwidth = max(model.vis.global_.offwidth, width)
    model.vis.quality.offsamples = 8
    try:
        with mujoco.Renderer(model, height, width) as renderer:
            renderer.update_scene(data, camera)
            return renderer.render()
    except (RuntimeError, AttributeError, ImportError, mujoco.FatalError) as error:
        raise InputError(f"{_ADVICE} ({error})") from None
