"""Images of the recordings, and the truth of their surfaces and silhouettes, for scoring only."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from recordings import Recording

from perfcap.geometry.camera import Camera
from perfcap.io.calibration import PixelMap, match_image, read_pixel_map
from perfcap.io.clip import Clip
from perfcap.io.image_file import read_silhouette
from perfcap.metrics import SurfaceError, mask_overlap, surface_error
from perfcap.pipeline.images import Images
from perfcap.pipeline.surface import SurfaceFrames
from perfcap.render import rasterize

Mask = NDArray[np.bool_]


def images_of(recording: Recording) -> Images:
    """The clip of a recording, and its cameras in the pixels of the videos."""
    clip, pixel_map = clip_of(recording)
    return Images(clip, pixel_map.cameras(recording.cameras, clip.sizes))


def clip_of(recording: Recording) -> tuple[Clip, PixelMap]:
    """The clip of a recording, and the map from its pixels to those of the calibration."""
    folder = recording.folder
    many = [
        path for name in ("videos", "views") for path in sorted(folder.glob(f"{name}/cam*.mp4"))
    ]
    paths = many or [folder / "video.mp4"]
    frames = slice(0, recording.detections.frame_count)
    clip = Clip.open([str(path) for path in paths], frames=frames)
    maps = folder / "video_to_native.json"
    known = read_pixel_map(maps) if maps.is_file() else None
    return clip, match_image(recording.rig, clip.sizes, known)


@dataclass(frozen=True)
class SurfaceTruth:
    """What a rendered sequence really looked like.

    Attributes:
        vertices: of the template without texture seams, (F, V', 3) m.
        faces: (T', 3).
        order: vertex of the GLB that shows each of them, (V',).
        garment: which of them are loose cloth, (V',).
        side: the camera beside, which no capture sees.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    order: NDArray[np.int64]
    garment: Mask
    side: Camera

    @classmethod
    def read(cls, recording: Recording) -> SurfaceTruth:
        """The truth of a rendered sequence."""
        assert recording.sequence is not None and recording.sequence.surface is not None
        known = recording.sequence.surface()
        return cls(known.vertices, known.faces, known.order, known.loose, _side(recording))

    def error(self, vertices: NDArray[np.float64], frame: int, seed: int = 0) -> SurfaceError:
        """Of a frame's vertices in the order of the GLB, (V, 3) m."""
        rng = np.random.default_rng(seed)
        return surface_error(vertices[self.order], self.vertices[frame], self.faces, rng)

    def garment_error(
        self, vertices: NDArray[np.float64], frame: int, seed: int = 0
    ) -> SurfaceError | None:
        """The same of loose cloth alone; None where the person wears none."""
        if not self.garment.any():
            return None
        rng = np.random.default_rng(seed)
        found = vertices[self.order]
        return surface_error(found, self.vertices[frame], self.faces, rng, self.garment)

    def side_overlap(self, vertices: NDArray[np.float64], frame: int) -> float:
        """Intersection over union with the truth as the camera beside sees both."""
        views = [self._from_side(v) for v in (vertices[self.order], self.vertices[frame])]
        return mask_overlap(*views).iou

    def _from_side(self, vertices: NDArray[np.float64]) -> Mask:
        return draw(self.side, torch.from_numpy(vertices), torch.from_numpy(self.faces))


def _side(recording: Recording) -> Camera:
    values = json.loads((recording.folder / "camera.json").read_text())["side"]
    intrinsics, rotation, translation = (
        torch.tensor(values[key], dtype=torch.float64)[None] for key in ("K", "R", "t")
    )
    intrinsics[:, :2, 2] -= values["pixel_centre"]
    return Camera(intrinsics, rotation, translation, size=((values["height"], values["width"]),))


def draw(camera: Camera, vertices: torch.Tensor, faces: torch.Tensor) -> Mask:
    """Silhouette of a mesh (V, 3) in one fixed view, (H, W)."""
    local = camera.to_camera(vertices.to(camera.intrinsics))
    pixels = camera.project_camera(local)
    mask: Mask = rasterize(pixels[0], local[0, :, 2], faces, camera.size[0]).mask.numpy()
    return mask


def true_mask(recording: Recording, frame: int) -> Mask:
    """Silhouette of a frame of a rendered sequence, (H, W)."""
    assert recording.sequence is not None
    return read_silhouette(recording.sequence.masks[frame])


def silhouette_overlap(
    recording: Recording, images: Images, surface: SurfaceFrames, frame: int
) -> float:
    """Intersection over union of a surface with the true mask of a rendered sequence."""
    camera = images.cameras.frames(slice(frame, frame + 1))
    if camera.moving:
        camera = Camera(
            camera.intrinsics[0], camera.rotation[0], camera.translation[0], size=camera.size
        )
    faces = torch.as_tensor(recording.actor.template.faces.copy())
    drawn = draw(camera, surface[frame : frame + 1][0], faces)
    return mask_overlap(drawn, true_mask(recording, frame)).iou
