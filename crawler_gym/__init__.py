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

if "Crawler-v0" not in registry:
    register(
        "Crawler-v0",
        entry_point="crawler_gym.steer:make_env",
        vector_entry_point="crawler_gym.vector:CrawlerVectorEnv",
    )
