"""How a body is fitted to calibrated views."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.setting_checks import Settings

# How far joints of detectors lie from those of bodies, constantly: Needham et al. 2021 found 3 to
# 5 cm at hips and knees, 1 to 1.5 cm at ankles; the neck is as vague as a hip, the rest between.
_OFFSETS = {"hip": 0.03, "knee": 0.03, "neck": 0.03, "ankle": 0.015}
DETECTOR_OFFSETS = tuple(
    _OFFSETS.get(name.removeprefix("l_").removeprefix("r_"), 0.02) for name in LANDMARKS
)


@dataclass(frozen=True)
class ViewFitSettings(Settings):
    """How a body is fitted to views.

    Attributes:
        joints: weight of a joint's squared reprojection error.
        joint_scale: of the robust kernel, in pixel units.
        offsets: deviation of where detectors see each landmark from where the body model has it,
            metres, (16,): constant errors, which no number of frames averages out. They count in
            the deviations of measurements, but the skeleton stays where joints are detected, as
            captures with the same detector want it.
        edge: deviation of where silhouettes end from where the skin does, metres; in deviations.
        silhouettes: weight of a view's squared silhouette error, shares of its area.
        contours: weight of a contour as long as one percent of the person's height.
        heights: of the person in the images that silhouettes are compared in, px, in turn.
        edge_heights: the same of contours.
        band: about the outline, px of those images.
        shape: weight of the squared coefficients of shape.
        pose: deviation of angles from the neutral pose, radians.
        height: deviation of a given height, metres.
        steps: of the solver, of joints alone and then in each image size.
        edge_steps: the same for each of ``edge_heights``.
        consensus: how frames agree on one shape: ``"shared"`` has one unknown for all of them,
            ``"median"`` fits each on its own and takes the median (Huang et al. 2017, Sec. IV-B).
    """

    joints: float = 0.5
    joint_scale: float = 4.0
    offsets: tuple[float, ...] = DETECTOR_OFFSETS
    edge: float = 0.004
    silhouettes: float = 1500.0
    contours: float = 1.0
    heights: tuple[float, ...] = (80.0, 160.0)
    edge_heights: tuple[float, ...] = (120.0, 240.0)
    band: float = 4.0
    shape: float = 0.5
    pose: float = 1.0
    height: float = 0.005
    steps: tuple[int, ...] = (25, 12, 10)
    edge_steps: tuple[int, ...] = (12, 10)
    consensus: Literal["shared", "median"] = "shared"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.edge_heights or len(self.edge_heights) != len(self.edge_steps):
            raise InputError(
                f"body fit: edge_heights are {len(self.edge_heights)} and edge_steps "
                f"{len(self.edge_steps)}; expected as many of both, at least one"
            )
        if len(self.offsets) != len(LANDMARKS):
            raise InputError(
                f"body fit: offsets are {len(self.offsets)}; expected one of each of the "
                f"{len(LANDMARKS)} landmarks"
            )
