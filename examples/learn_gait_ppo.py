"""Learn a gait with PPO of Stable-Baselines3: a small network, compared with the best gait of all.

Run it with `python examples/learn_gait_ppo.py`, or with a number of steps: `python examples/learn_gait_ppo.py 1e6`. It
needs the extra `learn`, which brings PyTorch.

Look for: how the part of the optimum of `crawler optimise` grows, and how many more steps it takes than CMA-ES with its
linear policy (`learn_gait.py`): most of these go into a gradient that the search over few weights does not need.
"""

import sys

import gymnasium
import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

import crawler_lab.gym  # noqa: F401  registers crawler_lab/Crawler-v0
from crawler_lab import optimise
from crawler_model import load_scene

STEPS = float(sys.argv[1]) if len(sys.argv) > 1 else 3e5
SCENE, EPISODE, PERIOD, SEED, ROUNDS = "three_contacts_one_way", 200, 1.0, 1, 8


def make():
    """Make an environment that observes numbers of size 1, as networks need them."""
    env = gymnasium.make("crawler_lab/Crawler-v0", scene=SCENE, steps=EPISODE, price=0.0)
    scale = env.unwrapped.spec_of_crawler.spans.scale
    space = gymnasium.spaces.Box(-np.inf, np.inf, scale.shape)
    return gymnasium.wrappers.TransformObservation(env, lambda seen: (seen / scale).astype(np.float32), space)


def gain(model):
    """Play an episode without exploration; return the speed over its second half, in m per period."""
    env = make()
    observation, _ = env.reset(seed=SEED)
    places = []
    for _ in range(EPISODE):
        action, _ = model.predict(observation, deterministic=True)
        observation, _, _, _, info = env.step(action)
        places.append(info["net_translation"])
    seconds = EPISODE / 2 / env.metadata["render_fps"]
    return (places[-1] - places[EPISODE // 2 - 1]) * PERIOD / seconds


best = optimise(load_scene(SCENE), "translation", waypoints=4, stroke=(0.0, 0.1), seconds=5.0, seed=SEED).value
envs = VecNormalize(DummyVecEnv([make] * 8), norm_obs=False)  # rewards of a step are a few mm
network = {"net_arch": [32, 32], "log_std_init": -0.5}
model = PPO("MlpPolicy", envs, n_steps=256, batch_size=512, seed=SEED, policy_kwargs=network, device="cpu")
parts = []
for number in range(1, ROUNDS + 1):
    model.learn(int(STEPS / ROUNDS), reset_num_timesteps=number == 1)
    parts.append(gain(model) / best)
    print(f"{model.num_timesteps:8d} steps: {parts[-1]:6.1%} of the optimum, {best:.4f} m a period", flush=True)
model.save("gait_ppo")
