"""Heat maps to joints: exact peaks for use, expectations for training, and a head to train."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from itertools import pairwise

import torch
from torch import Tensor, nn

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS16, JointSet, find_joint_set, map_to_landmarks
from perfcap.errors import InputError
from perfcap.geometry.plain import is_readable
from perfcap.setting_checks import require_count, require_size

_TINY = 1e-10
_PIXELS = 64  # of a map; fewer may lie from 0 to 1 by chance


def argmax2d(maps: Tensor) -> tuple[Tensor, Tensor]:
    """Largest pixel of maps (..., h, w): its (x, y), (..., 2), and its value, (...)."""
    value, index = maps.flatten(-2).max(-1)
    width = maps.shape[-1]
    return torch.stack((index % width, index // width), -1).to(maps), value


def decode_quarter(maps: Tensor) -> tuple[Tensor, Tensor]:
    """Peaks moved a quarter pixel towards the higher neighbour (Newell et al. 2016).

    Args:
        maps: (..., h, w).

    Returns:
        Points (..., 2) in map pixels, x and y, and the values at the peaks, (...). Peaks on the
        border are not moved.
    """
    peak, value = argmax2d(maps)
    around = _patch(maps, peak)
    inside = _interior(maps, peak)
    step = torch.stack(
        (around[..., 1, 2] - around[..., 1, 0], around[..., 2, 1] - around[..., 0, 1]), -1
    )
    return peak + 0.25 * step.sign() * inside[..., None], value


def decode_dark(maps: Tensor, sigma: float = 1.0) -> tuple[Tensor, Tensor]:
    """Peaks by one Newton step on the logarithm of the smoothed map (Zhang et al. 2020, DARK).

    Exact where the map is a Gaussian. Arguments and returns as ``decode_quarter``; steps of more
    than a pixel, and maps that do not curve down at their peak, keep the pixel.
    """
    peak, value = argmax2d(maps)
    log = _blurred_patch(maps, peak, sigma).clamp(min=_TINY).log()
    dx = 0.5 * (log[..., 1, 2] - log[..., 1, 0])
    dy = 0.5 * (log[..., 2, 1] - log[..., 0, 1])
    dxx = log[..., 1, 2] - 2 * log[..., 1, 1] + log[..., 1, 0]
    dyy = log[..., 2, 1] - 2 * log[..., 1, 1] + log[..., 0, 1]
    dxy = 0.25 * (log[..., 2, 2] - log[..., 2, 0] - log[..., 0, 2] + log[..., 0, 0])
    determinant = dxx * dyy - dxy.square()
    curved = (determinant > _TINY) & (dxx < 0) & _interior(maps, peak)
    safe = torch.where(curved, determinant, 1.0)
    step = -torch.stack((dyy * dx - dxy * dy, dxx * dy - dxy * dx), -1) / safe[..., None]
    usable = curved & (step.abs() < 1).all(-1)
    return peak + torch.where(usable[..., None], step, 0.0), value


def soft_argmax(logits: Tensor) -> tuple[Tensor, Tensor]:
    """Expected place under the softmax of a map, and its spread; both differentiable.

    Args:
        logits: (..., h, w), any real numbers.

    Returns:
        Points (..., 2) in map pixels, x and y, and the standard deviation, (...), map pixels:
        the root of the trace of the covariance. Warns of maps that a softmax or a sigmoid has been
        through: another softmax leaves the middle of the map, whatever they show.
    """
    if is_readable(logits) and _are_shares(logits):
        warnings.warn(
            "soft_argmax: all values lie from 0 to 1, as of a softmax or a sigmoid, of which the "
            "softmax leaves hardly more than the middle; give what the network says before it, or "
            "the logarithm of a softmax",
            stacklevel=2,
        )
    return _expected(logits)


def _expected(logits: Tensor) -> tuple[Tensor, Tensor]:
    """``soft_argmax``, without a look at the numbers."""
    height, width = logits.shape[-2:]
    share = logits.flatten(-2).softmax(-1).reshape(logits.shape)
    x = torch.arange(width, dtype=logits.dtype, device=logits.device)
    y = torch.arange(height, dtype=logits.dtype, device=logits.device)
    columns, rows = share.sum(-2), share.sum(-1)
    mean_x, mean_y = (columns * x).sum(-1), (rows * y).sum(-1)
    # about the mean: differences of large squares would cancel
    spread = (columns * (x - mean_x[..., None]).square()).sum(-1)
    spread = spread + (rows * (y - mean_y[..., None]).square()).sum(-1)
    return torch.stack((mean_x, mean_y), -1), (spread + _TINY).sqrt()


def _are_shares(logits: Tensor) -> bool:
    """Whether maps (..., h, w) are of many pixels that all lie from 0 to 1, and differ."""
    if logits[..., 0, 0].numel() * _PIXELS > logits.numel():
        return False
    low, high = (float(end) for end in logits.detach().aminmax())
    return low >= 0 and low < high <= 1


DECODERS: dict[str, Callable[[Tensor], tuple[Tensor, Tensor]]] = {
    "argmax": decode_quarter,
    "dark": decode_dark,
}


def map_to_input(points: Tensor, maps: tuple[int, int], size: tuple[int, int], how: str) -> Tensor:
    """Map pixels to pixels of the network's input.

    Args:
        points: (..., 2), x and y.
        maps: (h, w) of the maps.
        size: (H, W) of the input.
        how: ``scale``, ``corners`` or ``centers``; see ``OutputSpec.alignment``.

    Raises:
        InputError: ``how`` is something else.
    """
    small = points.new_tensor([maps[1], maps[0]])
    large = points.new_tensor([size[1], size[0]])
    if how == "corners":
        return points * (large - 1) / (small - 1).clamp(min=1)
    if how == "centers":
        return (points + 0.5) * large / small - 0.5
    if how != "scale":
        raise InputError(f"how is {how!r:.40}, expected scale, corners or centers")
    return points * large / small


class HeatmapHead(nn.Module):
    """Features of any backbone to heat maps and, differentiably, to ``Detections``.

    Transposed convolutions double the features' resolution (Xiao et al. 2018), a 1x1 convolution
    makes a map a joint, the soft-argmax reads them (Sun et al. 2018).

    Args:
        channels: of the features.
        joints: what the maps are of, or the name of a known set.
        doublings: how often the resolution is doubled.
        hidden: channels between.
        spread: standard deviation of a map, in map pixels, at which confidence is a half.
            It falls slowly: maps that were never trained are spread over all pixels, and have to
            learn from the little that they weigh.

    Raises:
        InputError: the joint set is not known, or a number is none.
    """

    def __init__(
        self,
        channels: int,
        joints: JointSet | str = LANDMARKS16,
        doublings: int = 0,
        hidden: int = 64,
        spread: float = 3.0,
    ) -> None:
        super().__init__()
        require_count(channels, "channels")
        require_count(doublings, "doublings", least=0)
        require_count(hidden, "hidden")
        require_size(spread, "spread", finite=True)
        self.channels = channels
        self.joint_set = joints = find_joint_set(joints, "joints")
        widths = [channels, *[hidden] * doublings]
        layers: list[nn.Module] = []
        for before, after in pairwise(widths):
            layers += [
                nn.ConvTranspose2d(before, after, 4, 2, 1, bias=False),
                nn.BatchNorm2d(after),
                nn.ReLU(inplace=True),
            ]
        self.upsample = nn.Sequential(*layers)
        self.maps = nn.Conv2d(widths[-1], len(joints), 1)
        self.spread: Tensor
        self.register_buffer("spread", torch.tensor(float(spread)))

    def logits(self, features: Tensor) -> Tensor:
        """Heat maps (..., J, H, W), before the softmax, of features (..., channels, h, w)."""
        self._require_features(features)
        lead = features.shape[:-3]
        flat = self.maps(self.upsample(features.flatten(0, -4) if lead else features[None]))
        logits: Tensor = flat.reshape(*lead, *flat.shape[-3:])
        return logits

    def forward(self, features: Tensor, to_image: Tensor) -> Detections:
        """Joints in image pixels with gradients back to the features; float32 within autocast too.

        Args:
            features: (*b, F, C, channels, h, w).
            to_image: affine map from heat-map pixels to image pixels, (*b, F, C, 2, 3).

        Raises:
            InputError: one is no tensor of floats of such a shape; maps may be shared by
                frames or views.
        """
        logits = self.logits(features)
        _require_maps(to_image, features.shape[:-3])
        # pixels of an image are whole eights in bfloat16, whatever a network computes in
        kind = torch.promote_types(logits.dtype, torch.float32)
        with torch.autocast(logits.device.type, enabled=False):
            points, spread = _expected(logits.to(kind))
            to_image = to_image.to(kind)
            pixels = points @ to_image[..., :2].mT + to_image[..., None, :, 2]
        confidence = 1 / (1 + (spread / self.spread).square())
        joints2d, trust = map_to_landmarks(pixels, confidence, self.joint_set)
        return Detections.from_joints(joints2d, trust)

    def _require_features(self, features: Tensor) -> None:
        """Refuse what are no maps (..., channels, h, w) of floats."""
        _require_floats(features, "features")
        channels = self.channels
        if features.dim() < 3 or features.shape[-3] != channels:
            raise InputError(
                f"features: have shape {tuple(features.shape)}, expected (..., {channels}, h, w): "
                f"maps of {channels} channels"
            )


def _require_floats(values: Tensor, name: str) -> None:
    if not isinstance(values, Tensor) or not values.is_floating_point():
        kind = values.dtype if isinstance(values, Tensor) else f"a {type(values).__name__}"
        raise InputError(f"{name}: are {kind}, expected a tensor of floats; convert with float()")


def _require_maps(to_image: Tensor, lead: torch.Size) -> None:
    """Refuse affine maps that are none, or are of other frames and views than the features."""
    _require_floats(to_image, "to_image")
    own = tuple(to_image.shape)
    shared = zip(reversed(own[:-2]), reversed(lead), strict=False)
    if own[-2:] != (2, 3) or len(own) > len(lead) + 2 or any(a not in (1, b) for a, b in shared):
        wanted = ", ".join(map(str, (*lead, 2, 3)))
        raise InputError(f"to_image has shape {own}, expected ({wanted}): (*b, F, C, 2, 3)")


def _patch(maps: Tensor, center: Tensor, reach: int = 1) -> Tensor:
    """The 3x3 pixels (..., 3, 3) of maps (..., h, w) about pixels (..., 2), clamped inside.

    With another ``reach``, so many pixels to either side.
    """
    height, width = maps.shape[-2:]
    offset = torch.arange(-reach, reach + 1, device=maps.device)
    x = (center[..., 0, None].long() + offset).clamp(0, width - 1)
    y = (center[..., 1, None].long() + offset).clamp(0, height - 1)
    index = (y[..., :, None] * width + x[..., None, :]).flatten(-2)
    side = 2 * reach + 1
    return maps.flatten(-2).gather(-1, index).reshape(*index.shape[:-1], side, side)


def _interior(maps: Tensor, peak: Tensor) -> Tensor:
    limit = peak.new_tensor([maps.shape[-1] - 2, maps.shape[-2] - 2])
    return ((peak >= 1) & (peak <= limit)).all(-1)


def _blurred_patch(maps: Tensor, center: Tensor, sigma: float) -> Tensor:
    """The 3x3 pixels (..., 3, 3) about pixels inside maps that a Gaussian smoothed.

    Borders are repeated. Only what these pixels depend on is smoothed.
    """
    reach = max(1, round(3 * sigma))
    offset = torch.arange(-reach, reach + 1, dtype=maps.dtype, device=maps.device)
    kernel = torch.exp(-0.5 * (offset / sigma).square())
    kernel = kernel / kernel.sum()
    around = _patch(maps, center, reach + 1)
    flat = around.reshape(-1, 1, *around.shape[-2:])
    rows = nn.functional.conv2d(flat, kernel[None, None, None, :])
    smooth = nn.functional.conv2d(rows, kernel[None, None, :, None])
    return smooth.reshape(*center.shape[:-1], 3, 3)
