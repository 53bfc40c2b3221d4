"""The images of a clip, as the stages that look at them want them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.clip import Clip, FrameReader
from perfcap.segment.edge_network import EdgeNetwork
from perfcap.segment.network_cue import PersonNetwork, Plane
from perfcap.segment.trimap import Box, Mask

Frames = NDArray[np.uint8]


class KnownMasks(Protocol):
    """Masks of the person that somebody has; ``perfcap.io.mask_files.MaskFolders`` is one."""

    def knows(self, view: int, frame: int) -> bool:
        """Whether there is one of a frame."""

    def mask(self, view: int, frame: int) -> NDArray[np.bool_] | None:
        """(H, W) of the view's images; None where nobody has one."""


@dataclass(frozen=True)
class Images:
    """Frames, and cameras in their pixels.

    Attributes:
        reader: the frames, in the order of those that are captured.
        cameras: C views in pixels of the images, (C,) or (F, C), with their sizes.
        segmenter: a network that finds people in them, as a cue of silhouettes; None to go without.
        masks: silhouettes of the person where they are known, used as they are; None without any.
        examined: somebody has seen already that they show the person whose joints are captured.
        lag: frames by which each image was taken later than its frame of the motion, (F, C), less
            than one either way; NaN where a view has no image of that time, and gives another in
            its place. None where clocks agree. What meets edges of raw images heeds it.
        edges: a network that weighs the edges that contours meet; None for edges as they are.
        names: of the views, for sentences; those of a ``Clip`` when not given, else None.
    """

    reader: FrameReader
    cameras: Camera
    segmenter: PersonNetwork | None = None
    masks: KnownMasks | None = None
    examined: bool = False
    lag: Tensor | None = None
    edges: EdgeNetwork | None = None
    names: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        masks = self.masks is None or hasattr(self.masks, "knows")
        if (
            not isinstance(self.cameras, Camera)
            or not hasattr(self.reader, "read_view")
            or not masks
        ):
            kinds = ", ".join(type(x).__name__ for x in (self.reader, self.cameras, self.masks))
            raise InputError(
                f"images: reader, cameras and masks are {kinds}; expected a Clip or another reader "
                "of views, a Camera (the cameras of a CameraRig), and MaskFolders or None"
            )
        if self.segmenter is not None and not callable(self.segmenter):
            raise InputError(
                f"images: segmenter is a {type(self.segmenter).__name__}, expected an "
                "OnnxSegmenter, a function of (image, model, spine, part), or None"
            )
        if self.edges is not None and not isinstance(self.edges, EdgeNetwork):
            raise InputError(
                f"images: edges is a {type(self.edges).__name__}; expected an EdgeNetwork or None"
            )
        if len(self.cameras.size) != self.cameras.views:
            raise InputError(
                f"images have cameras of {self.cameras.views} views with "
                f"{len(self.cameras.size)} image sizes; give the (height, width) of every view"
            )

        if self.names is None and isinstance(self.reader, Clip):
            object.__setattr__(self, "names", self.reader.names)
        lags = len(self.reader), self.cameras.views
        if self.lag is not None and self.lag.shape != lags:
            raise InputError(
                f"images have lags {tuple(self.lag.shape)} for {lags[0]} frames of {lags[1]} "
                "views; expected one a frame and view"
            )

    def checked(self) -> Self:
        """The same, whose frames are refused where they are not those of the cameras."""
        sizes = self.cameras.size
        masks = None if self.masks is None else _CheckedMasks(self.masks, sizes)
        network = None if self.segmenter is None else _CheckedNetwork(self.segmenter)
        reader = _Checked(self.reader, sizes)
        return replace(self, reader=reader, segmenter=network, masks=masks)

    def frames(self, span: slice) -> Self:
        """The images of some frames in a row, and their cameras."""
        start, stop, step = span.indices(len(self.reader))
        if step != 1:
            raise ValueError(f"images of every {step} frames are asked for, expected each in a row")
        cameras = self.cameras.frames(slice(start, stop))
        masks = None if self.masks is None else _PartOfMasks(self.masks, start)
        lag = None if self.lag is None else self.lag[start:stop]
        reader = PartOfReader(self.reader, start, stop)
        return replace(self, reader=reader, cameras=cameras, masks=masks, lag=lag)


@dataclass(frozen=True)
class _Checked:
    """Frames of known sizes: compiled kernels believe what they are given."""

    reader: FrameReader
    sizes: Sequence[tuple[int, int]]

    def __len__(self) -> int:
        return len(self.reader)

    def read_view(self, view: int, start: int, stop: int) -> Frames:
        found = self.reader.read_view(view, start, stop)
        height, width = self.sizes[view]
        if found.shape[1:] != (height, width, 3) or found.dtype != np.uint8:
            raise InputError(
                f"images of view {view} are {found.dtype} {tuple(found.shape)}, their cameras are "
                f"of {height} rows and {width} columns; expected uint8 (frames, {height}, {width}, "
                "3): give cameras in pixels of the images (read_cameras(path, clip.sizes))"
            )
        if len(found) != stop - start:
            raise InputError(
                f"images of view {view}: the reader gave {len(found)} of frames {start} to "
                f"{stop - 1}; expected all up to its length, {len(self)}"
            )
        return found


@dataclass(frozen=True)
class PartOfReader:
    """Frames ``start`` to ``stop`` of a reader, counted from 0."""

    reader: FrameReader
    start: int
    stop: int

    def __len__(self) -> int:
        return max(0, self.stop - self.start)

    def read_view(self, view: int, start: int, stop: int) -> Frames:
        """RGB frames of a view, (stop - start, H, W, 3) uint8; fewer at its end."""
        stop = min(self.start + stop, self.stop)
        return self.reader.read_view(view, self.start + start, stop)


@dataclass(frozen=True)
class _CheckedMasks:
    """Masks of the sizes of images."""

    masks: KnownMasks
    sizes: Sequence[tuple[int, int]]

    def knows(self, view: int, frame: int) -> bool:
        return self.masks.knows(view, frame)

    def mask(self, view: int, frame: int) -> NDArray[np.bool_] | None:
        found = self.masks.mask(view, frame)
        if found is not None and (found.shape != self.sizes[view] or found.dtype != np.bool_):
            raise InputError(
                f"mask of view {view}, frame {frame}: is {found.dtype} {tuple(found.shape)}, "
                f"expected bool {tuple(self.sizes[view])} as the images are"
            )
        return found


@dataclass(frozen=True)
class _CheckedNetwork:
    """A network whose answers are log odds of the part that is asked for."""

    network: PersonNetwork

    def __call__(
        self, image: NDArray[np.uint8], model: Mask, spine: NDArray[np.floating], part: Box
    ) -> Plane:
        found = self.network(image, model, spine, part)
        known = isinstance(found, np.ndarray)
        if not known or found.shape != model.shape or found.dtype.kind not in "fiu":
            given = f"{found.dtype} {found.shape}" if known else type(found).__name__
            raise InputError(
                f"segmenter: gave {given}, expected floating-point log odds {model.shape} of the "
                "part of the image that is asked for, as a NumPy array"
            )
        if np.isnan(found).any():
            raise InputError("segmenter: gave log odds that are NaN; expected numbers")
        return found.astype(np.float32, copy=False)


@dataclass(frozen=True)
class _PartOfMasks:
    """Masks from frame ``start`` on."""

    masks: KnownMasks
    start: int

    def knows(self, view: int, frame: int) -> bool:
        return self.masks.knows(view, self.start + frame)

    def mask(self, view: int, frame: int) -> NDArray[np.bool_] | None:
        return self.masks.mask(view, self.start + frame)
