"""TD3 for environments in lock-step (Fujimoto, van Hoof, Meger 2018), adapted to time-bounded tasks.

As in `stlbench_agents.dqn`, the observation contains the time, targets weight rewards by 1 - gamma, and returns stop
where the environment says so. SB3's TD3 does the same work (`sb3-td3`); here updates are compiled.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar

from stlbench.contract import ActionBox, Actions, Arrays, Cost, Environment, Policy
from stlbench_agents import training
from stlbench_agents.policies import ActorPolicy


@dataclass(frozen=True, kw_only=True)
class TD3(training.LockStepAgent):
    """Twin delayed deep deterministic policy gradient with a time-aware input."""

    policy_delay: training.Count = 2
    """updates of the critics for one of the actor and of the targets"""
    averaging: training.ShareBelow1 = 0.995
    target_policy_noise: training.NotNegative = 0.1
    """standard deviation of the noise on target actions, which lie in [-1, 1]"""
    target_noise_clip: training.NotNegative = 0.25
    """the most that this noise may be"""
    exploration_noise: training.NotNegative = 0.2
    """standard deviation of the noise on actions in training, which lie in [-1, 1]; it rises from a quarter of this in
    the first copy to one and three quarters in the last"""
    exploration_noise_final: training.NotNegative | None = None
    """what that falls to, linearly over the budget; it stays where left out"""
    lasting_noise: training.ShareBelow1 = 0.0
    """correlation of this noise with that of the decision before, in every second copy: noise that lasts moves a robot
    further (Eberhard, Hollenstein, Pinneri, Martius 2023)"""
    random_steps: training.Whole = 100
    """steps of all copies with random actions at the start, without updates"""
    action_penalty: training.NotNegative = 0.005
    """weight in the actor's loss of its squared output before the tanh, without which actions stick at their ends"""
    layer_norm: bool = False
    """whether the hidden layers of the critics are normalised (Ba, Kiros, Hinton 2016): values of actions never tried
    stay bounded then (Ball, Smith, Kostrikov, Levine 2023)"""
    reward_scale: training.Positive = 10.0

    compiled_part = "td3"
    recipe = MappingProxyType(
        {
            **training.SHARED,
            "copies": 8,
            "gradient_steps": 4,
            "n_steps": 3,
            "exploration_noise": 0.5,
            "exploration_noise_final": 0.1,
        }
    )
    second_recipe = MappingProxyType({"copies": 32, "gradient_steps": 8})
    preference = MappingProxyType({"box": 1})
    search_space: ClassVar[Mapping[str, tuple[float, ...]]] = MappingProxyType(
        {
            "gamma": (0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995),
            "n_steps": (1, 3, 5),
            "learning_rate": (0.0003, 0.001, 0.003),
            "exploration_noise": (0.1, 0.2, 0.5, 1.0),
            "hold": (5, 10, 20, 50),
        }
    )

    def begin(self, environment: Environment, seed: int, rounds: int) -> training.LockStepLearner:
        from stlbench_agents.td3_learner import TD3Learner  # imports Numba

        box, size = training.box_of(environment.actions), environment.observation_size
        return TD3Learner(self, size, box, environment.count, seed, rounds)

    @classmethod
    def restore(cls, arrays: Arrays, actions: Actions) -> Policy:
        return ActorPolicy.of(arrays, training.box_of(actions))

    def cost(self, size: int, actions: Actions, decisions: int) -> Cost:
        """The cost of a critic, and of the replay; the actor's is about that of a critic."""
        axes = len(actions.names)
        return training.cost_of(size + axes, self.net_arch, 1, min(decisions, self.buffer_size))

    def compile(self) -> None:
        from stlbench_agents.td3_learner import TD3Learner

        TD3Learner(self, 1, ActionBox(("a",), (-1.0,), (1.0,)), 1, 0, 1).compile()
