"""Tasks on MuJoCo models: N copies stepped one by one in one model, each from its own row of numbers.

The rows hold all that a step depends on, so the memory that MuJoCo computes in is scratch. `mj_step` is called without
the environments around it, whose steps are the same bit for bit.
"""

import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from stlbench.contract import Array, System
from stlbench.contract.presentation import Pixels

_WIDTH, _HEIGHT = 480, 360
"""Width and height of a picture; the models draw into at most 640 by 480."""

_MISSING = 'it needs the extra mujoco: pip install "stlbench-rl[mujoco]"'
if sys.version_info >= (3, 13):
    _MISSING += " and, without its dependencies, pip install --no-deps dm_control"


def columns(joints: Sequence[str], *derived: str) -> tuple[str, ...]:
    """Names of a state's columns: each joint's position, velocity and warm start; then the derived ones."""
    return tuple(f"{kind}{joint}" for kind in ("", "d_", "warm_") for joint in joints) + derived


class MujocoSystem(System):
    """A model whose joints all have one degree of freedom, moved in substeps of the model's own time step.

    State: positions and velocities of the joints, in m or rad and seconds, and the accelerations from which MuJoCo's
    solver starts its search. Without them a step would not be repeated to the last bit. Then come the numbers that
    `derived` reads from the model, for signals and features.
    """

    model_file: ClassVar[tuple[str, str]]
    """An installed package, and the path of the model's XML in it."""

    def __init__(self, dt: float) -> None:
        """Load the model.

        Raises:
            ImportError: the extra is not installed.
            ValueError: dt is no multiple of the model's time step.
        """
        super().__init__(dt)
        self.mujoco = _mujoco()
        self.model = self.mujoco.MjModel.from_xml_path(_path(*self.model_file))
        self.data = self.mujoco.MjData(self.model)
        parts = self.mujoco.mjtState
        self._parts = int(parts.mjSTATE_PHYSICS | parts.mjSTATE_WARMSTART)
        self._size = self.mujoco.mj_stateSize(self.model, self._parts)
        self._view: _View | None = None
        self._substeps = round(dt / self.model.opt.timestep)
        if not np.isclose(self._substeps * self.model.opt.timestep, dt):
            raise ValueError(f"sampling_time: {dt} s is no multiple of the model's {self.model.opt.timestep} s")

    def step(self, state: Array, action: Array) -> Array:
        """One sampling time later: (N, n), (N, axes) -> (N, n)."""
        mujoco, model, data, parts, size = self.mujoco, self.model, self.data, self._parts, self._size
        before, after = np.ascontiguousarray(state), np.empty(state.shape)
        for old, control, new in zip(before, action, after, strict=True):
            mujoco.mj_setState(model, data, old[:size], parts)
            self.drive(control)
            mujoco.mj_step(model, data, self._substeps)
            self.arrive()
            mujoco.mj_getState(model, data, new[:size], parts)
            new[size:] = self.derived()
        return after

    def placed(self, positions: Array, velocities: Array) -> Array:
        """The states (N, n) at joint positions and velocities, both (N, joints)."""
        mujoco, model, data = self.mujoco, self.model, self.data
        states = np.empty((len(positions), len(self.state)))
        for row, position, velocity in zip(states, positions, velocities, strict=True):
            mujoco.mj_resetData(model, data)
            data.qpos[:], data.qvel[:] = position, velocity
            mujoco.mj_forward(model, data)
            mujoco.mj_getState(model, data, row[: self._size], self._parts)
            row[self._size :] = self.derived()
        return states

    def frame(self, state: Array) -> Pixels:
        """The model as the first camera that stands still in it sees it, or from where MuJoCo looks by default.

        State (n,) -> (360, 480, 3), by EGL, which needs no display. Raises `RuntimeError` if there is no EGL.
        """
        if self._view is None:
            self._view = _View(self.mujoco, self.model)
        self.mujoco.mj_setState(self.model, self.data, np.ascontiguousarray(state[: self._size]), self._parts)
        self.mujoco.mj_forward(self.model, self.data)
        return self._view.draw(self.data)

    def drive(self, control: Array) -> None:
        """Apply an action (axes,) to `data`, whose state is set. The motors' controls by default."""
        self.data.ctrl[:] = control

    def arrive(self) -> None:
        """Called when `data` has been stepped: by default, compute the places of the bodies."""
        self.mujoco.mj_kinematics(self.model, self.data)

    def derived(self) -> Array:
        """The columns after MuJoCo's own, read from `data`. None by default."""
        return np.empty(0)


class _View:
    """A camera and a place in memory that it draws into; made when the first picture is asked for."""

    def __init__(self, mujoco: Any, model: Any) -> None:
        self.mujoco, self.model = mujoco, model
        try:
            from mujoco.egl import GLContext

            self.context = GLContext(_WIDTH, _HEIGHT)
            self.context.make_current()
            self.drawing = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        except Exception as error:  # a driver and the library above it raise many kinds of errors
            reason = " ".join(str(error).split()) or type(error).__name__
            raise RuntimeError(f"MuJoCo draws by EGL, which does not work here: {reason}") from error
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self.drawing)
        self.scene, self.options = mujoco.MjvScene(model, maxgeom=2000), mujoco.MjvOption()
        self.camera = mujoco.MjvCamera()
        still = np.flatnonzero(model.cam_bodyid == 0)
        if len(still):
            self.camera.type, self.camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, int(still[0])
        else:
            mujoco.mjv_defaultFreeCamera(model, self.camera)

    def draw(self, data: Any) -> Pixels:
        """A picture of `data`, whose bodies are where its state says."""
        mujoco, everything = self.mujoco, self.mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self.model, data, self.options, None, self.camera, everything, self.scene)
        size, upwards = mujoco.MjrRect(0, 0, _WIDTH, _HEIGHT), np.empty((_HEIGHT, _WIDTH, 3), dtype=np.uint8)
        self.context.make_current()
        mujoco.mjr_render(size, self.scene, self.drawing)
        mujoco.mjr_readPixels(upwards, None, size, self.drawing)
        return np.ascontiguousarray(upwards[::-1])  # OpenGL's first row is the lowest one


def _mujoco() -> Any:
    """The module, imported when a system is made: `stlbench list` works without it."""
    try:
        import mujoco
    except ImportError as error:
        raise ImportError(_MISSING) from error
    return mujoco


def _path(package: str, path: str) -> str:
    """The path in a package that is not imported: the environments of both packages take long and print advice."""
    spec = find_spec(package)
    if spec is None or spec.origin is None:
        raise ImportError(_MISSING)
    return str(Path(spec.origin).parent / path)
