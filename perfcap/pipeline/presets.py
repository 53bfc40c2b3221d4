"""Settings of a whole capture, and the sets of them that have a name."""

from __future__ import annotations

from dataclasses import dataclass, field

from perfcap.pipeline.config import MONOPERFCAP_POSE, MUVS_POSE, PoseConfig
from perfcap.pipeline.followed_person import FramesConfig
from perfcap.pipeline.keep_apart import ApartConfig
from perfcap.pipeline.lost_limbs import LostLimbsConfig
from perfcap.pipeline.refine_contours import ContoursConfig
from perfcap.pipeline.surface_config import (
    MONOPERFCAP_REFINE_POSE,
    MONOPERFCAP_REFINE_SURFACE,
    MONOPERFCAP_SILHOUETTES,
    RefineCamerasConfig,
    RefinePoseConfig,
    RefineSurfaceConfig,
    SilhouetteConfig,
)
from perfcap.setting_checks import Settings


@dataclass(frozen=True)
class CaptureConfig(Settings):
    """Everything of a capture, stage by stage.

    ``contours`` are met before silhouettes are looked for; without ``segment`` they never are.
    With ``frames``, people are followed from the first frame on instead of refined all at once.
    ``refine_cameras`` lets silhouettes of several fixed views move these, for one person.
    ``lost_limbs`` are searched for in the silhouettes of one view. ``apart`` keeps the skins of
    several people apart.
    """

    pose: PoseConfig = field(default_factory=PoseConfig)
    contours: ContoursConfig = field(default_factory=ContoursConfig)
    segment: bool = True
    silhouettes: SilhouetteConfig = field(default_factory=SilhouetteConfig)
    refine_cameras: RefineCamerasConfig = field(default_factory=RefineCamerasConfig)
    lost_limbs: LostLimbsConfig = field(default_factory=LostLimbsConfig)
    refine_pose: RefinePoseConfig = field(default_factory=RefinePoseConfig)
    refine_surface: RefineSurfaceConfig = field(default_factory=RefineSurfaceConfig)
    frames: FramesConfig | None = None
    apart: ApartConfig = field(default_factory=ApartConfig)


# of one view, as published by Xu et al. 2018, as far as it is
MONOPERFCAP = CaptureConfig(
    MONOPERFCAP_POSE,
    silhouettes=MONOPERFCAP_SILHOUETTES,
    lost_limbs=LostLimbsConfig(enabled=False),
    refine_pose=MONOPERFCAP_REFINE_POSE,
    refine_surface=MONOPERFCAP_REFINE_SURFACE,
)
# the two stages of Huang et al. 2017; with images, perfcap's own refinement comes after them
MUVS = CaptureConfig(MUVS_POSE)
# raw images without silhouettes, as Rhodin et al. 2016; the weights are ours
RHODIN = CaptureConfig(contours=ContoursConfig(enabled=True), segment=False)
# poses and surfaces frame by frame, as Liu et al. 2013; of detections, poses see the first frame's
LIU = CaptureConfig(frames=FramesConfig(), apart=ApartConfig(enabled=False))
PRESETS = {
    "default": CaptureConfig(),
    "liu2013": LIU,
    "monoperfcap": MONOPERFCAP,
    "muvs2017": MUVS,
    "rhodin2016": RHODIN,
}
