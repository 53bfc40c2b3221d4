"""The pictures of docs/method.md: one frame of the demo clip, from pixels to surface.

python tools/method_pictures.py --out docs/images/method
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

import perfcap
from perfcap.actor import DeformationGraph
from perfcap.io import models_folder
from perfcap.pipeline import Performance
from perfcap.pipeline.appearance import Appearance
from perfcap.pipeline.surroundings import daylight, upright
from perfcap.render import ProjectedMesh, draw_overlay, render
from perfcap.segment import extract_contour

Image = NDArray[np.uint8]
YELLOW, BLUE, GREY = (255, 236, 92), (58, 160, 255), (140, 150, 165)  # RGB
SHIFT = 4  # bits of a pixel's fraction in cv2's drawings
BEHIND = 0.02  # metres below the surface that a node is still shown
SIZE = 440  # pixels of a square picture
ROOM = 1.25  # of the picture, in heights of the person


@dataclass(frozen=True)
class Moment:
    """One frame of a clip, captured by its motion alone and with its images."""

    image: Image
    tracked: Performance
    refined: Performance
    frame: int

    @property
    def mask(self) -> NDArray[np.bool_]:
        """The silhouette that was found, (H, W)."""
        return self.refined.refinement.evidence.silhouettes.mask(self.frame)

    def mesh(self, performance: Performance) -> ProjectedMesh:
        """The surface as the camera sees it."""
        vertices = performance.shown[self.frame : self.frame + 1][0].double()
        faces = torch.as_tensor(performance.actor.template.faces.copy())
        return ProjectedMesh.seen_by(performance.cameras, vertices, faces)

    def dimmed(self, share: float = 0.35) -> Image:
        """The frame, darker."""
        return np.round(self.image * share).astype(np.uint8)


def capture(frames: slice, frame: int) -> Moment:
    """Capture a part of the demo clip, without and with its images."""
    demo = models_folder() / "demo"
    clip = perfcap.Clip.open(demo / "video.mp4", frames=frames)
    rig = perfcap.read_cameras(demo / "camera.json", clip.sizes)
    seen, _ = perfcap.read_detections([demo / "detections.npz"], views=rig.names)
    given = (perfcap.load_actor("sam"), rig.cameras, seen.frames(frames), clip.fps)
    images = perfcap.Images(clip, rig.cameras)
    tracked, refined = perfcap.capture(*given), perfcap.capture(*given, images=images)
    return Moment(clip.read(frame, frame + 1)[0, 0], tracked, refined, frame)


def draw_input(moment: Moment) -> Image:
    """The frame itself."""
    return moment.image


def draw_joints(moment: Moment) -> Image:
    """What the detector says, a cross a joint."""
    detected = moment.refined.detections.joints2d[moment.frame, 0]
    return draw_overlay(moment.image, detections=detected.numpy())


def draw_skeleton(moment: Moment) -> Image:
    """The tracked pose."""
    joints = moment.tracked.joints()[moment.frame]
    pixels = moment.tracked.cameras.project(joints[None])[0, 0]
    return draw_overlay(moment.image, joints=pixels.numpy())


def draw_silhouette(moment: Moment) -> Image:
    """The person cut out by the mask."""
    return np.where(moment.mask[..., None], moment.image, moment.dimmed(0.2))


def draw_contour(moment: Moment) -> Image:
    """The boundary of the mask, yellow, and of the tracked pose, blue."""
    picture = moment.dimmed()
    posed = moment.mesh(moment.tracked).rasterize().mask.numpy()
    for region, color in ((posed, BLUE), (moment.mask, YELLOW)):
        for point in extract_contour(region).points:
            _dot(picture, point, 1.2, color)
    return picture


def draw_graph(moment: Moment) -> Image:
    """Nodes of the deformation graph that the camera sees, and their edges."""
    actor, mesh = moment.refined.actor, moment.mesh(moment.refined)
    graph = DeformationGraph.build(actor.vertices, mesh.faces)
    pixels, depth = (value[graph.node_vertex].numpy() for value in (mesh.pixels, mesh.depth))
    column, row = np.clip(np.round(pixels).astype(int), 0, np.array(mesh.size[::-1]) - 1).T
    seen = depth < mesh.rasterize().depth.numpy()[row, column] + BEHIND
    picture = moment.dimmed()
    for one, other in graph.edges.numpy():
        if seen[one] and seen[other]:
            ends = _fixed(pixels[[one, other]])
            cv2.line(picture, ends[0], ends[1], GREY, 1, cv2.LINE_AA, SHIFT)
    for point in pixels[seen]:
        _dot(picture, point, 1.8, YELLOW)
    return picture


def draw_surface(moment: Moment) -> Image:
    """The refined surface in the actor's texture."""
    performance = moment.refined
    appearance = Appearance.of(performance.actor.template)
    vertices = performance.shown[moment.frame : moment.frame + 1][0].float()
    mesh = ProjectedMesh.seen_by(
        performance.cameras, vertices[appearance.representative], appearance.faces
    )
    light = daylight(upright(performance.joints()))
    behind = torch.from_numpy(moment.dimmed())
    return render(mesh, appearance.texture, behind, light).image.numpy()


PICTURES: dict[str, Callable[[Moment], Image]] = {
    "1_input": draw_input,
    "2_joints": draw_joints,
    "3_skeleton": draw_skeleton,
    "4_silhouette": draw_silhouette,
    "5_contour": draw_contour,
    "6_graph": draw_graph,
    "7_surface": draw_surface,
}


def _fixed(points: NDArray[np.float64]) -> NDArray[np.int64]:
    return np.round(points * (1 << SHIFT)).astype(int)


def _dot(picture: Image, point: NDArray[np.float64], radius: float, color: tuple[int, ...]) -> None:
    fixed = int(radius * (1 << SHIFT))
    cv2.circle(picture, _fixed(point), fixed, color, cv2.FILLED, cv2.LINE_AA, SHIFT)


def around(mask: NDArray[np.bool_]) -> tuple[slice, slice]:
    """Rows and columns of a square around the person."""
    rows, columns = np.nonzero(mask)
    side = min(int(ROOM * max(np.ptp(rows), np.ptp(columns))), *mask.shape)
    starts = (
        int(np.clip((index.min() + index.max() - side) // 2, 0, length - side))
        for index, length in zip((rows, columns), mask.shape, strict=True)
    )
    top, left = starts
    return slice(top, top + side), slice(left, left + side)


def save(path: Path, picture: Image) -> None:
    """Write a small JPEG."""
    small = cv2.resize(picture, (SIZE, SIZE), interpolation=cv2.INTER_AREA)
    bgr = cv2.cvtColor(small, cv2.COLOR_RGB2BGR)
    coded, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, 85])
    if not coded:
        raise SystemExit(f"{path}: the picture could not be encoded")
    path.write_bytes(data.tobytes())


def main() -> None:
    """Write the pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--frames", type=int, nargs=2, default=(40, 70), help="part of the clip")
    parser.add_argument("--frame", type=int, default=14, help="counted in that part")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    moment = capture(slice(*arguments.frames), arguments.frame)
    box = around(moment.mask)
    for name, draw in PICTURES.items():
        save(arguments.out / f"{name}.jpg", draw(moment)[box])


if __name__ == "__main__":
    main()
