"""The body of the person in the videos: fitted once, for an actor's folder or for a capture."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.actor.actor import Actor
from perfcap.actor.body_model import BodyModel
from perfcap.actor.measurements import girth_rings
from perfcap.actor.shaped_points import ShapedPoints
from perfcap.actor.template import Template
from perfcap.app.body_map import body_map
from perfcap.app.fit_views import ChosenFrames, Evidence, choose_frames, fit_person
from perfcap.app.inputs import Inputs
from perfcap.app.masked_frames import masked_frames, shown
from perfcap.app.measures import save_measures
from perfcap.io.atomic import writing
from perfcap.io.body_model import DEFAULT_BODY, load_body_model
from perfcap.io.doctor.mask_joints import limb_doubts
from perfcap.io.doctor.mask_outlines import outline_doubts
from perfcap.io.fitted_body import FittedBody, save_fitted_body
from perfcap.io.mask_files import MaskFolders
from perfcap.io.result_folder import BODY
from perfcap.pipeline.checkpoint import NO_CHECKPOINT, Checkpoint
from perfcap.render import OverlayStyle, draw_overlay, rasterize
from perfcap.rigging import BodyFit, PersonMasks, ViewFitSettings
from perfcap.rigging.fit_doubts import FittedTo, depth_doubts, fit_doubts

# --- A fitted body drawn over the frames it was fitted to -----------------------------------------

Image = NDArray[np.uint8]

_FRAMES, _VIEWS = 3, 4  # at most
_SIZE = 360  # px, side of each picture
_ROOM = 0.65  # half a picture, over the person's size
_QUALITY = 88
_STYLE = OverlayStyle(tint=0.12)
_TAPE = (255, 64, 200)  # colour of girths
_SHIFT, _FAR = 4, 1e5  # bits below a pixel; px


def save_fit_sheet(path: Path, model: BodyModel, fit: BodyFit, chosen: ChosenFrames) -> None:
    """Draw outline, joints, detections and girths of some frames, one a row, as a JPEG file."""
    encoded = cv2.imencode(
        ".jpg", fit_sheet(model, fit, chosen)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _QUALITY]
    )[1]
    with writing(path) as file:
        file.write(encoded.tobytes())


@torch.no_grad()
def fit_sheet(model: BodyModel, fit: BodyFit, chosen: ChosenFrames) -> Image:
    """A row for each of three frames, a picture for each of at most four views, (H, W, 3) RGB.

    Below them the body at rest, coloured by how well it is known, and its measurements.
    """
    actor = model.actor(torch.zeros(0)).to(chosen.detections.joints2d)
    surface = ShapedPoints.of_surface(model, actor)
    marks = ShapedPoints.of_landmarks(model, actor).at(np.arange(16))
    person = Actor(fit.template).to(chosen.detections.joints2d)
    rings = girth_rings(fit.template).values()
    frames = sorted({int(f) for f in np.linspace(0, len(chosen) - 1, _FRAMES).round()})
    rows = []
    for frame in frames:
        motion = fit.motion[frame : frame + 1]
        cameras = chosen.cameras.frames(slice(frame, frame + 1))
        local = cameras.to_camera(surface(motion))
        pixels, depth = cameras.project_camera(local)[0], local[0, ..., 2]
        points = cameras.project(marks(motion))[0].double().numpy()
        posed = person.surface(replace(motion, shared={}))[0].double().numpy()
        tapes = [cameras.project(torch.from_numpy(ring.on(posed)[None]))[0] for ring in rings]
        row = []
        for view in range(min(cameras.views, _VIEWS)):
            faces = torch.from_numpy(model.rig.faces)
            drawn = rasterize(pixels[view], depth[view], faces, cameras.size[view])
            seen = chosen.detections.joints2d[frame, view].numpy()
            sure = chosen.detections.confidence2d[frame, view].numpy()
            image = chosen.read_view(view, frame, frame + 1)[0]
            picture = draw_overlay(image, drawn.mask.numpy(), points[view], seen, sure, _STYLE)
            for tape in tapes:
                _draw_ring(picture, tape[view].numpy())
            row.append(_around(picture, points[view]))
        rows.append(np.concatenate(row, 1))
    wide = max(rows[0].shape[1], 2 * _SIZE)
    known = body_map(model, fit, _SIZE, wide)
    padded = [np.pad(row, ((0, 0), (0, wide - row.shape[1]), (0, 0))) for row in rows]
    return np.concatenate((*padded, known))


def _draw_ring(picture: Image, ring: NDArray[np.float64]) -> None:
    """A closed line through pixels (N, 2), where they all are somewhere near the picture."""
    if not np.isfinite(ring).all() or np.abs(ring).max() > _FAR:
        return
    corners = (ring * 2**_SHIFT).round().astype(np.int32)
    cv2.polylines(picture, [corners], True, _TAPE, 1, cv2.LINE_AA, _SHIFT)


def _around(picture: Image, points: NDArray[np.float64]) -> Image:
    """The square about a person's joints (16, 2) px, black beyond the image."""
    low, high = points.min(0), points.max(0)
    middle, half = (low + high) / 2, _ROOM * float((high - low).max())
    scale = _SIZE / (2 * half)
    shift = _SIZE / 2 - scale * middle
    matrix = np.array([[scale, 0, shift[0]], [0, scale, shift[1]]])
    small = cv2.GaussianBlur(picture, (0, 0), 0.4 / scale) if scale < 0.7 else picture
    square: Image = cv2.warpAffine(small, matrix, (_SIZE, _SIZE)).astype(np.uint8)
    return square


# --------------------------------------------------------------------------------------------------
# The body of the person in the videos: fitted once, for an actor's folder or for a capture.


@dataclass(frozen=True, kw_only=True)
class BodyRequest:
    """How somebody's body is to be found.

    Attributes:
        count: frames to fit to, spread over the clip.
        height: of the person, metres, if known.
        masks: folders of silhouettes, one a view; none to find them in the images.
        evidence: what is looked at beside joints.
        model: name or file of the body model.
        settings: of the fit.
    """

    count: int
    height: float | None = None
    masks: Sequence[Path] = ()
    evidence: Evidence = "silhouettes"
    model: str = DEFAULT_BODY
    settings: ViewFitSettings | None = None


@dataclass(frozen=True, eq=False)
class PersonalBody:
    """A body, and what it was fitted to.

    Attributes:
        model: of bodies.
        fit: coefficients, poses, measurements.
        chosen: the frames.
        masks: silhouettes in them, where they were used.
        height: as it was given.
    """

    model: BodyModel
    fit: BodyFit
    chosen: ChosenFrames
    masks: PersonMasks | None
    height: float | None = None

    @property
    def template(self) -> Template:
        """The rigged body."""
        return self.fit.template

    @property
    def evidence(self) -> str:
        """What it was fitted to, in words."""
        if self.fit.support is not None:
            return "joints and contours"
        return "joints" if self.masks is None else "joints and silhouettes"

    @property
    def source(self) -> str:
        """What the body was fitted to, in words."""
        frames, views = len(self.chosen), self.chosen.clip.views
        plural = "s" if views > 1 else ""
        return f"body fitted to {self.evidence} of {frames} frames in {views} view{plural}"

    def save(self, folder: Path, picture: str) -> None:
        """Write body.npz, measurements.json and a picture of the body over the images."""
        shape, covariance = (
            x.double().numpy(force=True) for x in (self.fit.shape, self.fit.covariance)
        )
        save_fitted_body(folder / BODY, FittedBody(shape, covariance, self.model.rig.name))
        save_measures(folder, self.fit.measurements, self.fit.deviations, self.source)
        save_fit_sheet(folder / picture, self.model, self.fit, self.chosen)

    def doubts(self, *, alone: bool = True) -> tuple[str, ...]:
        """What a user should know about it, one sentence each.

        Args:
            alone: whether there is one person, for whom ``--height`` can be given.
        """
        return tuple(self._doubts(alone))

    def _doubts(self, alone: bool) -> Iterator[str]:
        asked = "--" if alone else None
        yield from depth_doubts(self.fit, self._given, option=asked)
        yield from fit_doubts(self.model, self.fit, self._given, option="--")
        if self.masks is not None:
            seen = shown(self.chosen, self.masks)
            yield from limb_doubts(seen.names, seen.detections, seen.inside, seen.known)
            yield from outline_doubts(seen)

    @property
    def _given(self) -> FittedTo:
        """What it was fitted to, its frames numbered as in their video."""
        clip, seen = self.chosen.clip, self.chosen.detections
        masked = None if self.masks is None else (seen, self.masks)
        numbers = [clip.start + frame for frame in self.chosen.frames]
        return FittedTo(self.chosen.cameras, seen, self.height, masked, clip.names, numbers)


def find_body(
    inputs: Inputs, request: BodyRequest, checkpoint: Checkpoint = NO_CHECKPOINT
) -> PersonalBody:
    """Fit a body model to the person; the checkpoint keeps silhouettes that were found.

    Raises:
        InputError: nobody is detected, or masks or the model cannot be used.
    """
    model = load_body_model(request.model)
    given_masks = MaskFolders.open(request.masks, inputs.clip) if request.masks else None
    if given_masks is None:
        chosen, masks = choose_frames(inputs, request.count), None
    else:
        chosen, masks = masked_frames(inputs, request.count, given_masks)
    given = request.height, masks, request.evidence, request.settings
    fit, masks = fit_person(model, chosen, *given, checkpoint)
    return PersonalBody(model, fit, chosen, masks, request.height)
