"""The ceiling camera: tracked positions of the object, frame by frame, and its observed rest point."""

from dataclasses import dataclass

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.lab.rig import Camera
from slapshot.scenes.scene import Scene

# Share of the time at rest, counted from its end, from which the rest point is computed: whoever cuts the
# recording does not know exactly when the object stopped.
REST_SHARE = 0.8
FEWEST_FRAMES = 3  # the median of fewer is not robust against a mistrack
OUTLIER_SIZE = 4.0  # noise of an outlier over the usual one
LARGEST_JITTER = 0.4  # of the interval between frames: stamps stay in order


@dataclass(frozen=True, eq=False)
class Sighting:
    """What the camera recorded of one hit.

    Attributes:
        frames: (n, 4) t (s), x, y (m), yaw (rad); lost frames are missing rows, yaw that is not recorded NaN.
        rest: (2,) x, y (m) of the observed rest point, None if the object was not seen at rest.
    """

    frames: Array
    rest: Array | None


def observe(track: Array, camera: Camera, rng: np.random.Generator, seen_as: Array | None = None) -> Sighting:
    """Record a hit until `camera.after_rest` seconds after the object has come to rest.

    Args:
        track: (n, 4) t (s), x, y (m), yaw (rad) of the object, sampled densely enough to interpolate; at rest
            from the last row on.
        camera: its properties.
        rng: source of randomness; the clocks of arm and camera are not synchronised.
        seen_as: (n, 3) the track with the camera's systematic errors; None if it has none.
    """
    reported = track if seen_as is None else seen_as
    end = track[-1, 0] + camera.after_rest
    times = np.arange(rng.uniform(0, 1 / camera.rate), end, 1 / camera.rate)
    seen = np.stack([np.interp(times, reported[:, 0], reported[:, i]) for i in (1, 2)], axis=1)
    seen += _noise(len(times), camera, rng)
    seen += _mistracks(len(times), camera, rng)
    seen += _outliers(len(times), camera, rng)
    stamps = times + _stamp_errors(len(times), camera, rng)
    there = rng.uniform(size=len(times)) >= camera.missing_share
    there &= stamps >= 0  # a recording begins with the hit
    if camera.view is not None:
        x_low, x_high, y_low, y_high = camera.view
        there &= (x_low < seen[:, 0]) & (seen[:, 0] < x_high)
        there &= (y_low < seen[:, 1]) & (seen[:, 1] < y_high)
    at_rest = there & (times > end - REST_SHARE * camera.after_rest)
    rest = np.median(seen[at_rest], axis=0) if at_rest.sum() >= FEWEST_FRAMES else None
    yaw = _yaw(np.interp(times, reported[:, 0], track[:, 3]), camera, rng)
    return Sighting(frames=np.column_stack([stamps, seen, yaw])[there], rest=rest)


def foot_of(scene: Scene, camera: Camera) -> Array:
    """(2,) m, the nominal point of the board below the camera.

    This is the point below the camera of the scene that points down most steeply; without a camera it is
    the middle of the field of view, and without a field of view the object's start.
    """
    model = scene.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    if model.ncam:
        backwards = data.cam_xmat.reshape(-1, 3, 3)[:, :, 2]  # a camera looks along its -z
        steepest = int(backwards[:, 2].argmax())
        if backwards[steepest, 2] > 0:
            place, back = data.cam_xpos[steepest], backwards[steepest]
            return (place - place[2] / back[2] * back)[:2].copy()
    if camera.view is not None:
        x_low, x_high, y_low, y_high = camera.view
        return np.array([(x_low + x_high) / 2, (y_low + y_high) / 2])
    return np.array(scene.info.start)


def _noise(count: int, camera: Camera, rng: np.random.Generator) -> Array:
    """(count, 2) m, a first-order autoregressive process: e_k = a e_(k-1) + sqrt(1 - a^2) white noise."""
    white = rng.normal(0, camera.noise_sd, (count, 2))
    if camera.noise_time == 0:
        return white
    memory = np.exp(-1 / (camera.rate * camera.noise_time))
    noise = white.copy()
    for k in range(1, count):
        noise[k] = memory * noise[k - 1] + np.sqrt(1 - memory**2) * white[k]
    return noise


def _yaw(true: Array, camera: Camera, rng: np.random.Generator) -> Array:
    """(count,) rad from -pi to pi, of an object that was put down in any orientation."""
    if camera.yaw_sd is None:
        return np.full(len(true), np.nan)
    seen = true + rng.uniform(-np.pi, np.pi) + rng.normal(0, camera.yaw_sd, len(true))
    return np.angle(np.exp(1j * seen))


def _outliers(count: int, camera: Camera, rng: np.random.Generator) -> Array:
    """(count, 2) m, additional noise of a share of the frames."""
    if camera.outlier_share == 0:
        return np.zeros((count, 2))
    affected = rng.uniform(size=count) < camera.outlier_share
    return affected[:, None] * rng.normal(0, OUTLIER_SIZE * camera.noise_sd, (count, 2))


def _stamp_errors(count: int, camera: Camera, rng: np.random.Generator) -> Array:
    """(count,) s by which frames are stamped later than they were exposed."""
    if camera.stamp_jitter == 0:
        return np.zeros(count)
    error = np.clip(rng.normal(0, camera.stamp_jitter, count), -LARGEST_JITTER, LARGEST_JITTER)
    return error / camera.rate


def _mistracks(count: int, camera: Camera, rng: np.random.Generator) -> Array:
    """(count, 2) m, errors of mistracked frames; 0 in most frames."""
    wrong = rng.uniform(size=count) < camera.mistrack_share
    distance = rng.uniform(*camera.mistrack, size=count) * wrong
    direction = rng.uniform(0, 2 * np.pi, size=count)
    return distance[:, None] * np.stack([np.cos(direction), np.sin(direction)], axis=1)
