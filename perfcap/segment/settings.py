"""Settings of the segmentation of one frame."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from perfcap.segment.background import PlateSettings
from perfcap.segment.color_model import ColorSettings
from perfcap.segment.motion_cue import MotionSettings
from perfcap.segment.random_field import Smoothness
from perfcap.segment.trimap import PLAIN_TRIMAP, TrimapSettings
from perfcap.setting_checks import Settings


@dataclass(frozen=True)
class Belief:
    """What is believed before colours are looked at.

    Attributes:
        surprise: probability that the person shows a colour not learnt yet (hair, shoes).
        prior: nats by which the model itself speaks for a pixel as deep inside as the trimap's
            inner width, and against one as far out; in proportion in between.
    """

    surprise: float
    prior: float


@dataclass(frozen=True)
class GrabCutSettings(Settings):
    """How evidence becomes labels. Nats are natural logarithms of probability ratios.

    Attributes:
        smoothness: of neighbouring labels.
        backed: belief about pixels whose background is known.
        alone: belief about all others.
        unseen: probability that background shows a colour that is nowhere around the person.
        limit: nats that colours may contribute at most.
        rounds: cuts, with colours learnt anew before each; one less from warm colours.
        coarse: px; a larger person is first found in an image shrunk to this size, then followed
            along the boundary in the full image. None: never.
        narrow: shrunk pixels on each side of the boundary that are looked at again.
        use_colors: whether colours of the person and of the surroundings count.
        use_plate: whether to ask the plate at all.
        network: nats that a network's mask may contribute at most; 0: it is not asked.
        trimap: widths.
        color: mixtures.
        plate: comparison with the plate.
        motion: temporal gradient.
    """

    smoothness: Smoothness = field(default_factory=Smoothness)
    backed: Belief = field(default_factory=lambda: Belief(surprise=0.5, prior=3.0))
    alone: Belief = field(default_factory=lambda: Belief(surprise=0.02, prior=8.0))
    unseen: float = 0.1
    limit: float = 20.0
    rounds: int = 2
    coarse: float | None = 350.0
    narrow: float = 3.0
    use_colors: bool = True
    use_plate: bool = True
    network: float = 3.0
    trimap: TrimapSettings = field(default_factory=TrimapSettings)
    color: ColorSettings = field(default_factory=ColorSettings)
    plate: PlateSettings = field(default_factory=PlateSettings)
    motion: MotionSettings = field(default_factory=MotionSettings)


PAPER = GrabCutSettings(
    smoothness=Smoothness(contrast=15.0, temporal=15.0),
    alone=Belief(surprise=0.0, prior=0.0),
    rounds=3,
    coarse=None,
    use_plate=False,
    unseen=0.0,
    network=0.0,
    trimap=PLAIN_TRIMAP,
)
"""The published form; the paper gives no weights, these are the best measured."""

MODEL_ONLY = replace(PAPER, smoothness=Smoothness(contrast=50.0, temporal=0.0))
"""The baseline without the motion cue (Fig. 4, third column; MPC-22), with GrabCut's weight."""

SECOND_PASS = replace(GrabCutSettings(), backed=Belief(surprise=0.1, prior=4.0), coarse=500.0)
"""For a model whose pose was refined already: it is believed more, and looked at more closely."""
