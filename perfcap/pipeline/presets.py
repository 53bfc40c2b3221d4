"""Settings of a whole capture, and the sets of them that have a name."""

from __future__ import annotations

from dataclasses import dataclass, field

from perfcap.pipeline.config import MONOPERFCAP_POSE, PoseConfig


@dataclass(frozen=True)
class CaptureConfig:
    """Everything of a capture, stage by stage."""

    pose: PoseConfig = field(default_factory=PoseConfig)


# as published by Xu et al. 2018, as far as it is
MONOPERFCAP = CaptureConfig(MONOPERFCAP_POSE)
PRESETS = {"default": CaptureConfig(), "monoperfcap": MONOPERFCAP}
