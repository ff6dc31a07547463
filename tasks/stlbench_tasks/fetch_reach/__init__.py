"""The paper's task on the Fetch arm of Gymnasium-Robotics: two points in turn. The system, and features that a
person made for its policies.
"""

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.mujoco_model import MujocoSystem, columns

_JOINTS = (
    *("base_x", "base_y", "base_z", "torso", "head_pan", "head_tilt", "shoulder_pan", "shoulder_lift"),
    *("upperarm_roll", "elbow", "forearm_roll", "wrist_flex", "wrist_roll", "right_finger", "left_finger"),
)
SWITCH = 100
"""The last step of the first point's interval: the gripper goes to the second point after it."""
POINTS = np.array([[1.5, 0.43, 0.47], [1.5, 1.05, 0.47]])
_RANGES = np.array([[0.9, 0.3, 0.2], [1.6, 1.2, 0.9]])
"""Least and greatest x, y and z of the gripper, as the task file has them."""
_REACH = 0.05
"""Metres that a component of the action can move the gripper's target ahead of it, as in the environment."""
_MOST_MOVES, _IDLE = 5, 4
_GAIN = 8.0
"""The gain of the hand controller, a metre; from about 11 on it overshoots where actions are held 5 steps."""


class FetchReach(MujocoSystem):
    """Fetch arm whose gripper goes to one point and then to another, G[50,100] & G[150,200]; needs the extra mujoco.

    The model and its use are those of the environment FetchReach: a step first sets the target that the gripper is
    pulled to, action times 0.05 m ahead of it, and ends with the fingers closed. State: of each of the arm's joints,
    in rad or m, then place (m) and velocity (m/s) of the gripper. Signals: x, y, z of the gripper.
    """

    model_file = ("gymnasium_robotics", "envs/assets/fetch/reach.xml")
    state = columns(_JOINTS, "x", "y", "z", "v_x", "v_y", "v_z")
    coordinates = ("move_x", "move_y", "move_z", "moves")

    def __init__(self, dt: float) -> None:
        super().__init__(dt)
        self._gripper = self.model.site("robot0:grip").id
        self._wrist = self.model.body("robot0:gripper_link").id
        self._motion = np.empty(6)
        self._reset = self._raised()

    def initial_states(self, coordinates: Array) -> Array:
        """The environment's reset, then the action (move_x, move_y, move_z) `moves` times, then 4 steps without any.

        `moves` is rounded down, 5 at most: (N, 4) -> (N, 51).
        """
        state = np.repeat(self._reset, len(coordinates), axis=0)
        moves = np.minimum(np.floor(coordinates[:, 3]), _MOST_MOVES)
        for i in range(_MOST_MOVES):
            rows = moves > i
            state[rows] = self.step(state[rows], coordinates[rows, :3])
        for _ in range(_IDLE):
            state = self.step(state, np.zeros((len(state), 3)))
        return state

    def drive(self, control: Array) -> None:
        """Put the target (a mocap body) ahead of the gripper: (3,)."""
        data = self.data
        self.mujoco.mj_kinematics(self.model, data)
        data.mocap_pos[0] = data.xpos[self._wrist] + control * _REACH
        data.mocap_quat[0] = data.xquat[self._wrist] + [1.0, 0.0, 1.0, 0.0]

    def arrive(self) -> None:
        """Close the fingers, and find where everything is and how it moves.

        The environment calls `mj_forward`, which also looks for contacts and solves for forces that nobody reads.
        """
        self.data.qpos[-2:] = 0
        for find in (self.mujoco.mj_kinematics, self.mujoco.mj_comPos, self.mujoco.mj_comVel):
            find(self.model, self.data)

    def derived(self) -> Array:
        """Place and velocity of the gripper: (6,)."""
        site = self.mujoco.mjtObj.mjOBJ_SITE
        self.mujoco.mj_objectVelocity(self.model, self.data, site, self._gripper, self._motion, 0)
        return np.concatenate([self.data.site_xpos[self._gripper], self._motion[3:]])

    def signals(self, state: Array) -> Array:
        """x, y, z of the gripper: (..., 51) -> (..., 3)."""
        return state[..., 45:48]

    def scaled_state(self, state: Array) -> Array:
        """The gripper's place, from -1 to 1 over the signals' ranges, and its velocity over 1.25 m/s: (N, 6).

        That is what the environment shows. The arm's joints follow the gripper and are not shown.
        """
        low, high = _RANGES
        return np.concatenate([(state[:, 45:48] * 2 - low - high) / (high - low), state[:, 48:] * 0.8], axis=1)

    def controller(self, state: Array, t: Integers) -> Array:
        """Proportional control, slow enough for actions held 5 steps: (N, 3)."""
        way = POINTS[(t >= SWITCH).astype(np.int64)] - state[:, 45:48]
        return np.clip(_GAIN * way, -1, 1)

    def _raised(self) -> Array:
        """The state (1, 51) after the environment's reset: it welds the arm to the target and raises the gripper."""
        mujoco, model, data = self.mujoco, self.model, self.data
        data.qpos[:3] = 0.4049, 0.48, 0.0
        model.eq_data[:, :7] = 0, 0, 0, 0, 0, 0, 1
        mujoco.mj_forward(model, data)
        data.mocap_pos[0] = data.site_xpos[self._gripper] + [-0.498, 0.005, -0.231]
        data.mocap_quat[0] = 1, 0, 1, 0
        mujoco.mj_step(model, data, 10 * self._substeps)
        return self.placed(data.qpos[None].copy(), data.qvel[None].copy())


_MIDDLE = np.array([1.35, 0.75, 0.5])


class FetchReachByHand(FetchReach):
    beyond_state = ("which point counts", "a close-up of the way to it")

    def features(self, state: Array, t: Integers) -> Array:
        """The gripper's place and velocity, and the place of the point that counts at t: (N, 10).

        Place from the middle of the table over 0.33 m, velocity over 1.25 m/s; the tanh of the way to the point over
        0.1 m; -1 for the first point, 1 for the second.
        """
        place, velocity = state[:, 45:48], state[:, 48:]
        second = (t >= SWITCH).astype(np.int64)
        way = np.tanh((POINTS[second] - place) / 0.1)
        return np.concatenate([(place - _MIDDLE) * 3, velocity * 0.8, way, second[:, None] * 2.0 - 1], axis=1)
