"""Settings of training. Nothing heavy is imported here: the command line reads them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from perfcap.errors import InputError
from perfcap.setting_checks import (
    require_amounts,
    require_counts,
    require_elevation,
    require_range,
    require_shares,
    require_sizes,
)

# What is beyond is of another unit: seconds of a frame, millimetres, percents
_RATES, _DISTANCES, _ZOOMS = (1.0, 1000.0), (0.5, 100.0), (0.1, 10.0)


@dataclass(frozen=True)
class LoopConfig:
    """How to train."""

    steps: int = 6000
    batch: int = 256  # samples a step and process
    learning_rate: float = 2e-3  # at its peak
    warmup: int = 100  # steps until it is reached
    weight_decay: float = 0.02
    average: float = 0.998  # weights kept from step to step in the running mean that is evaluated
    clip: float = 1.0  # norm of the gradient
    seed: int = 0
    evaluate_every: int = 200  # steps
    save_every: int = 100  # steps

    def require_sound(self) -> None:
        """Refuse what learns nothing.

        Raises:
            InputError: a count below 1, or a number that is out of its range.
        """
        for name in ("steps", "batch", "evaluate_every", "save_every"):
            if getattr(self, name) < 1:
                raise InputError(f"loop.{name}: is {getattr(self, name)}; expected 1 or more")
        if not 0 <= self.seed < 2**32:
            raise InputError(f"loop.seed: is {self.seed}; expected 0 to {2**32 - 1}")
        for name in ("learning_rate", "clip"):
            if not 0 < getattr(self, name) < math.inf:
                raise InputError(f"loop.{name}: is {getattr(self, name)}; expected above zero")
        if not (0 <= self.average < 1 and 0 <= self.weight_decay < math.inf and self.warmup >= 0):
            raise InputError(
                f"loop: average, weight_decay and warmup are {self.average}, {self.weight_decay} "
                f"and {self.warmup}; expected 0 to below 1, and from 0 on"
            )


@dataclass(frozen=True)
class LifterConfig:
    """Size of a lifter."""

    channels: int = 256
    dilations: tuple[int, ...] = (1, 3, 9, 27)  # frames between the three taps of each block
    dropout: float = 0.0

    @property
    def reach(self) -> int:
        """Frames either side that an answer depends on."""
        return sum(self.dilations)


@dataclass(frozen=True)
class LiftingLoss:
    """Weights of the parts."""

    velocity: float = 3.0  # of the error of steps from frame to frame, against that of places
    spread: float = 0.02  # of the likelihood of the errors under the expected spread


@dataclass(frozen=True)
class DetectorNoise:
    """How 2D detectors err. Sizes in units, 1 % of a standing person's height; rates a frame."""

    offset: float = 1.0  # of a joint, for a whole clip
    drift: float = 0.75  # deviation of what changes slowly
    keep: float = 0.85  # share of the drift that is left after a frame at 30 Hz
    jitter: float = 0.25  # deviation of what is new every frame
    spread: float = 0.5  # deviation of the log size of all this from clip to clip
    outliers: float = 0.005  # joints anywhere in the body's box
    swaps: float = 0.004  # left and right exchanged, arms or legs or both
    slips: float = 0.003  # a limb, or the end of one, seen elsewhere for 4 to 64 frames
    slide: float = 12.0  # deviation of how far
    doubled: float = 0.4  # share of clips in which that is on the other limb
    gaps: float = 0.004  # a joint unseen for some frames
    blinks: float = 0.001  # nobody seen for some frames
    absent: float = 0.15  # share of clips whose detector has no crown; likewise no toes
    hidden: float = 0.08  # share of clips in which a limb is never seen


@dataclass(frozen=True)
class LiftingData:
    """What tracks are made of."""

    frames: int = 96  # of a track
    rate: tuple[float, float] = (24.0, 36.0)  # frames a second, evenly drawn
    distance: tuple[float, float] = (2.2, 9.0)  # m, evenly in the logarithm
    elevation: tuple[float, float] = (8.0, 14.0)  # degrees above the person, mean and deviation
    roll: float = 4.0  # degrees, deviation
    size: float = 0.05  # deviation of the log size of people
    bone: float = 0.04  # deviation of the log length of one bone, the same left and right
    recombined: float = 0.5  # share of tracks with the arms or the upper body of another clip
    loosened: float = 6.0  # degrees, deviation that limbs are turned by for a whole track
    swung: float = 2.5  # factor of it for arms
    seen: float = 0.25  # share of tracks that networks found in videos, where some are given
    noise: DetectorNoise = field(default_factory=DetectorNoise)


@dataclass(frozen=True)
class TrainLifterConfig:
    """Everything that a lifter depends on, but for the recorded motion."""

    held_out: tuple[str, ...] = ("06",)  # people to report on
    validation: tuple[str, ...] = ("07",)  # people that the best weights are chosen by
    dense: float = 0.15
    """Share of the steps, at the end, that learn from whole tracks; all, for taps not 1 3 9 ..."""
    loop: LoopConfig = field(default_factory=LoopConfig)
    lifter: LifterConfig = field(default_factory=LifterConfig)
    data: LiftingData = field(default_factory=LiftingData)
    loss: LiftingLoss = field(default_factory=LiftingLoss)

    def require_sound(self) -> None:
        """Refuse what no lifter can be made of.

        Raises:
            InputError: a size, a share, a weight or a range that is none.
        """
        self.loop.require_sound()
        require_counts(self.lifter, "channels")
        require_counts(self.data, "frames", least=2)  # velocities are learned too
        require_elevation("data.elevation", self.data.elevation)
        taps = self.lifter.dilations
        if not taps or min(taps) < 1:
            raise InputError(f"lifter.dilations: are {taps}; expected one or more of 1 or more")
        require_shares(self, "dense")
        require_shares(self.lifter, "dropout")
        noise = ("keep", "outliers", "swaps", "slips", "doubled", "gaps", "blinks")
        require_shares(self.data.noise, *noise, "absent", "hidden")
        require_shares(self.data, "recombined", "seen")
        require_amounts(self.data.noise, "offset", "drift", "jitter", "spread", "slide")
        require_amounts(self.data, "roll", "loosened", "swung")
        require_shares(self.data, "size", "bone")  # a deviation of 1 is a factor of 2.7
        require_amounts(self.loss, "velocity", "spread")
        require_range("data.rate", self.data.rate, _RATES, "frames a second")
        require_range("data.distance", self.data.distance, _DISTANCES, "metres")


# --------------------------------------------------------------------------------------------------
# Settings of detectors' training. Nothing heavy is imported here: the command line reads them.


@dataclass(frozen=True)
class DetectorConfig:
    """Size of a detector."""

    size: int = 224  # pixels along each side of the crop it sees
    widths: tuple[int, ...] = (24, 48, 96, 160)  # channels at a 4th, 8th, 16th, 32nd of them
    blocks: tuple[int, ...] = (1, 3, 5)  # residual blocks of the last three


@dataclass(frozen=True)
class SceneData:
    """Rendered people."""

    size: int = 288  # pixels of a stored crop
    margin: float = 1.7  # size of it, in boxes around the joints
    group: int = 8  # pictures of a person in one outfit
    places: int = 3  # backgrounds that these are taken before
    texture: int = 384  # pixels along a texture
    recombined: float = 0.3  # share of poses with arms and legs of different frames
    loosened: float = 9.0  # degrees, deviation that joints are turned by at random
    swung: float = 2.5  # factor of it for arms
    facing: float = 0.4  # share made to face the camera's side; others face anywhere
    tilted: float = 0.04  # share of poses turned over in any direction
    skirts: float = 0.3  # share of outfits with a skirt or coat
    actors: float = 0.2  # share of people who are actors with clothes of their own
    distance: tuple[float, float] = (2.0, 9.0)  # m, evenly in the logarithm
    elevation: tuple[float, float] = (8.0, 14.0)  # degrees above the person, mean and deviation
    roll: float = 4.0  # degrees, deviation
    shadowed: float = 0.3  # share with shadows on the body
    occluded: float = 0.15  # share with something in front of the person
    empty: float = 0.03  # share without a person


@dataclass(frozen=True)
class Augmentation:
    """What is done to a stored crop each time it is shown."""

    moved: float = 0.75  # share of people before another background, if there are pictures of some
    camouflaged: float = 0.45  # of these, before the colours of a part of them
    zoom: tuple[float, float] = (0.85, 1.2)  # of the size a person is followed at
    small: float = 0.04  # share that is shown much smaller, as in a search of the image
    smallest: float = 0.4  # of the usual size
    turn: float = 9.0  # degrees, deviation
    shift: float = 0.08  # of the crop, deviation
    blur: float = 0.2  # shares of crops
    noise: float = 0.2
    jpeg: float = 0.15
    cut: float = 0.15  # crops that lose rectangles or discs
    grey: float = 0.04

    def require_zooms(self) -> None:
        """Refuse sizes of people that are no ranges, as where those shown smaller are larger."""
        require_range("augmentation.zoom", self.zoom, _ZOOMS, "of the usual size")
        require_sizes(self, "smallest")
        if self.small > 0 and self.smallest > self.zoom[0]:
            raise InputError(
                f"augmentation.smallest: is {self.smallest}, but augmentation.zoom begins at "
                f"{self.zoom[0]}, where the sizes of people shown smaller end; expected at most "
                "that, or augmentation.small 0, which shows none smaller"
            )


@dataclass(frozen=True)
class DetectorLoss:
    """Weights of the parts."""

    deviation: float = 1.0  # of the target about a joint, in pixels of the heat map
    places: float = 3.0  # of location maps (m) against the cross entropy of heat maps (nats)
    pose: float = 6.0  # of the pose guessed from the whole crop (m)
    parts: float = 1.0  # of the parts of the body (nats a pixel of the person)
    nowhere: float = 0.2  # of joints outside of the crop, whose heat map is to be even


@dataclass(frozen=True)
class TrainDetectorConfig:
    """Everything that a detector depends on, but for motion and pictures."""

    held_out: tuple[str, ...] = ("05", "06")  # people whose motion is not shown
    validation: tuple[str, ...] = ("07",)  # people that the best weights are chosen by
    crops: int = 30000
    """Stored before training, in whole parts; each is shown again and again, never alike."""
    validation_crops: int = 512  # to score, in whole parts
    sizes: tuple[tuple[float, int], ...] = ((0.0, 128), (0.45, 160), (0.75, 192), (0.92, 224))
    """Pixels of the crops shown, each from a share of the steps on: small ones are cheaper."""
    loop: LoopConfig = field(
        default_factory=lambda: LoopConfig(
            steps=52000,
            batch=32,
            average=0.998,
            evaluate_every=1000,
            save_every=500,
        )
    )
    detector: DetectorConfig = field(default_factory=DetectorConfig)
    scene: SceneData = field(default_factory=SceneData)
    augmentation: Augmentation = field(default_factory=Augmentation)
    loss: DetectorLoss = field(default_factory=DetectorLoss)

    def require_sound(self) -> None:
        """Refuse what no detector can be made of.

        Raises:
            InputError: a size, a share, a weight or a range that is none.
        """
        self.loop.require_sound()
        require_counts(self, "crops", "validation_crops")
        require_counts(self.detector, "size")
        require_counts(self.scene, "group", "places", "texture")
        require_counts(self.scene, "size", least=4)  # a pixel of the maps of parts
        for name, count in (("widths", 4), ("blocks", 3)):
            sizes = getattr(self.detector, name)
            if len(sizes) != count or min(sizes) < 1:
                raise InputError(f"detector.{name}: are {sizes}; expected {count} of 1 or more")
        require_elevation("scene.elevation", self.scene.elevation)
        shares = ("recombined", "facing", "tilted", "skirts", "actors", "shadowed", "occluded")
        require_shares(self.scene, *shares, "empty")
        require_amounts(self.scene, "loosened", "swung", "roll")
        require_sizes(self.scene, "margin", finite=True)
        shown = ("moved", "camouflaged", "small", "blur", "noise", "jpeg", "cut", "grey")
        require_shares(self.augmentation, *shown)
        require_amounts(self.augmentation, "turn", "shift")
        require_sizes(self.loss, "deviation", finite=True)
        require_amounts(self.loss, "places", "pose", "parts", "nowhere")
        require_range("scene.distance", self.scene.distance, _DISTANCES, "metres")
        self.augmentation.require_zooms()


# --------------------------------------------------------------------------------------------------
# Settings of a head's training. Nothing heavy is imported here: the command line reads them.


@dataclass(frozen=True)
class HeadCrops:
    """Crops that a frozen network looks at, of every frame and view."""

    frames: int = 240  # at most, evenly over the clip
    moved: int = 6  # crops beside the one that a capture would cut
    shift: float = 0.04  # of the crop's width, deviation
    zoom: float = 0.1  # deviation of the logarithm of the size
    turn: float = 7.0  # degrees, deviation
    mirrored: bool = True  # look at mirror images as well


@dataclass(frozen=True)
class HeadLoss:
    """What a head learns by."""

    decays: tuple[float, ...] = (1e-5, 1e-4, 1e-3, 1e-2)  # of the weights, tried
    stay: float = 1.0  # of the weights' squared distance from where the solver took over
    reach: float = 5.0  # percent of the person's height where a wrong joint counts half


@dataclass(frozen=True)
class TrainHeadConfig:
    """Everything that a head depends on, but for the videos."""

    held_out: float = 0.2  # share of the frames, the last ones, that the best weights are chosen by
    window: int = 40  # frames that are solved together, at most
    crops: HeadCrops = field(default_factory=HeadCrops)
    loss: HeadLoss = field(default_factory=HeadLoss)
    loop: LoopConfig = field(
        default_factory=lambda: LoopConfig(
            steps=30,
            batch=8,
            learning_rate=1e-3,
            warmup=5,
            weight_decay=0.0,
            average=0.8,
            evaluate_every=5,
            save_every=5,
        )
    )

    def require_sound(self) -> None:
        """Refuse what no head can be made of.

        Raises:
            InputError: a size, a share, a weight or a range that is none.
        """
        self.loop.require_sound()
        require_counts(self, "window", least=2)
        require_counts(self.crops, "frames", least=10)
        require_counts(self.crops, "moved", least=0)
        require_amounts(self.crops, "shift", "zoom", "turn")
        require_amounts(self.loss, "stay")
        require_sizes(self.loss, "reach", finite=True)
        if not 0.05 <= self.held_out <= 0.5:
            raise InputError(f"held_out: is {self.held_out}; expected a share of 0.05 to 0.5")
        if not self.loss.decays or not all(0 < d < math.inf for d in self.loss.decays):
            raise InputError(f"loss.decays: are {self.loss.decays}; expected some above zero")
