"""One file, one term, one equation."""

from perfcap.energy.contour_alignment import ContourAlignment
from perfcap.energy.density_contour import DensityContour
from perfcap.energy.floor_penetration import FloorPenetration
from perfcap.energy.joint_position import JointPosition
from perfcap.energy.joint_target import JointTarget
from perfcap.energy.joint_trajectory import JointTrajectory
from perfcap.energy.prior import BoneLengthPrior, PoseMixture, PosePrior, SharedPrior
from perfcap.energy.reprojection import Reprojection
from perfcap.energy.rigidity import Rigidity
from perfcap.energy.silhouette_overlap import SilhouetteOverlap
from perfcap.energy.skin_contact import SkinContact
from perfcap.energy.tether import Tether
from perfcap.energy.trajectory import Trajectory, TrajectoryChange
from perfcap.energy.uncertain_contours import UncertainContours
from perfcap.energy.uncertain_views import UncertainViews

__all__ = [
    "BoneLengthPrior",
    "ContourAlignment",
    "DensityContour",
    "FloorPenetration",
    "JointPosition",
    "JointTarget",
    "JointTrajectory",
    "PoseMixture",
    "PosePrior",
    "Reprojection",
    "Rigidity",
    "SharedPrior",
    "SilhouetteOverlap",
    "SkinContact",
    "Tether",
    "Trajectory",
    "TrajectoryChange",
    "UncertainContours",
    "UncertainViews",
]
