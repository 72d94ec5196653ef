"""Gymnasium environments: crawlers that learn to move, one at a time or many in one compiled call."""

from gymnasium.envs.registration import register, registry

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
