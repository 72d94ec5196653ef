"""Gymnasium environments: crawlers that learn to move, one at a time or many in one compiled call."""

try:
    from gymnasium.envs.registration import register, registry
except ModuleNotFoundError:
    text = "gymnasium is not installed; install with: pip install 'crawler-ros[gym]'"
    raise ModuleNotFoundError(text, name="gymnasium") from None

from .env import CrawlerEnv
from .steer import SteerEnv
from .vector import CrawlerVectorEnv

__all__ = ["CrawlerEnv", "CrawlerVectorEnv", "SteerEnv"]

for name in ("crawler_lab/Crawler-v0", "Crawler-v0"):  # the second one as in version 0.1.0
    if name not in registry:
        register(
            name,
            entry_point="crawler_lab.gym.steer:make_env",
            vector_entry_point="crawler_lab.gym.vector:CrawlerVectorEnv",
        )
