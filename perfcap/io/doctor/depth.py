"""Whether the depth of 3D poses is in the unit of width and height: bones keep their length."""

from __future__ import annotations

from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.doctor.finding import Finding, Severity

_LIMBS = (("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle"))
_BONES = [
    [LANDMARKS.index(f"{side}_{end}") for end in ends]
    for side in "lr"
    for limb in _LIMBS
    for ends in (limb[:2], limb[1:])
] + [[LANDMARKS.index(f"{end}_{name}") for end in "lr"] for name in ("hip", "shoulder")]
_FLAT = 0.01  # of a pose's size, in depth; who stands at attention has ten times as much
# Factors of the depth, and of those the least that are named: lengths of three networks and of
# simulated detectors are steadiest with 0.7 to 1.4
_FACTORS = [2 ** (step / 4) for step in range(-8, 9)]
_ANOTHER = 1.9
# Spread of lengths as it is, logarithm, below which errors explain it, and share of it
_LOOSE, _STEADIER = 0.15, 0.7
_FEWEST = 10  # frames


def examine_depth(name: str, poses: Tensor) -> list[Finding]:
    """Poses without depth, and such as have bones of steadier lengths with twice or half of it.

    Args:
        name: of the view.
        poses: in camera axes, (F, 16, 3), metres.
    """
    spans = poses.amax(1) - poses.amin(1)
    size, depth = float(spans.norm(dim=-1).median()), float(spans[:, 2].median())
    if depth < _FLAT * size:
        what = f"3D poses are flat: from end to end they span {size:.3g} m, in depth {depth:.2g} m"
        remedy = (
            "leave 3D joints out where their depth is not known, or give z in metres as x and y"
        )
        return [Finding(Severity.WARNING, name, what, remedy)]
    if len(poses) < _FEWEST:
        return []
    ends = poses[:, _BONES]
    bones = ends[..., 0, :] - ends[..., 1, :]
    spreads = [_spread(bones * bones.new_tensor([1.0, 1.0, factor])) for factor in _FACTORS]
    best = min(range(len(spreads)), key=spreads.__getitem__)
    factor = _FACTORS[best]
    loose = spreads[len(_FACTORS) // 2]
    steadier = loose > _LOOSE and spreads[best] < _STEADIER * loose
    if not steadier or 1 / _ANOTHER < factor < _ANOTHER:
        return []
    what = f"with {factor:.2g} times the depth, bones of the 3D poses would keep their lengths"
    remedy = "give z in metres as x and y"
    return [Finding(Severity.WARNING, name, what, remedy)]


def _spread(bones: Tensor) -> float:
    """How much the lengths of bones (F, B, 3) change over the frames, mean of the logarithms."""
    lengths = bones.norm(dim=-1).clamp(min=1e-3).log()
    low, high = lengths.quantile(lengths.new_tensor([0.1, 0.9]), dim=0)
    return float((high - low).mean())
