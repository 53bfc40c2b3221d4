"""Silhouettes by more and more knowledge (Xu et al. 2018, Fig. 4, 5 and 12).

From each cue alone, in the band that the posed model leaves open: colours, the plate, motion, a
network; from the posed model with the motion cue (the paper's); with all that perfcap adds, and
with each cue left out; and again after the pose was refined.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import report
import torch
from box_grabcut import box_grabcut
from numpy.typing import NDArray
from recordings import Recording, rendered
from report import Report, Table
from surface_recordings import images_of, true_mask

from perfcap.actor.motion import Motion
from perfcap.app.networks import find_segmenter
from perfcap.detect import OnnxSegmenter
from perfcap.metrics import MaskOverlap, mask_overlap
from perfcap.pipeline.extract_silhouettes import SilhouetteSource, project_bones
from perfcap.pipeline.images import Images
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.sight import Mask, Sight
from perfcap.pipeline.stage import Stage
from perfcap.segment import SequenceSettings
from perfcap.segment.network_cue import PersonNetwork
from perfcap.segment.settings import MODEL_ONLY, PAPER, SECOND_PASS, GrabCutSettings

_SIDES = ("precision", "recall")
_NOTES = (
    "The network is trusted as far as it agrees, in five frames, with masks found without it.",
    "Each frame is segmented as a block of its own: where the camera moves, its plate is its own.",
)
_FIRST = GrabCutSettings()
_NO_MOTION = replace(_FIRST.smoothness, temporal=0.0)
_NO_CONTRAST = replace(_FIRST.smoothness, contrast=0.0)
_NO_CONTACT = replace(_FIRST.trimap, contact=0.0)
_NO_BONES = replace(_FIRST.trimap, skeleton=float("inf"))
_NO_SHADOWS = replace(_FIRST.plate, shadow_prior=1e-12)


def _believed(settings: GrabCutSettings, prior: float) -> GrabCutSettings:
    """With as many nats for the posed model's own depth."""
    backed, alone = (replace(b, prior=prior) for b in (settings.backed, settings.alone))
    return replace(settings, backed=backed, alone=alone)


_CUE_ALONE = replace(
    _believed(_FIRST, 0.0), smoothness=_NO_MOTION, network=0.0, use_plate=False, use_colors=False
)
_ALONE = {
    "colours": replace(_CUE_ALONE, use_colors=True),
    "plate": replace(_CUE_ALONE, use_plate=True),
    # neighbours that move together belong together; who is who only the model's depth can say
    "motion, and the model's depth": replace(
        _believed(_CUE_ALONE, _FIRST.alone.prior), smoothness=_FIRST.smoothness
    ),
}
_VARIANTS = {
    "model": MODEL_ONLY,
    "model + motion (the paper's)": PAPER,
    "default": _FIRST,
    "default, model believed more": SECOND_PASS,
}
_LEFT_OUT = {
    "no colours": replace(_FIRST, use_colors=False),
    "no plate": replace(_FIRST, use_plate=False),
    "no network": replace(_FIRST, network=0.0),
    "no plate, no network": replace(_FIRST, use_plate=False, network=0.0),
    "no motion": replace(_FIRST, smoothness=_NO_MOTION),
    "no contrast": replace(_FIRST, smoothness=_NO_CONTRAST),
    "no skeleton": replace(_FIRST, trimap=_NO_BONES),
    "no contact shadows": replace(_FIRST, trimap=_NO_CONTACT),
    "no shadows at all": replace(_FIRST, trimap=_NO_CONTACT, plate=_NO_SHADOWS),
    "model not believed": _believed(_FIRST, 0.0),
}


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_tight", "dev_skirt", "dev_coat")
    """Of ``rendered``."""
    every: int = 10
    """Segment and score every n-th frame, each as if it were a block of its own."""
    network: str = "blazepose"
    """Of person masks."""


def run(config: Experiment) -> Report:
    """Score every variant on every sequence."""
    network = OnnxSegmenter(find_segmenter(config.network))
    names = config.sequences
    return Report(
        tuple(_table(rendered(config.data, n), network, config.every) for n in names), _NOTES
    )


@dataclass(frozen=True)
class _Take:
    """One recording, and the motions that its masks start from."""

    recording: Recording
    images: Images
    sight: Sight
    frames: range

    def model(self, motion: Motion, frame: int) -> Mask:
        span = slice(frame, frame + 1)
        return self.sight.look(self.recording.actor.surface(motion[span]), span)[0][0].mask

    def masks(
        self, motion: Motion, settings: GrabCutSettings, network: PersonNetwork
    ) -> Iterator[Mask]:
        """Of every frame that is scored."""
        chosen, reader = SequenceSettings(frame=settings), self.images.reader
        actor = self.recording.actor
        source = SilhouetteSource(actor, self.sight, reader, motion, chosen, 1, network)
        scene = source.scene(0, range(min(motion.frames, chosen.scene.span)))
        for frame in self.frames:
            yield source.segment(source.block(0, range(frame, frame + 1), scene))[0].mask

    def alone(self, motion: Motion, network: PersonNetwork, frame: int) -> Mask:
        """What the network says, even odds."""
        image, model = self.image(frame), self.model(motion, frame)
        span = slice(frame, frame + 1)
        joints = self.recording.actor.joints(motion[span])
        spine = project_bones(self.images.cameras.frames(span), joints)[0, -1]
        whole = slice(0, model.shape[0]), slice(0, model.shape[1])
        found: Mask = network(image, model, spine, whole) > 0
        return found

    def image(self, frame: int) -> NDArray[np.uint8]:
        image: NDArray[np.uint8] = self.images.reader.read_view(0, frame, frame + 1)[0]
        return image


def _table(recording: Recording, network: PersonNetwork, every: int) -> Table:
    images = images_of(recording)
    given = (recording.actor, recording.cameras, recording.detections, recording.rate)
    found = capture(*given, images=images, until=Stage.REFINE_POSE)
    first = capture(*given).motion
    assert found.refinement is not None
    template = recording.actor.template
    sight = Sight(images.cameras, torch.as_tensor(template.faces.copy()), template.weld()[0])
    take = _Take(recording, images, sight, range(0, found.frames, every))
    with torch.no_grad():
        rows = tuple(_rows(take, network, first, found.refinement.pose.motion))
    columns = ("mask from", "IoU", "worst", "precision", "recall")
    return Table(f"{recording.name}, %", columns, rows)


def _rows(
    take: _Take, network: PersonNetwork, first: Motion, second: Motion
) -> Iterator[tuple[object, ...]]:
    def row(name: str, masks: Iterable[Mask]) -> tuple[object, ...]:
        pairs = zip(masks, take.frames, strict=True)
        scores = [mask_overlap(mask, true_mask(take.recording, f)) for mask, f in pairs]
        worst = 100 * min(score.iou for score in scores)
        return (name, _mean(scores, "iou"), worst, *(_mean(scores, k) for k in _SIDES))

    yield row("posed model itself", (take.model(first, f) for f in take.frames))
    boxes = (box_grabcut(take.image(f), take.model(first, f)) for f in take.frames)
    yield row("box", boxes)
    yield row("network alone", (take.alone(first, network, f) for f in take.frames))
    for name, settings in _ALONE.items():
        yield row(f"{name} alone", take.masks(first, settings, network))
    for name, settings in (_VARIANTS | _LEFT_OUT).items():
        yield row(f"first pass, {name}", take.masks(first, settings, network))
    for name, settings in _VARIANTS.items():
        yield row(f"second pass, {name}", take.masks(second, settings, network))


def _mean(scores: list[MaskOverlap], key: str) -> float:
    return 100 * float(np.mean([getattr(score, key) for score in scores]))


if __name__ == "__main__":
    report.main(run, Experiment, "segmentation_ablation")
