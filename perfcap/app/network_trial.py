"""A network on the shipped clip, whose truth is known: as its manifest reads it, and otherwise.

What a file was trained with does not show in its shapes: the order of colours, the range of values,
a mean and a deviation. A network that is given others sees less, or nothing, and is as silent.
On the same frames, the right reading is the better one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.app.joint_names import misnamed
from perfcap.app.known_frames import known_frames
from perfcap.detect.crop import Frame
from perfcap.detect.decode import calibrate
from perfcap.detect.joint_set import LANDMARKS, map_to_landmarks
from perfcap.detect.known_person import JUDGED, NEAR, OPPOSITE, look_at_known
from perfcap.detect.manifest import InputSpec, Manifest
from perfcap.detect.onnx import OnnxDetector
from perfcap.detect.people import OnnxFinder
from perfcap.errors import InputError

Floats = NDArray[np.float64]

# Distances of another reading, in those of the manifest's, where that is no surer. Of the shipped
# networks read rightly it is 0.95 and more. Read wrongly, that of the right reading is 0.6 and less
# for values of another range and 0.05 for x and y exchanged; for colours in another order it is 0.8
# of `lightning` and `blazepose`, 0.92 and more of others, which see nearly as well so.
_BETTER = 0.88
_EXCHANGED = 0.5
_PADDING, _ALIKE = 1.25, 0.15  # most networks learned such crops; distances then differ little
_FEW = 0.7  # of the joints; of the shipped networks 0.94 and more are found
_THERE = 0.3  # mean confidence from which captures take somebody to be there; see ``detect.look``
_TWICE, _ROUNDED = (0.5, 0.7311), 1e-3  # what a sigmoid makes of 0 and 1
_IMAGENET = (123.675, 116.28, 103.53), (58.395, 57.12, 57.375)
_ONES = (1.0, 1.0, 1.0)
_NONE = (0.0, 0.0, 0.0), _ONES


@dataclass(frozen=True)
class Reading:
    """What a network sees in the clip, read in one way.

    Attributes:
        off: median distance of joints from the truth, share of the person.
        found: share of the joints that are near it.
        opposite: share of them that are near the other side's.
        sure: mean of the network's confidence.
        range: the least and the greatest confidence.
        misnamed: which joints lie where others are.
    """

    off: float
    found: float
    opposite: float
    sure: float
    range: tuple[float, float]
    misnamed: tuple[str, ...] = ()

    @property
    def exchanged(self) -> bool:
        """Whether left and right are each other's: else 0.2 to 0.3 are near the other side's."""
        return self.opposite > max(self.found, _EXCHANGED)


def require_sides(network: OnnxDetector | OnnxFinder) -> None:
    """Refuse a network whose manifest gives joints of each side the names of the other.

    A person who is captured so is seen from behind, and of one view no joint contradicts that.

    Raises:
        InputError: on the shipped clip, its left is the right.
    """
    if network.manifest.output.kind == "joints3d" or not _read(network, network.manifest).exchanged:
        return
    raise InputError(
        f"{network.manifest.path}: left and right are exchanged: in the shipped clip most joints "
        "are where those of the other side are; expected the person's own left and right in "
        "joints.names or joints.set (perfcap models try MODEL looks again)"
    )


def try_network(network: OnnxDetector | OnnxFinder) -> Iterator[str]:
    """How well a network sees the person of the shipped clip, and what in its manifest to check.

    Args:
        network: of 2D joints. Its manifest is exchanged for a while.
    """
    manifest = network.manifest
    if manifest.output.kind == "joints3d":
        return
    own = _read(network, manifest)
    yield (
        f"tried on the shipped clip: joints are {_percent(own.off)} of the person off (median), "
        f"{own.found:.0%} of them within a tenth"
    )
    unseen = [LANDMARKS[n] for n in JUDGED if LANDMARKS[n] in network.joint_set.missing()]
    if unseen:
        yield (
            f"to check: it sees no {', '.join(unseen)}; are these joints of the network spelled as "
            "docs/detectors.md has them in joints.names?"
        )
    others = {what: _read(network, other) for what, other in _otherwise(manifest)}
    better = [
        what
        for what, other in others.items()
        if other.off < _BETTER * own.off and other.sure >= own.sure and other.found >= _FEW
    ]
    if own.exchanged:
        yield (
            f"to check: {own.opposite:.0%} are where the other side's are; joints.names or "
            "joints.set have left and right exchanged"
        )
    elif better:  # before names: crops of another size show joints at those of the other side
        best = min(better, key=lambda what: others[what].off)
        yield (
            f"to check: with {best} they are {_percent(others[best].off)} off, and "
            f"{others[best].found:.0%} are found; was it trained with that?"
        )
    elif own.misnamed:
        yield f"to check: {', '.join(own.misnamed)}; exchange them in joints.names"
    elif own.found < _FEW:
        yield (
            "to check: few joints are found, and no other order of colours, range of values or "
            "order of columns is better; look at joints, units, size and layout"
        )
    elif doubt := _doubt_of_confidence(manifest, own):
        yield f"to check: {doubt}"


def _doubt_of_confidence(manifest: Manifest, own: Reading) -> str:
    """What is wrong with the confidences of joints that are where they should be; else nothing."""
    columns = manifest.output.columns
    listed = manifest.output.kind in ("coordinates", "people")
    if listed and "ignored" in columns and "confidence" not in columns:
        return (
            "output.columns has no confidence, so that every joint counts as seen, hidden ones and "
            "those of nobody too; is one that is ignored the confidence?"
        )
    ends = calibrate(torch.tensor(_TWICE), manifest.calibration).tolist()
    within = ends[0] - _ROUNDED < own.range[0] and own.range[1] < ends[1] + _ROUNDED
    if manifest.output.activation == "sigmoid" and within and ends[0] < ends[1]:
        return (
            'all confidences are those that output.activation = "sigmoid" makes of 0 to 1, so that '
            "hidden joints count as seen; is what the network gives a probability already?"
        )
    if own.sure < _THERE:
        return (
            f"confidences are {own.sure:.2f} in the mean, and below {_THERE} nobody is taken to be "
            "there; [calibration] says which probabilities they are"
        )
    return ""


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def _otherwise(manifest: Manifest) -> Iterator[tuple[str, Manifest]]:
    """The manifest with other values or colours, columns or alignment, and what is other."""
    spec, output = manifest.input, manifest.output
    for what, other in _inputs(spec):
        yield what, replace(manifest, input=other)
    if output.columns and output.kind in ("coordinates", "people"):
        names = {"x": "y", "y": "x"}
        columns = tuple(names.get(name, name) for name in output.columns)
        yield (
            f"columns = {list(columns)}",
            replace(manifest, output=replace(output, columns=columns)),
        )
    if output.kind == "simcc" and spec.size[0] == spec.size[1]:  # else bins show which is which
        swapped = replace(output, names=output.names[::-1])
        yield f"names = {list(swapped.names)}", replace(manifest, output=swapped)
    if output.kind in ("heatmaps", "location_maps"):
        for alignment in ("scale", "corners", "centers"):
            if alignment == output.alignment:
                continue
            aligned = replace(output, alignment=alignment)
            yield f'alignment = "{alignment}"', replace(manifest, output=aligned)


def _inputs(spec: InputSpec) -> Iterator[tuple[str, InputSpec]]:
    """Other orders of colours and ranges of values than a network is given."""
    mean, std = _IMAGENET
    ranges: dict[str, tuple[float, tuple[float, ...], tuple[float, ...]]] = {
        "values 0 to 255 (no scale, mean and std)": (1.0, *_NONE),
        "values 0 to 1 (scale = 0.00392157)": (1 / 255, *_NONE),
        "values -1 to 1 (scale = 0.00784314, mean = [1, 1, 1])": (1 / 127.5, _ONES, _ONES),
        "mean and std of ImageNet": (1.0, mean, std),
    }
    if abs(spec.padding / _PADDING - 1) > _ALIKE:
        yield f"padding = {_PADDING}", replace(spec, padding=_PADDING)
    whole = "int" in spec.dtype
    for order in ("rgb", "bgr"):
        said = [f'color = "{order}"'] if order != spec.color else []
        if said:
            yield said[0], replace(spec, color=order)
        for words, (scale, middle, spread) in ranges.items() if not whole else ():
            turned = slice(None, None, -1 if middle == mean and order == "bgr" else 1)
            other = replace(spec, scale=scale, mean=middle[turned], std=spread[turned])
            if not _same(other, spec):
                yield " and ".join((*said, words)), replace(other, color=order)


def _same(one: InputSpec, other: InputSpec) -> bool:
    """Whether pixels become the same values, but for the last digits, whatever their colours."""
    black, white = (
        [(level * np.float64(s.scale) - np.sort(s.mean)) / np.sort(s.std) for s in (one, other)]
        for level in (0.0, 255.0)
    )
    return all(bool(np.allclose(a, b, rtol=0.02, atol=0.02)) for a, b in (black, white))


def _read(network: OnnxDetector | OnnxFinder, manifest: Manifest) -> Reading:
    """What a network sees as a manifest reads it."""
    before = network.manifest
    try:
        network.manifest = manifest
        seen = [
            (*_look(network, each.image, each.joints2d), each.joints2d) for each in known_frames()
        ]
    finally:
        network.manifest = before
    points, _, places = (np.stack(each) for each in zip(*seen, strict=True))
    judged = [n for n in JUDGED if LANDMARKS[n] not in network.joint_set.missing()]
    off, opposite = (
        np.stack([_apart(points, truth[order])[judged] for points, _, truth in seen])
        for order in (list(range(len(LANDMARKS))), OPPOSITE)
    )
    confidence = np.stack([sure[judged] for _, sure, _ in seen])
    return Reading(
        float(np.median(off)),
        float((off < NEAR).mean()),
        float((opposite < NEAR).mean()),
        float(confidence.mean()),
        (float(confidence.min()), float(confidence.max())),
        misnamed(points, places, network.joint_set.missing()),
    )


def _apart(points: Floats, truth: Floats) -> Floats:
    """Distances (16,) of joints from where they are, shares of the person."""
    size = float((truth.max(0) - truth.min(0)).max())
    apart: Floats = np.linalg.norm(points - truth, axis=-1) / size
    return np.nan_to_num(apart, nan=1.0, posinf=1.0).clip(0, 1)


def _look(network: OnnxDetector | OnnxFinder, frame: Frame, truth: Floats) -> tuple[Floats, Floats]:
    """Landmarks (16, 2) that a network sees, pixels, and its confidence; 0 where it sees none."""
    if isinstance(network, OnnxDetector):
        seen = look_at_known(network, frame, truth)
        assert seen is not None
        return seen
    looks = network(frame)
    if not looks:
        return np.zeros((len(LANDMARKS), 2)), np.zeros(len(LANDMARKS))
    points, sure = map_to_landmarks(looks[0].joints2d, looks[0].confidence, network.joint_set)
    return points.double().numpy(), sure.double().numpy()
