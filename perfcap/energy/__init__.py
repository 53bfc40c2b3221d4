"""One file, one term, one equation."""

from perfcap.energy.joint_position import JointPosition
from perfcap.energy.prior import BoneLengthPrior, PosePrior
from perfcap.energy.reprojection import Reprojection
from perfcap.energy.trajectory import Trajectory

__all__ = ["BoneLengthPrior", "JointPosition", "PosePrior", "Reprojection", "Trajectory"]
