"""A room with spots on its wall and floor, filmed by a camera in a hand."""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import rotvec_to_matrix

FRAMES, SIDE, FOCAL, RATE = 75, 240, 260.0, 30.0
FAR, HIGH = 6.0, 1.5  # m: of a wall before the camera, and of the camera above a floor
TEXTURE = 60.0  # px a metre
SPOTS = cv2.resize(
    np.random.default_rng(0).integers(0, 255, (200, 200), dtype=np.uint8),
    (1000, 1000),
    interpolation=cv2.INTER_CUBIC,
)


@dataclass(frozen=True)
class Room:
    """A wall and a floor with spots, and a bright person, seen by a camera in a hand."""

    zoom: float = 1.0
    plain: bool = False
    person: float = 0.25
    distortion: tuple[float, ...] = ()

    def __len__(self) -> int:
        return FRAMES

    @cached_property
    def camera(self) -> Camera:
        time = torch.arange(FRAMES).double()[:, None, None] / RATE
        turn = torch.cat((0.05 * (3 * time).sin(), 0.1 * (2 * time).sin(), 0.02 * time.sin()), -1)
        place = torch.cat((0.3 * time, 0.05 * (4 * time).sin(), 0.1 * time * time), -1)
        rotation = rotvec_to_matrix(turn)
        shift = -(rotation @ place[..., None])[..., 0]
        middle = 0.5 * (SIDE - 1)
        lens = torch.tensor([[FOCAL, 0, middle], [0, FOCAL, middle], [0, 0, 1]]).double()
        given = None
        if self.distortion:
            given = torch.tensor(self.distortion).double().expand(FRAMES, 1, 5)
        return Camera(lens.expand(FRAMES, 1, 3, 3), rotation, shift, given, ((SIDE, SIDE),))

    @cached_property
    def pictures(self) -> NDArray[np.uint8]:
        """(F, H, W, 3)."""
        return np.stack([self._picture(frame) for frame in range(FRAMES)])

    def _picture(self, frame: int) -> NDArray[np.uint8]:
        camera = self.camera
        rotation = camera.rotation[frame, 0].numpy()
        centre = -rotation.T @ camera.translation[frame, 0].numpy()
        rows, columns = np.mgrid[:SIDE, :SIDE].astype(float)
        pixels = np.stack((columns, rows), -1).reshape(-1, 2)
        pixels = (pixels - pixels.mean(0)) / self.zoom ** (frame / FRAMES) + pixels.mean(0)
        plane = camera.frames(slice(frame, frame + 1)).to_plane(
            torch.from_numpy(pixels)[None, None]
        )
        rays = np.pad(plane[0, 0].numpy(), ((0, 0), (0, 1)), constant_values=1.0) @ rotation
        floor = (HIGH - centre[1]) / np.maximum(rays[:, 1], 1e-9)
        wall = (FAR - centre[2]) / rays[:, 2]
        at = centre + np.minimum(floor, wall)[:, None] * rays
        place = np.where((floor < wall)[:, None], at[:, [0, 2]] + (0, 3), at[:, :2] + (0, -3))
        place = (TEXTURE * (place + 8)).reshape(SIDE, SIDE, 2).astype(np.float32)
        image = cv2.remap(SPOTS, place[..., 0], place[..., 1], cv2.INTER_LINEAR)
        image = np.full_like(image, 90) if self.plain else image
        top, left = int((0.5 - self.person) * SIDE), int((0.5 - self.person / 2) * SIDE)
        image[top : SIDE - top, left + frame // 4 : SIDE - left + frame // 4] = 250
        return np.asarray(image)[..., None].repeat(3, -1)

    @cached_property
    def seen(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Joints (F, 1, 16, 2) along the person, and how sure they are."""
        top = (0.5 - self.person) * SIDE
        body = np.stack((np.full(16, SIDE / 2), np.linspace(top, SIDE - top, 16)), -1)
        joints = np.stack([[body + np.array([frame // 4, 0])] for frame in range(FRAMES)])
        return joints, np.ones(joints.shape[:-1])

    def read_view(self, view: int, start: int, stop: int) -> NDArray[np.uint8]:
        return self.pictures[start:stop]
