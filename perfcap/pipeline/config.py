"""Settings of a capture. Published weights are converted to house units here and nowhere else.

An energy is a sum of squared residuals measured in *units*: a weight of 1 and a unit of one
standard deviation make it a negative log likelihood (times two), which is how the defaults are
set. The paper's weights were tuned in pixels and millimetres; ``MONOPERFCAP_POSE`` restates them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from perfcap.actor.anatomy import JOINTS
from perfcap.errors import InputError
from perfcap.setting_checks import (
    Settings,
    require_counts,
    require_metres,
    require_radians,
    require_shares,
    require_sizes,
)

# Deviation of predicted 3D joints from the truth, relative to the root, in metres, in the order
# of the landmarks: networks predict hips best and the ends of limbs worst.
_DEVIATION_3D = (
    0.05, 0.03, 0.04, 0.05, 0.07, 0.04, 0.05, 0.07,
    0.016, 0.04, 0.055, 0.07, 0.016, 0.04, 0.055, 0.07,
)  # fmt: skip


@dataclass(frozen=True)
class ReprojectionConfig(Settings):
    """2D joint alignment (Xu et al. 2018, Eq. 4)."""

    weight: float = 1.0
    deviation: float = 1.0  # percent of the person's height in the image
    scale: float | None = 3.0  # deviations where a Geman-McClure kernel lets go; None: quadratic

    def __post_init__(self) -> None:
        super().__post_init__()
        require_sizes(self, "deviation")


@dataclass(frozen=True)
class PositionConfig(Settings):
    """3D joint alignment (Xu et al. 2018, Eq. 5 and 6)."""

    weight: float = 1.0
    deviation: tuple[float, ...] = _DEVIATION_3D  # m
    scale: float | None = 4.0  # deviations where a Geman-McClure kernel lets go; None: quadratic
    gate: float = 0.4  # PCK error, in head lengths, from which a frame's 3D pose is not used
    lasting: float = 12.0  # times as long as errors of 2D joints: see ``weight_of``

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.deviation) != len(_DEVIATION_3D):
            raise InputError(
                f"deviation of PositionConfig has {len(self.deviation)} numbers, expected one for "
                f"each of the {len(_DEVIATION_3D)} landmarks"
            )
        require_metres(self, "deviation")
        require_sizes(self, "gate", "lasting")

    def weight_of(self, views: int) -> float:
        """Weight of 3D poses beside the 2D joints of so many views.

        Errors of 3D poses last: those of a lifter stay alike for 12 to 25 frames, of 2D joints
        for two (integrated autocorrelation, `experiments/two_views.py`), so that as many frames say
        that much less. One view needs what its 3D poses say all the same: nothing else shows depth.
        """
        return self.weight if views == 1 else self.weight / self.lasting


@dataclass(frozen=True)
class TrajectoryConfig(Settings):
    """Temporal prior over a window (Xu et al. 2018, Eq. 7)."""

    weight: float = 1.0
    rank: int = 14  # DCT vectors of a 50-frame window at 30 Hz below the full penalty
    edge: float = 2.0  # penalty of DCT vector k grows as (k / rank)^(2 edge); inf: a sharp edge
    step: float = 0.23  # root penalty just below rank, as a share of the root penalty above it
    translation: float = 500.0  # per m
    rotation: float = 200.0  # per rad
    angles: float = 100.0  # per rad

    def __post_init__(self) -> None:
        super().__post_init__()
        require_counts(self, "rank")
        require_sizes(self, "edge")
        require_shares(self, "step")


@dataclass(frozen=True)
class EvidenceConfig(Settings):
    """What the second solve of a window takes from the first: the prior, and the sizes of errors.

    The trajectory prior of the second solve is ``TrajectoryConfig`` with this rank and edge, and
    with a weight for each of its features that maximises the evidence (docs/method.md).
    """

    enabled: bool = True
    rank: int = 24  # of 50 frames at 30 Hz
    edge: float = 1.25
    share: float = 0.7  # of the weight that the evidence asks for: motion comes in bursts
    strength: float = 10.0  # cosines that the weights of the first solve count as
    tolerance: float = 1e-2  # relative decrease that ends a window of the first solve

    def __post_init__(self) -> None:
        super().__post_init__()
        require_counts(self, "rank")
        require_sizes(self, "edge", "share", "strength")


@dataclass(frozen=True)
class PathConfig(Settings):
    """Paths of the joints as a few cosines with free coefficients (Huang et al. 2017, Eq. 8)."""

    weight: float = 1.0
    rank: int = 10  # cosines of a window
    deviation: float = 0.02  # m, of a joint from its path
    scale: float | None = 3.0  # deviations where a Geman-McClure kernel lets go; None: quadratic

    def __post_init__(self) -> None:
        super().__post_init__()
        require_counts(self, "rank")
        require_metres(self, "deviation")


@dataclass(frozen=True)
class PriorConfig(Settings):
    """Weak preference for the neutral pose; keeps unseen twists at rest.

    From one view it is steep outside of the ranges that are usual: there, poses that few people
    can take need more than the word of one network. Several views show them.
    """

    deviation: float = 1.5  # rad
    alone: float = 0.75  # rad, for one view without 3D joints, where it tells the depth of limbs
    beyond: float = 0.1  # rad, outside of the usual ranges, of one view
    weight: float = 1.0
    poses: float = 0.2  # of the mixture of recorded poses, in windows of two views without 3D

    def __post_init__(self) -> None:
        super().__post_init__()
        require_radians(self, "deviation", "alone", "beyond")


@dataclass(frozen=True)
class ContactConfig(Settings):
    """Feet that stand: a first solve shows the floor and the stances, the second solve keeps them.

    ``capture`` uses it; ``PoseRefiner`` does not.

    Chosen on 14 clips of the CMU library, in one and in four simulated views.
    """

    enabled: bool = True
    weight: float = 1.0
    deviation: float = 0.02  # m, of a point under a foot from where it stands
    depth: float = 0.005  # m, of a point below the floor
    scale: float | None = 4.0  # deviations where a Geman-McClure kernel lets go; None: quadratic
    margin: float = 0.007  # m, below the floor as found, whose height is the mean of noisy feet
    support: float = 0.35  # share of slow points on the plane that makes it a floor

    def __post_init__(self) -> None:
        super().__post_init__()
        require_metres(self, "deviation", "depth")
        require_metres(self, "margin", zero=True)
        require_shares(self, "support")


@dataclass(frozen=True)
class BoneConfig(Settings):
    """Bone lengths solved over the clip."""

    frames: int = 60  # spread over the clip
    size: float = 0.08  # deviation of the log size of people
    own: float = 0.06  # deviation of one bone's log length at a given size
    max_steps: int = 40

    def __post_init__(self) -> None:
        super().__post_init__()
        require_counts(self, "frames")
        require_sizes(self, "size", "own")


@dataclass(frozen=True)
class PoseConfig(Settings):
    """Everything of the skeleton motion."""

    window: int = 50  # frames (MPC-8)
    overlap: int = 10  # frames
    batch: int = 2  # windows solved at once: a CPU's cache holds two, a GPU wants dozens
    initial_batch: int = 500  # frames initialised at once, likewise
    max_steps: int = 30
    tolerance: float = 1e-3  # relative decrease that ends a window; 1e-4 costs half as much again
    damping: float = 1e-2  # of a window's first step, relative to the curvature of the data
    initial_steps: int = 8
    initial_tolerance: float = 1e-3  # likewise, of a frame on its own
    clean: float = 0.15  # jitter, in deviations, below which trajectory and prior weigh less
    cleanest: float = 0.004  # least share of their weights that is kept
    clavicles: bool = True  # shoulders rise with the arms, on actors whose rigs have clavicles
    rest_hands: bool = True  # fingers are bent as at rest, where rigs have them
    initial_widening: float = 5.0  # of the 2D kernel, in the first steps of several views
    widened_steps: int = 6
    reprojection: ReprojectionConfig = field(default_factory=ReprojectionConfig)
    position: PositionConfig = field(default_factory=PositionConfig)
    trajectory: TrajectoryConfig = field(default_factory=TrajectoryConfig)
    paths: PathConfig | None = None
    evidence: EvidenceConfig = field(default_factory=EvidenceConfig)
    prior: PriorConfig = field(default_factory=PriorConfig)
    contact: ContactConfig = field(default_factory=ContactConfig)
    bones: BoneConfig = field(default_factory=BoneConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_counts(self, "window", "batch", "initial_batch")
        require_counts(self, "overlap", "widened_steps", least=0)
        require_sizes(self, "initial_widening")
        require_shares(self, "clean", most=float("inf"))
        require_shares(self, "cleanest")


# Xu et al. 2018, Sec. 4: E_2d + 0.1 E_3d + 50 E_d, lambda_t = 1 per mm, lambda_R = lambda_Theta
# = 600 per rad, K = 8, no robust kernel. Multiplied by |B| N_d = 50 * 16: the means over frames
# and joints become sums, and E_d, a mean over frames only, keeps a factor of 16. The size of the
# paper's image is not stated; its pixel is taken as 1/500 of the person's height, 0.2 %.
MONOPERFCAP_POSE = PoseConfig(
    reprojection=ReprojectionConfig(weight=1.0, deviation=0.2, scale=None),
    position=PositionConfig(weight=0.1, deviation=(0.001,) * 16, scale=None),
    trajectory=TrajectoryConfig(
        weight=50.0 * 16,
        rank=8,
        edge=float("inf"),
        translation=1000.0,
        rotation=600.0,
        angles=600.0,
    ),
    prior=PriorConfig(weight=1e-6),
    evidence=EvidenceConfig(enabled=False),
    contact=ContactConfig(enabled=False),
    clean=0.0,
    clavicles=False,
    rest_hands=False,
)

# Huang et al. 2017, Sec. IV: frames on their own, then windows of 30 whose joints follow ten
# cosines with free coefficients; nothing else ties frames together. The weights and the constants
# of the kernels are not stated there and are ours.
MUVS_POSE = PoseConfig(
    window=30,
    trajectory=TrajectoryConfig(weight=1e-6),
    paths=PathConfig(rank=10),
    evidence=EvidenceConfig(enabled=False),
    contact=ContactConfig(enabled=False),
    clean=0.0,
    clavicles=False,
    rest_hands=False,
)


_TURNS = {
    "pelvis": 3.0, "spine": 4.0, "neck": 15.0, "head": 6.0,
    "l_shoulder": 15.0, "r_shoulder": 15.0, "l_elbow": 40.0, "r_elbow": 40.0,
    "l_hip": 15.0, "r_hip": 15.0, "l_ankle": 6.0, "r_ankle": 6.0,
}  # fmt: skip


@dataclass(frozen=True)
class RetargetConfig(Settings):
    """Deviations of what a retargeted motion should keep of its source.

    Attributes:
        limbs: directions of upper arms, forearms, thighs and shanks, degrees.
        turns: orientations of joints, degrees; what is not named is free.
        reach: of the wrists from the shoulders, m.
        together: of the wrists from each other, m, while they are near.
        near: distance of the wrists of the source at which that counts a quarter, m.
        root: of the hips from their scaled place, m.
        contact: how feet that stand are found.
        feet: of feet that stand from their places, m.
        depth: of feet below the floor, m.
        change: of what contacts change, whose high frequencies have these deviations: m, degrees
            and degrees, of the place, the root's rotation and the angles.
        edge: cosines of a change that are low frequencies.
        still: of the hinges of robots from the frame before, degrees.
        speed: the largest of the hinges of robots, degrees a second; a fast elbow punches so.
        frames: solved at once.
        steps: of the solver.
    """

    limbs: float = 2.0
    turns: Mapping[str, float] = field(default_factory=lambda: dict(_TURNS))
    reach: float = 0.01
    together: float = 0.03
    near: float = 0.12
    root: float = 0.03
    contact: ContactConfig = field(default_factory=lambda: ContactConfig(scale=None, margin=0.0))
    feet: float = 0.003
    depth: float = 0.002
    change: tuple[float, float, float] = (0.003, 0.5, 1.0)
    edge: TrajectoryConfig = field(default_factory=TrajectoryConfig)
    still: float = 15.0
    speed: float = 1500.0
    frames: int = 128
    steps: int = 40

    def __post_init__(self) -> None:
        super().__post_init__()
        require_metres(self, "reach", "together", "near", "root", "feet", "depth")
        require_sizes(self, "limbs", "still", "speed")
        require_counts(self, "frames", "steps")
        strange = sorted(set(self.turns) - set(JOINTS))
        if strange or min(self.change) <= 0:
            raise InputError(
                f"turns are of {', '.join(strange) or 'joints'} and change is {self.change}; "
                f"expected joints among {', '.join(JOINTS)}, and numbers above zero"
            )
