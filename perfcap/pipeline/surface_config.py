"""Settings of silhouettes, pose refinement and surface refinement (Xu et al. 2018, Sec. 5).

As in ``config``, a weight of 1 and a unit of one standard deviation make a residual's square a
negative log likelihood (times two); lengths in the image are percents of the person's height.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from perfcap.segment import Matching, SequenceSettings
from perfcap.segment.label_people import PeopleSettings
from perfcap.segment.settings import PAPER, SECOND_PASS
from perfcap.setting_checks import (
    Settings,
    require_counts,
    require_metres,
    require_radians,
    require_shares,
    require_sizes,
)


@dataclass(frozen=True)
class SilhouetteConfig(Settings):
    """Automatic silhouettes (Xu 2018, Sec. 5.1)."""

    first: SequenceSettings = field(default_factory=SequenceSettings)
    # from the refined pose, which says more about where the person is
    again: SequenceSettings = field(default_factory=lambda: SequenceSettings(frame=SECOND_PASS))
    # of several people: how often who is where is found once more from the refined surfaces, where
    # people are near each other, with surfaces refined anew in between
    closer: int = 2
    # how people are told apart
    people: PeopleSettings = field(default_factory=PeopleSettings)


@dataclass(frozen=True)
class ContourConfig(Settings):
    """Alignment of the model's contours with those of the silhouettes (Xu 2018, Eq. 11, 17)."""

    weight: float = 30.0  # independent observations that a frame's contour is worth
    deviation: float = 0.4  # percent of the person's height in the image
    scale: float | None = 3.0  # deviations where a Geman-McClure kernel lets go; None: quadratic
    # confidence of a contour that images say nothing about, which pulls nothing
    chance: float = 0.4
    spacing: float = 3.0  # px between the model's contour points
    matching: Matching = field(default_factory=Matching)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_sizes(self, "deviation", "spacing", *(() if self.scale is None else ("scale",)))
        require_shares(self, "chance")


@dataclass(frozen=True)
class RefinePoseConfig(Settings):
    """Silhouette-based pose refinement (Xu 2018, Eq. 10 to 12)."""

    rounds: int = 3  # correspondence searches (MPC-23)
    max_steps: int = 5  # of each round
    tolerance: float = 1e-3
    contour: ContourConfig = field(default_factory=ContourConfig)
    stabilization: float = 0.1  # weight of Eq. 12
    deviation: float = 0.03  # m, of a joint from where the motion had it
    # keep the detections and the temporal prior of the motion; the paper refines single frames,
    # held by their joints alone
    whole: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        require_metres(self, "deviation")


@dataclass(frozen=True)
class RefineCamerasConfig(Settings):
    """Fixed cameras that may stand a little elsewhere, by the silhouettes in them; off by default.

    Attributes:
        enabled: whether they may.
        frames: of the clip, spread over it, whose silhouettes are looked at.
        rounds: correspondence searches.
        max_steps: of each round.
        turn: deviation of the directions of cameras from what is stated, radians.
        shift: deviation of their places, metres.
        contour: alignment of contours.
        stabilization: weight of the joints' mean squared distance from where the motion has them.
        deviation: m, that counts as one in it.
    """

    enabled: bool = False
    frames: int = 24
    rounds: int = 4
    max_steps: int = 5
    turn: float = 0.01
    shift: float = 0.03
    contour: ContourConfig = field(default_factory=ContourConfig)
    stabilization: float = 0.1
    deviation: float = 0.03

    def __post_init__(self) -> None:
        super().__post_init__()
        require_counts(self, "frames", "rounds", "max_steps")
        require_radians(self, "turn")
        require_metres(self, "shift", "deviation")


@dataclass(frozen=True)
class RefineSurfaceConfig(Settings):
    """Silhouette-based surface refinement (Xu 2018, Eq. 16 to 18)."""

    nodes: int = 1000  # of the deformation graph (MPC-26)
    rigidity: tuple[float, ...] = (0.6, 0.2)  # weight of each round (MPC-29)
    max_steps: int = 5  # of each round
    contour: ContourConfig = ContourConfig(
        scale=4.0, matching=Matching(support=(0.3, 0.6), hold=0.01)
    )
    stretch: float = 0.003  # m, of an edge of the graph
    tether: float = 0.3  # weight of the mean squared displacement of nodes; the paper has none
    reach: float = 0.03  # m, that counts as one in it
    folds: float = 0.003  # share of a frame's area that may fold over
    smoothing: int = 5  # frames of the centred window (MPC-31)
    # rigidity of each layer of one round after it: what smoothing took off; the paper has none
    settle: tuple[float, ...] = (3.0, 3.0, 3.0)
    settle_smoothing: int = 5  # frames

    def __post_init__(self) -> None:
        super().__post_init__()
        require_counts(self, "nodes", "smoothing", "settle_smoothing")
        require_metres(self, "stretch", "reach")
        require_shares(self, "folds")


# Xu et al. 2018, Sec. 5: GrabCut from the model with the motion cue; single frames refined with
# w_stab = 0.06 per square millimetre; two rounds of 0.6 and 0.2, then smoothing. The paper's
# pixel is taken as 0.2 % of the person's height, as in ``MONOPERFCAP_POSE``, and its unit of
# length as a millimetre.
_PAPER_CONTOUR = ContourConfig(weight=1.0, deviation=0.2, scale=None)
MONOPERFCAP_SILHOUETTES = SilhouetteConfig(*2 * (SequenceSettings(frame=PAPER),))
MONOPERFCAP_REFINE_POSE = RefinePoseConfig(
    contour=_PAPER_CONTOUR, stabilization=0.06, deviation=0.001, whole=False
)
MONOPERFCAP_REFINE_SURFACE = RefineSurfaceConfig(
    contour=_PAPER_CONTOUR, stretch=0.001, tether=0.0, settle=()
)
