"""TD3 for environments in lock-step (Fujimoto, van Hoof, Meger 2018), with what time-bounded tasks need.

As in `stlbench_agents.dqn`, the observation contains the time, targets weight rewards by 1 - gamma, and returns stop
where the environment says so. SB3's TD3 does the same work (`sb3-td3`); here the two critics are one batched product
and the environments act in NumPy.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from stlbench.contract import Agent, Policy, Training
from stlbench_agents.actions import box_of
from stlbench_agents.marks import spread
from stlbench_agents.one_thread import one_thread
from stlbench_agents.parameters import Count, NotNegative, Positive, Share
from stlbench_agents.replay import Replay

__all__ = ["TD3"]


class TD3(Agent):
    """Twin delayed deep deterministic policy gradient with a time-aware input."""

    def __init__(
        self,
        *,
        net_arch: Annotated[tuple[Count, ...], Field(min_length=1)] = (64, 64),
        copies: Count = 8,
        batch_size: Count = 128,
        buffer_size: Count = 400_000,
        gradient_steps: Count = 1,
        learning_rate: Positive = 1e-3,
        learning_rate_final: Positive = 1e-4,
        gamma: Share = 0.95,
        n_steps: Count = 1,
        tau: Share = 0.01,
        policy_delay: Count = 2,
        averaging: Annotated[float, Field(ge=0, lt=1)] = 0.995,
        target_policy_noise: NotNegative = 0.1,
        target_noise_clip: NotNegative = 0.25,
        exploration_noise: NotNegative = 0.2,
        exploration_noise_final: NotNegative | None = None,
        random_steps: Annotated[int, Field(ge=0)] = 100,
        action_penalty: NotNegative = 0.005,
        reward_scale: Positive = 10.0,
    ) -> None:
        """Names are those of Stable-Baselines3 where it has the option.

        Args:
            net_arch: widths of the hidden layers of actor and critics.
            copies: environments in lock-step.
            batch_size: transitions an update.
            buffer_size: transitions kept for replay.
            gradient_steps: updates after each lock-step.
            learning_rate: of Adam at the first update; falls geometrically to `learning_rate_final` at the last.
            gamma: discount a decision, that is, a span of `hold` steps; rewards are weighted by 1 - gamma.
            n_steps: rewards in a return before it bootstraps.
            tau: weight of the online networks in an update of the targets, one for each `policy_delay` updates.
            policy_delay: updates of the critics for one of the actor.
            averaging: the policy that is reported has an exponential average of the actor's weights, this close to 1
                an update of the actor; 0 takes the weights as they are. Actions in training are those of the actor.
            target_policy_noise: standard deviation of the noise on target actions, which lie in [-1, 1].
            target_noise_clip: its limit.
            exploration_noise: standard deviation of the noise on actions in training, in [-1, 1] units; from copy to
                copy it rises from a quarter of this to one and three quarters.
            exploration_noise_final: what this falls to, linearly over the budget; it stays where left out.
            random_steps: lock-steps with random actions at the start, without updates.
            action_penalty: weight in the actor's loss of its squared output before the tanh, without which actions
                stick at their ends.
            reward_scale: factor on rewards, which arrive divided by the method's `scale`.
        """
        self.net_arch, self.copies, self.batch_size, self.buffer_size = net_arch, copies, batch_size, buffer_size
        self.gradient_steps, self.gamma, self.n_steps = gradient_steps, gamma, n_steps
        self.learning_rate, self.learning_rate_final = learning_rate, learning_rate_final
        self.tau, self.policy_delay, self.averaging = tau, policy_delay, averaging
        self.action_penalty = action_penalty
        self.target_noise = (target_policy_noise, target_noise_clip)
        last = exploration_noise if exploration_noise_final is None else exploration_noise_final
        self.exploration_noise = (exploration_noise, last)
        self.random_steps, self.reward_scale = random_steps, reward_scale

    def train(self, training: Training) -> Policy:
        """Spend the budget; return the policy at its end."""
        with one_thread():
            return self._train(training)

    def _train(self, training: Training) -> Policy:
        from stlbench_agents.td3_learner import Learner  # imports PyTorch, which takes seconds

        environment = training.make(self.copies)
        box = box_of(environment)
        low, high = np.array(box.low), np.array(box.high)
        rounds = max(1, training.steps // (self.copies * environment.hold))
        generator = np.random.default_rng(training.seed)
        updates = (rounds - self.random_steps) * self.gradient_steps
        learner = Learner(self, environment.observation_size, box, generator, updates)
        rows = max(self.n_steps + 1, min(rounds, self.buffer_size // self.copies))
        replay = Replay(
            rows,
            self.copies,
            environment.observation_size,
            self.n_steps,
            self.gamma,
            weight=(1 - self.gamma) * self.reward_scale,
            axes=len(box.names),
        )
        noise, shares = np.linspace(*self.exploration_noise, rounds), np.linspace(0.25, 1.75, self.copies)[:, None]
        reports = spread(rounds, training.checkpoints)
        observation = environment.reset()
        policy = learner.policy()
        for done in range(1, rounds + 1):
            if done <= self.random_steps:
                action = generator.uniform(-1, 1, (self.copies, len(box.names)))
            else:
                greedy = 2 * (policy.act(observation) - low) / (high - low) - 1
                action = greedy + noise[done - 1] * shares * generator.standard_normal(greedy.shape)
                action = np.clip(action, -1, 1)
            transition = environment.step(low + (action + 1) / 2 * (high - low))
            replay.add(observation, action, transition)
            observation = transition.observation
            learner.saw(transition.reward)
            if done > self.random_steps and replay.ready:
                for first in replay.draw(generator, self.gradient_steps, self.batch_size):
                    learner.update(replay.batch(first), generator.standard_normal((self.batch_size, len(box.names))))
                policy = learner.policy()
            if done in reports:
                final = learner.policy(averaged=True)
                training.report(final, done * self.copies * environment.hold)
        return final
