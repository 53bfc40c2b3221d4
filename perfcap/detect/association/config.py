"""Sizes that tell one person from two."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class AssociationConfig:
    """Lengths in metres at the person, times in seconds; all are about people, none about a clip.

    Attributes:
        same: mean distance of the joints' rays up to which detections of two views may be of one
            person; detectors are off by a few centimetres, the next person is farther away.
        patience: how much more each further view may add to it, as a share.
        robust: distance at which a joint's ray counts half.
        saturated: distance beyond which a joint is wrong, whatever it is.
        least_joints: that two views must both see.
        reach: half the size of people, least and most.
        apart: median distance of joints below which two skeletons are one.
        beside: the same of somebody new: nobody appears inside of somebody else.
        stray: how far somebody is from where they were expected, beyond their speed.
        speed: of people, m/s.
        memory: how long somebody may be unseen and still be known by place alone.
        smooth: standard deviation of the time in which places are averaged.
        shortest: a track below this, and below a tenth of the clip, is nobody.
        torn: share of a track's frames in which views of one person may fall apart in two.
        bones: root-mean-square difference of log bone lengths up to which two tracks may be one
            person who was away.
        confident: detections below are not looked at.
        mirrored: what it costs to take left for right, m, where a detector does so.
        clearer: how much nearer a limb must be to somebody else, m, to be theirs.
        twice: mean distance, as a share of the person's size in the image, of a detection that is
            listed twice.
    """

    same: float = 0.10
    patience: float = 0.15
    robust: float = 0.06
    saturated: float = 0.4
    least_joints: int = 5
    reach: tuple[float, float] = (0.15, 1.4)
    apart: float = 0.12
    beside: float = 0.25
    stray: float = 0.3
    speed: float = 8.0
    memory: float = 1.0
    smooth: float = 0.05
    shortest: float = 1.0
    torn: float = 0.6
    bones: float = 0.06
    confident: float = 0.1
    mirrored: float = 0.02
    clearer: float = 0.1
    twice: float = 0.02
