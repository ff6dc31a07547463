"""TD3 for environments in lock-step (Fujimoto, van Hoof, Meger 2018), adapted to time-bounded tasks.

As in `stlbench_agents.dqn`, the observation contains the time, targets weight rewards by 1 - gamma, and returns stop
where the environment says so. SB3's TD3 does the same work (`sb3-td3`); here updates are compiled.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from stlbench.contract import ActionBox, Actions, Arrays, Cost, Policy, Training
from stlbench_agents.compiled_code import CompiledAgent
from stlbench_agents.policies import ActorPolicy
from stlbench_agents.recipes import Count, NotNegative, Positive, Share, ShareBelow1, Whole, Widths
from stlbench_agents.training import box_of, cost_of, report_rounds


@dataclass(frozen=True, kw_only=True)
class TD3(CompiledAgent):
    """Twin delayed deep deterministic policy gradient with a time-aware input.

    Names are those of Stable-Baselines3 where it has the option.
    """

    net_arch: Widths = (64, 64)
    """widths of the hidden layers of actor and critics"""
    copies: Count = 8
    """environments in lock-step"""
    batch_size: Count = 128
    """transitions in an update"""
    buffer_size: Count = 400_000
    """transitions kept for replay"""
    gradient_steps: Count = 1
    """updates after each step of all copies"""
    learning_rate: Positive = 1e-3
    """of Adam at the first update"""
    learning_rate_final: Positive = 1e-4
    """at the last update; the rate falls geometrically"""
    gamma: Share = 0.95
    """discount of a decision, that is, of `hold` steps. Rewards are weighted by 1 - gamma, so that values keep the
    scale of the reward; with gamma = 1 they are not"""
    n_steps: Count = 1
    """rewards in a return before it bootstraps"""
    tau: Share = 0.01
    """weight of the online networks in an update of the targets, one for each `policy_delay` updates"""
    policy_delay: Count = 2
    """updates of the critics for one of the actor"""
    averaging: ShareBelow1 = 0.995
    """reported policies have an exponential average of the actor's weights, with this weight on the past at each update
    of the actor; 0: the weights themselves. Actions in training are those of the current weights"""
    target_policy_noise: NotNegative = 0.1
    """standard deviation of the noise on target actions, which lie in [-1, 1]"""
    target_noise_clip: NotNegative = 0.25
    """the most that this noise may be"""
    exploration_noise: NotNegative = 0.2
    """standard deviation of the noise on actions in training, which lie in [-1, 1]; it rises from a quarter of this in
    the first copy to one and three quarters in the last"""
    exploration_noise_final: NotNegative | None = None
    """what that falls to, linearly over the budget; it stays where left out"""
    random_steps: Whole = 100
    """steps of all copies with random actions at the start, without updates"""
    action_penalty: NotNegative = 0.005
    """weight in the actor's loss of its squared output before the tanh, without which actions stick at their ends"""
    reward_scale: Positive = 10.0
    """factor on rewards, which arrive divided by the method's `scale`"""

    search_space: ClassVar[Mapping[str, tuple[float, ...]]] = MappingProxyType(
        {
            "gamma": (0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995),
            "n_steps": (1, 3, 5),
            "learning_rate": (0.0003, 0.001, 0.003),
            "exploration_noise": (0.1, 0.2, 0.5, 1.0),
            "hold": (5, 10, 20, 50),
        }
    )

    def train(self, training: Training) -> Policy:
        from stlbench_agents.replay import Replay
        from stlbench_agents.td3_learner import TD3Learner  # imports Numba

        environment = training.make(self.copies)
        box, size = box_of(environment.actions), environment.observation_size
        low = np.array(box.low)
        span = np.array(box.high) - low
        shape = (self.copies, len(box.names))
        rounds = max(1, training.steps // (self.copies * environment.hold))
        generator = np.random.default_rng(training.seed)
        updates = (rounds - self.random_steps) * self.gradient_steps
        learner = TD3Learner(self, size, box, generator, updates)
        rows = max(self.n_steps + 1, min(rounds, self.buffer_size // self.copies))
        replay = Replay(rows, self.copies, size, self.n_steps, self.gamma, self.reward_scale, axes=len(box.names))
        at_first, at_last = self.exploration_noise, self.exploration_noise_final
        noise = np.linspace(at_first, at_first if at_last is None else at_last, rounds)
        shares = np.linspace(0.25, 1.75, self.copies)[:, None]
        reports = report_rounds(rounds, training.checkpoints)
        observation = environment.reset()
        for done in range(1, rounds + 1):
            if done <= self.random_steps:
                action = generator.uniform(-1, 1, shape)
            else:
                action = learner.act(observation, noise[done - 1] * shares * generator.standard_normal(shape))
            transition = environment.step(low + (action + 1) / 2 * span)
            replay.add(observation, action, transition)
            observation = transition.observation
            learner.note_rewards(transition.reward)
            if done > self.random_steps and replay.ready:
                first = replay.draw(generator, self.gradient_steps, self.batch_size)
                normal = generator.standard_normal((*first.shape, len(box.names)), dtype=np.float32)
                learner.update(replay.memory, first, self.copies, normal)
            if done in reports:
                final = learner.policy(averaged=True)
                if training.report(final, done * self.copies * environment.hold):
                    break
        return final

    @classmethod
    def restore(cls, arrays: Arrays, actions: Actions) -> Policy:
        return ActorPolicy.of(arrays, box_of(actions))

    def cost(self, size: int, actions: Actions, decisions: int) -> Cost:
        """The cost of a critic, and of the replay; the actor's is about that of a critic."""
        axes = len(actions.names)
        return cost_of(size + axes, self.net_arch, 1, min(decisions, self.buffer_size))

    @property
    def compiled_part(self) -> str:
        return "td3"

    def compile(self) -> None:
        from stlbench_agents.td3_learner import TD3Learner

        TD3Learner(self, 1, ActionBox(("a",), (-1.0,), (1.0,)), np.random.default_rng(0), 1).compile()
