"""Humanoid robots and physics models as actors."""

from perfcap.io.robot.load import ROBOTS, is_robot, load_robot

__all__ = ["ROBOTS", "is_robot", "load_robot"]
