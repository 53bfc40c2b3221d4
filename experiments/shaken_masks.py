"""Masks of clips as a hand-held camera would have seen them.

Every frame of a clip of a camera that stands still is turned by smooth random angles about the
camera's centre, exactly as the picture of a turning camera changes, and its exposure drifts. The
truth is turned with it. What masks lose by it, with and without a network, is what is scored.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import report
import torch
from numpy.typing import NDArray
from recordings import Recording, rendered
from report import Report, Table
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation
from surface_recordings import images_of, true_mask

from perfcap.actor.motion import Motion
from perfcap.app.networks import find_segmenter
from perfcap.detect import OnnxSegmenter
from perfcap.geometry.camera import Camera
from perfcap.io.clip import FrameReader
from perfcap.metrics import mask_overlap
from perfcap.pipeline.extract_silhouettes import SilhouetteSource
from perfcap.pipeline.images import Frames, Images
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.sight import Sight
from perfcap.segment import SequenceSettings
from perfcap.segment.network_cue import PersonNetwork

_SMOOTH = 8.0  # frames, deviation of the Gaussian that makes angles smooth


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_tight", "dev_skirt")
    """Of ``rendered``, of a camera that stands still."""
    degrees: tuple[float, float, float] = (1.2, 2.0, 0.8)
    """Standard deviations of pitch, yaw and roll."""
    exposure: float = 0.06
    """Standard deviation of the logarithm of the exposure."""
    every: int = 10
    """Segment and score every n-th frame."""
    seed: int = 0
    """Of angles and exposure."""


@dataclass(frozen=True)
class Shake:
    """Turns (F, 3, 3) of a camera about its centre, and exposures (F,)."""

    turns: NDArray[np.float64]
    gains: NDArray[np.float64]

    @classmethod
    def random(cls, frames: int, config: Experiment) -> Shake:
        """Smooth in time."""
        rng = np.random.default_rng(config.seed)
        noise = gaussian_filter1d(rng.normal(size=(frames + 100, 4)), _SMOOTH, axis=0)[50:-50]
        noise = (noise - noise.mean(0)) / noise.std(0)
        angles = Rotation.from_euler("xyz", noise[:, :3] * config.degrees, degrees=True)
        return cls(angles.as_matrix(), np.exp(config.exposure * noise[:, 3]))

    def camera(self, camera: Camera) -> Camera:
        """One view that stands still, as it moves."""
        turns = torch.as_tensor(self.turns).to(camera.rotation)[:, None]
        return replace(
            camera,
            intrinsics=camera.intrinsics.expand(len(turns), *camera.intrinsics.shape),
            rotation=turns @ camera.rotation,
            translation=(turns @ camera.translation[..., None])[..., 0],
        )

    def picture(
        self, image: NDArray[np.uint8], frame: int, intrinsics: NDArray[np.float64]
    ) -> NDArray[np.uint8]:
        """A frame (H, W, ...) as the camera that moves sees it; its border is mirrored."""
        matrix = intrinsics @ self.turns[frame] @ np.linalg.inv(intrinsics)
        size = image.shape[1::-1]
        flags, border = cv2.INTER_LINEAR, cv2.BORDER_REFLECT_101
        turned = cv2.warpPerspective(image, matrix, size, flags=flags, borderMode=border)
        return np.asarray(turned, np.uint8)


@dataclass(frozen=True)
class _Shaken:
    """A reader of one view whose camera moves."""

    reader: FrameReader
    shake: Shake
    intrinsics: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.reader)

    def read_view(self, view: int, start: int, stop: int) -> Frames:
        images = self.reader.read_view(view, start, stop)
        frames = []
        for frame, image in enumerate(images, start):
            bright = np.clip(np.rint(image * self.shake.gains[frame]), 0, 255).astype(np.uint8)
            frames.append(self.shake.picture(bright, frame, self.intrinsics))
        return np.stack(frames)


def run(config: Experiment) -> Report:
    """Score every sequence as it is, and shaken."""
    network = OnnxSegmenter(find_segmenter("blazepose"))
    tables = [_table(rendered(config.data, name), network, config) for name in config.sequences]
    return Report(tuple(tables), ("First pass; masks inside the picture, %.",))


def _table(recording: Recording, network: PersonNetwork, config: Experiment) -> Table:
    images = images_of(recording)
    given = (recording.actor, recording.cameras, recording.detections, recording.rate)
    motion = capture(*given).motion
    shake = Shake.random(motion.frames, config)
    intrinsics = images.cameras.intrinsics[0].double().numpy()
    moving = Images(_Shaken(images.reader, shake, intrinsics), shake.camera(images.cameras))
    frames = range(0, motion.frames, config.every)
    still = {f: true_mask(recording, f) for f in frames}
    turned = {f: shake.picture(m.astype(np.uint8), f, intrinsics) > 0 for f, m in still.items()}
    rows = []
    for name, seen, truth in (("still", images, still), ("shaken", moving, turned)):
        for asked in (None, network):
            found = _scores(recording, seen, motion, asked, truth)
            label = f"{name}, {'no network' if asked is None else 'with the network'}"
            rows.append((label, 100 * np.mean(found), 100 * np.min(found)))
    return Table(f"{recording.name}, %", ("camera", "IoU", "worst"), tuple(rows))


def _scores(
    recording: Recording,
    images: Images,
    motion: Motion,
    network: PersonNetwork | None,
    truth: dict[int, NDArray[np.bool_]],
) -> list[float]:
    template = recording.actor.template
    sight = Sight(images.cameras, torch.as_tensor(template.faces.copy()), template.weld()[0])
    settings = SequenceSettings()
    source = SilhouetteSource(recording.actor, sight, images.reader, motion, settings, 1, network)

    def overlaps() -> Iterator[float]:
        scene = source.scene(0, range(min(motion.frames, settings.scene.span)))
        for frame, mask in truth.items():
            found = source.segment(source.block(0, range(frame, frame + 1), scene))[0]
            yield mask_overlap(found.mask, mask).iou

    with torch.no_grad():
        return list(overlaps())


if __name__ == "__main__":
    report.main(run, Experiment, "shaken_masks")
