"""Strategies and nanoseconds, importable under this documented name; see `crawler_model.body.drive`."""

from .body.drive import NS, strategy_waypoints

__all__ = ["NS", "strategy_waypoints"]
