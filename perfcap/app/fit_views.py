"""A body fitted to a person in calibrated views: frames chosen, joints, silhouettes, shape."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.body_model import BodyModel
from perfcap.actor.motion import Motion
from perfcap.app.inputs import Inputs
from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.clip import Clip
from perfcap.io.mask_files import MaskFolders
from perfcap.pipeline.body_contours import BodyContours
from perfcap.pipeline.bone_lengths import spread_frames
from perfcap.pipeline.checkpoint import NO_CHECKPOINT, Checkpoint
from perfcap.pipeline.extract_silhouettes import extract_silhouettes
from perfcap.pipeline.images import Frames, Images
from perfcap.pipeline.initialize import initialize
from perfcap.pipeline.objective import FrameProblem
from perfcap.pipeline.prepare import prepare
from perfcap.pipeline.sight import Sight
from perfcap.rigging import BodyFit, PersonMasks, ViewFitSettings, fit_body
from perfcap.segment import Silhouettes
from perfcap.segment.random_field import Smoothness
from perfcap.segment.sequence import SequenceSettings
from perfcap.segment.settings import GrabCutSettings

Evidence = Literal["joints", "silhouettes", "contours"]
"""What a body is fitted to: joints, and one of the others beside."""

# chosen frames lie far apart in time: what changed between them says little about either
_APART = SequenceSettings(frame=replace(GrabCutSettings(), smoothness=Smoothness(temporal=0.0)))


@dataclass(frozen=True, eq=False)
class ChosenFrames:
    """Some frames of a clip with all that is known about them.

    Attributes:
        clip: the clip.
        frames: theirs within the clip, increasing.
        cameras: C views in pixels of the images, (C,) or (F, C).
        detections: likewise, (F, C, 16).
    """

    clip: Clip
    frames: tuple[int, ...]
    cameras: Camera
    detections: Detections

    def __len__(self) -> int:
        return len(self.frames)

    def read_view(self, view: int, start: int, stop: int) -> Frames:
        """Those from the ``start``-th to the ``stop``-th, (stop - start, H, W, 3) RGB."""
        height, width = self.clip.sizes[view]
        images = np.empty((stop - start, height, width, 3), np.uint8)
        for place, frame in enumerate(self.frames[start:stop]):
            images[place] = self.clip.read_view(view, frame, frame + 1)[0]
        return images


def choose_frames(inputs: Inputs, count: int, among: Sequence[int] | None = None) -> ChosenFrames:
    """Frames spread over a clip, or over some of its frames, in which the person is seen well.

    Raises:
        InputError: nobody is detected.
    """
    detections, pixel_map = inputs.detections, inputs.pixel_map
    where = "any frame" if among is None else f"the {len(among)} frames with masks in every view"
    if among is not None:
        kept = torch.zeros(detections.frame_count, 1, 1, dtype=torch.bool)
        kept[list(among)] = True
        detections = replace(detections, confidence2d=detections.confidence2d * kept)
    if not bool((detections.confidence2d > 0).any()):
        raise InputError(f"--detections: show nobody in {where}; expected one person's joints")
    chosen = spread_frames(detections, count)
    some = detections.frames(chosen).to(torch.zeros((), dtype=torch.float64))
    cameras = pixel_map.cameras(inputs.rig.cameras, inputs.clip.sizes).frames(chosen)
    some = replace(some, joints2d=pixel_map.to_video(some.joints2d))
    return ChosenFrames(inputs.clip, tuple(chosen.tolist()), cameras.to(some.joints2d), some)


def read_masks(chosen: ChosenFrames, masks: MaskFolders) -> PersonMasks:
    """Known masks of chosen frames, each of which has one in every view."""
    views = []
    for view in range(chosen.clip.views):
        found = [masks.mask(view, frame) for frame in chosen.frames]
        views.append(torch.from_numpy(np.stack([mask for mask in found if mask is not None])))
    return PersonMasks.padded(chosen.cameras, views)


def find_masks(
    chosen: ChosenFrames, actor: Actor, motion: Motion, checkpoint: Checkpoint = NO_CHECKPOINT
) -> PersonMasks:
    """Masks of the chosen frames, segmented around a posed actor; those that are kept are read."""
    template = actor.template
    sight = Sight(chosen.cameras, torch.as_tensor(template.faces.copy()), template.weld()[0])
    heights = chosen.detections.person_height()
    evidence = extract_silhouettes(
        actor, sight, chosen, motion, heights, _APART, checkpoint=checkpoint
    )
    views = [_stacked(evidence.silhouettes, view) for view in range(chosen.clip.views)]
    return PersonMasks.padded(chosen.cameras, views)


def _stacked(silhouettes: Silhouettes, view: int) -> Tensor:
    masks = [silhouettes.mask(frame, view) for frame in range(len(silhouettes))]
    return torch.from_numpy(np.stack(masks))


@torch.no_grad()
def fit_person(
    model: BodyModel,
    chosen: ChosenFrames,
    height: float | None = None,
    masks: PersonMasks | None = None,
    evidence: Evidence = "silhouettes",
    settings: ViewFitSettings | None = None,
    checkpoint: Checkpoint = NO_CHECKPOINT,
) -> tuple[BodyFit, PersonMasks | None]:
    """The body of the person in some frames, and the masks it was fitted to.

    Args:
        model: of bodies.
        chosen: the frames.
        height: of the person, metres, if known.
        masks: of the person, if there are some.
        evidence: beside joints, where there are no masks. Silhouettes are found: joints are fitted
            first, and what the posed body covers is segmented. Contours are edges of the images.
        settings: of the fit.
        checkpoint: keeps masks that were found.
    """
    with warnings.catch_warnings():
        # the inputs were examined as a whole, and it is known where their joints come from
        warnings.filterwarnings("ignore", "body fit: ", UserWarning)
        return _fitted(model, chosen, height, masks, evidence, settings, checkpoint)


def _fitted(
    model: BodyModel,
    chosen: ChosenFrames,
    height: float | None,
    masks: PersonMasks | None,
    evidence: Evidence,
    settings: ViewFitSettings | None,
    checkpoint: Checkpoint,
) -> tuple[BodyFit, PersonMasks | None]:
    detections, cameras = chosen.detections, chosen.cameras
    actor = model.actor(torch.zeros(0)).to(detections.joints2d)
    problem = FrameProblem.of(actor, cameras, detections)
    initial, _ = initialize(prepare(problem))
    if masks is None and evidence == "contours":
        seen = BodyContours(Images(chosen, cameras), detections.person_height())
        found = fit_body(
            model, cameras, detections, initial, None, height, settings=settings, contours=seen
        )
        return found, None
    if masks is None and evidence == "silhouettes":
        first = fit_body(model, cameras, detections, initial, None, height, settings=settings)
        posed = replace(first.motion, shared={})
        person = Actor(first.template).to(detections.joints2d)
        masks = find_masks(chosen, person, posed, checkpoint)
    found = fit_body(model, cameras, detections, initial, masks, height, settings=settings)
    return found, masks
