"""Train a small policy by PPO in a vector environment, in one file.

    python examples/train_ppo.py --out ppo.npz
    hlsd bench --planner 'examples/ppo_planner.py:Ppo(weights=ppo.npz)'

It needs `pip install 'hlsd[gym,train]'`. The policy learns on a kinematic Jackal, in
worlds made from a seed; the bench drives it under physics, in worlds it never saw. The
layout is that of CleanRL's PPO: everything in order, nothing hidden.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import torch
from torch import nn

import hlsd.envs  # announces the environments
from hlsd.run.protocol import HLSD2021

OBSERVATION = "flat60+local_goal"
"""The nearest of twelve beams each, the local goal, and the velocity."""
MAX_SPEED, MAX_YAW_RATE = 1.0, 2.0

# The paper's course and goal, but that a contact ends the run: time after one would
# teach little.
RULES = replace(HLSD2021, name="train", contact_ends_run=True, limit_s=30.0)
REWARD = {
    "progress": 1.0,
    "time": -0.1,
    "goal": 5.0,
    "collision": -4.0,
    "contact": -1.0,
}
KINEMATIC = "hlsd/KinematicBarn-v1"
GAMMA, LAMBDA, CLIP = 0.99, 0.95, 0.2
EPOCHS, MINIBATCH = 4, 1024
WIDTH = 64
LOG_SD = (-0.5, -1.6)
"""Of the noise on actions, which lie in [-1, 1]: when training begins, and at its
end."""


def main() -> None:
    """Train, and write the weights."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("ppo.npz"))
    parser.add_argument("--steps", type=int, default=1_500_000, help="in all")
    parser.add_argument("--worlds", type=int, default=200, help="made to train in")
    parser.add_argument("--envs", type=int, default=64, help="stepped at once")
    parser.add_argument("--horizon", type=int, default=64, help="steps of a batch")
    parser.add_argument("--threads", type=int, default=2, help="cores to use")
    parser.add_argument("--env", default=KINEMATIC)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    torch.manual_seed(given.seed)
    torch.set_num_threads(1)  # the networks are too small to share out
    fast = {"noise": False} if given.env == KINEMATIC else {}
    env = gymnasium.make_vec(
        given.env,
        num_envs=given.envs,
        worlds=f":{given.worlds}",
        worlds_seed=1000 + given.seed,
        protocol=RULES,
        observation=OBSERVATION,
        action=hlsd.envs.ActionSpec(
            normalised=True,
            backwards=False,
            max_speed=MAX_SPEED,
            max_yaw_rate=MAX_YAW_RATE,
        ),
        reward=REWARD,
        threads=given.threads,
        autoreset_mode="SameStep",
        **fast,
    )
    policy = train(env, given)
    write(given.out, policy)
    env.close()
    print(f"wrote {given.out}")


class Policy(nn.Module):
    """Two networks: what to do, and what it is worth."""

    def __init__(self, numbers: int) -> None:
        """For observations of so many numbers."""
        super().__init__()
        self.actor, self.critic = network(numbers, 2), network(numbers, 1)
        with torch.no_grad():
            self.actor[-1].weight.mul_(0.01)
            self.actor[-1].bias[0] = 0.2  # robots that stand still learn nothing

    def value(self, seen: torch.Tensor) -> torch.Tensor:
        """Expected sum of rewards, ``(n,)``."""
        return self.critic(seen)[:, 0]

    def actions(self, seen: torch.Tensor, log_sd: float) -> torch.distributions.Normal:
        """Where actions are drawn from, ``(n, 2)``."""
        return torch.distributions.Normal(self.actor(seen), np.exp(log_sd))


def network(numbers: int, out: int) -> nn.Sequential:
    """Two hidden layers."""
    return nn.Sequential(
        *(nn.Linear(numbers, WIDTH), nn.Tanh()),
        *(nn.Linear(WIDTH, WIDTH), nn.Tanh()),
        nn.Linear(WIDTH, out),
    )


def train(env: gymnasium.vector.VectorEnv, given: argparse.Namespace) -> Policy:
    """Proximal policy optimisation; a line for each tenth of the way."""
    count, horizon = given.envs, given.horizon
    numbers = env.single_observation_space.shape[0]
    policy = Policy(numbers)
    optimiser = torch.optim.Adam(policy.parameters(), lr=1e-3, eps=1e-5)
    seen = torch.zeros(horizon, count, numbers)
    done, rewards, values, logs = (torch.zeros(horizon, count) for _ in range(4))
    actions = torch.zeros(horizon, count, 2)
    rounds = max(1, given.steps // (count * horizon))
    outcomes: list[str] = []
    began, told = time.perf_counter(), 0
    now = torch.as_tensor(env.reset(seed=given.seed)[0])
    for number in range(rounds):
        share = number / rounds
        log_sd = LOG_SD[0] + share * (LOG_SD[1] - LOG_SD[0])
        optimiser.param_groups[0]["lr"] = 1e-3 * (1.0 - 0.9 * share)
        for t in range(horizon):
            with torch.no_grad():
                drawn = policy.actions(now, log_sd)
                action = drawn.sample()
                seen[t], actions[t] = now, action
                values[t] = policy.value(now)
                logs[t] = drawn.log_prob(action).sum(1)
            clipped = action.clamp(-1.0, 1.0).numpy()
            after, reward, ended, late, infos = env.step(clipped)
            rewards[t] = torch.as_tensor(reward)
            # A run that ran out of time is worth what its last state was.
            for i in np.flatnonzero(late):
                last = torch.as_tensor(infos["final_obs"][i])[None]
                with torch.no_grad():
                    rewards[t, i] += GAMMA * policy.value(last)[0]
            over = ended | late
            done[t] = torch.as_tensor(over)
            if over.any():
                outcomes += infos["final_info"]["outcome"][over].tolist()
            now = torch.as_tensor(after)
        with torch.no_grad():
            gains = advantages(rewards, values, done, policy.value(now))
        improve(policy, optimiser, log_sd, seen, actions, logs, gains, gains + values)
        if (number + 1) * 10 // rounds > told:
            told = (number + 1) * 10 // rounds
            recent = outcomes[-500:] or [""]
            steps = (number + 1) * count * horizon
            took_s, cpu_s = time.perf_counter() - began, time.process_time()
            wins, hits = (
                recent.count(what) / len(recent) for what in ("success", "collision")
            )
            print(
                f"{steps:9} steps, {took_s:5.0f} s, {cpu_s:5.0f} s of CPU: "
                f"{wins:4.0%} reach the goal, {hits:4.0%} collide",
                flush=True,
            )
    return policy


def write(path: Path, policy: Policy) -> None:
    """Write what `ppo_planner.py` reads."""
    held = {"observation": OBSERVATION, "largest": (MAX_SPEED, MAX_YAW_RATE)}
    for i, layer in enumerate(policy.actor[::2]):
        held[f"w{i}"] = layer.weight.detach().numpy()
        held[f"b{i}"] = layer.bias.detach().numpy()
    np.savez(path, **held)


def advantages(
    rewards: torch.Tensor, values: torch.Tensor, done: torch.Tensor, last: torch.Tensor
) -> torch.Tensor:
    """Generalised advantage estimates, ``(horizon, n)``."""
    found, ahead, after = torch.zeros_like(rewards), torch.zeros_like(last), last
    for t in reversed(range(len(rewards))):
        goes_on = 1.0 - done[t]
        error = rewards[t] + GAMMA * after * goes_on - values[t]
        ahead = error + GAMMA * LAMBDA * goes_on * ahead
        found[t], after = ahead, values[t]
    return found


def improve(  # one argument for each array of a batch
    policy: Policy,
    optimiser: torch.optim.Optimizer,
    log_sd: float,
    seen: torch.Tensor,
    actions: torch.Tensor,
    logs: torch.Tensor,
    gains: torch.Tensor,
    worth: torch.Tensor,
) -> None:
    """Some epochs over a batch."""
    seen, actions = seen.flatten(0, 1), actions.flatten(0, 1)
    logs, gains, worth = logs.flatten(), gains.flatten(), worth.flatten()
    size = min(MINIBATCH, len(logs))
    for _ in range(EPOCHS):
        order = torch.randperm(len(logs))
        for first in range(0, len(logs) - size + 1, size):
            some = order[first : first + size]
            gain = gains[some]
            gain = (gain - gain.mean()) / (gain.std() + 1e-8)
            log = policy.actions(seen[some], log_sd).log_prob(actions[some]).sum(1)
            ratio = (log - logs[some]).exp()
            clipped = ratio.clamp(1.0 - CLIP, 1.0 + CLIP)
            loss = -torch.min(ratio * gain, clipped * gain).mean()
            loss = (
                loss + 0.25 * (policy.value(seen[some]) - worth[some]).square().mean()
            )
            optimiser.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(policy.parameters(), 0.5)
            optimiser.step()


if __name__ == "__main__":
    main()
