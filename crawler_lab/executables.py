"""Entry points of the executables of the laboratory."""

from __future__ import annotations

from crawler_command.executables import run


def policy() -> int:
    """Run the node `policy`, which controls a crawler by a policy of the environment `crawler_lab/Crawler-v0`."""
    return run("policy", "crawler_lab.gym.policy_node")


def plan() -> int:
    """Run the node `plan`, which follows a path of the net translation by plans over a receding horizon."""
    return run("plan", "crawler_lab.plan.plan_node")
