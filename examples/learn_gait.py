"""Learn a gait with CMA-ES: a linear policy of what the sensors measure, compared with the best gait of all.

Run it with `python examples/learn_gait.py`, or with a number of environment steps: `python examples/learn_gait.py 1e6`.

Look for: how the part of the optimum of `crawler optimise` grows with the number of steps. The policy knows neither the
time nor the model: it is a feedback from elongations, tensions and velocities to the rates of the two links.
"""

import sys

import cma
import gymnasium
import numpy as np

import crawler_lab.gym  # noqa: F401  registers crawler_lab/Crawler-v0
from crawler_lab import optimise
from crawler_model import load_scene

STEPS = float(sys.argv[1]) if len(sys.argv) > 1 else 3e5
SCENE, EPISODE, PERIOD, POPULATION, SPREAD, SEED = "three_contacts_one_way", 200, 1.0, 32, 2.0, 1

envs = gymnasium.make_vec(
    "crawler_lab/Crawler-v0",
    num_envs=POPULATION,
    vectorization_mode="vector_entry_point",
    scene=SCENE,
    steps=EPISODE,
    price=0.0,
)
scale = envs.unwrapped.spec_of_crawler.spans.scale
inputs, outputs = envs.single_observation_space.shape[0], envs.single_action_space.shape[0]


def policy(weights, observation):
    """Map observations (..., O) to actions (..., A) by weights (..., A, O + 1), the last of them constant."""
    seen = np.concatenate((observation / scale, np.ones((*observation.shape[:-1], 1))), axis=-1)
    return np.tanh((weights @ seen[..., None])[..., 0])


def gains(population):
    """Play an episode with each policy; return the speed over its second half, in m per period."""
    weights = np.reshape(population, (POPULATION, outputs, inputs + 1))
    observation, _ = envs.reset(seed=SEED)
    for step in range(EPISODE):
        observation, _, _, _, info = envs.step(policy(weights, observation))
        if step == EPISODE // 2 - 1:
            half = info["net_translation"]
    seconds = EPISODE / 2 / envs.metadata["render_fps"]
    return (info["net_translation"] - half) * PERIOD / seconds


best = optimise(load_scene(SCENE), "translation", waypoints=4, stroke=(0.0, 0.1), seconds=5.0, seed=SEED).value
options = {"popsize": POPULATION, "seed": SEED, "verbose": -9}
search = cma.CMAEvolutionStrategy(np.zeros(outputs * (inputs + 1)), SPREAD, options)
parts, done, said = [], 0, 0.0
while done < STEPS:
    asked = search.ask()
    scores = gains(asked)
    search.tell(asked, list(-scores))
    done += POPULATION * EPISODE
    parts.append(-search.best.f / best)
    if done >= said or done >= STEPS:
        said = 2.0 * done
        print(f"{done:8d} steps: {parts[-1]:6.1%} of the optimum, {best:.4f} m a period")
weights = np.reshape(search.best.x, (outputs, inputs + 1))
np.save("gait.npy", weights)
