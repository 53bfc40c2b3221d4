"""The result of a capture, its files, and its motion as a table."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.made_folder import made_folder
from perfcap.io.result_folder import finish, replacing
from perfcap.metrics.missing import check_radians
from perfcap.pipeline.config import RetargetConfig
from perfcap.pipeline.floor import Floor
from perfcap.pipeline.gaps import ranges
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.refine import Refinement
from perfcap.pipeline.refine_contours import ContourRefinement
from perfcap.pipeline.result_files import write_result
from perfcap.pipeline.saved_doubts import saved_doubts
from perfcap.pipeline.surface import SkinnedSurface, SurfaceFrames
from perfcap.pipeline.surroundings import upright
from perfcap.pipeline.track_motion import WindowReport
from perfcap.pipeline.trust import Trust
from perfcap.rates import frame_rate
from perfcap.solve import Status

# --- A captured motion as columns of numbers, one row a frame -------------------------------------

Column = tuple[str, str, str]
LEVELS = ("quantity", "name", "axis")
"""What the three words of a column say."""

_AXES = "xyz"


def frame_table(performance: Performance) -> dict[Column, NDArray[np.float64]]:
    """Columns of F numbers by quantity, name and axis or unit.

    Time in seconds from the first frame; joints, metres in the world; the root's place and rotation
    vector; angles, degrees; the feet's probability of standing; trust, and the expected error in
    millimetres, where the capture knows them.
    """
    motion = performance.motion
    columns: dict[Column, Tensor | NDArray[np.float64]] = {
        ("time", "", "s"): np.arange(performance.frames) / performance.rate
    }
    points = performance.joints()
    for joint, name in enumerate(LANDMARKS):
        columns |= {("joint", name, axis): points[:, joint, k] for k, axis in enumerate(_AXES)}
    for name, values in (("translation", motion.translation), ("rotation", motion.rotation)):
        columns |= {("root", name, axis): values[:, k] for k, axis in enumerate(_AXES)}
    for k, name in enumerate(performance.actor.skeleton.angle_names):
        columns["angle", name, "deg"] = motion.angles[:, k].rad2deg()
    if performance.contact is not None:
        columns |= {("stands", side, ""): performance.contact[:, k] for k, side in enumerate("lr")}
    if performance.trust is not None:
        columns["trust", "", ""] = performance.trust.value
        columns["expected_error", "", "mm"] = performance.trust.error
    return {name: _numbers(values) for name, values in columns.items()}


def state(performance: Performance) -> Mapping[str, Tensor]:
    """Copies of tensors under plain names, as ``torch.save`` and safetensors take them."""
    motion, found = performance.motion, {}
    for name in ("translation", "rotation", "angles"):
        found[f"motion.{name}"] = getattr(motion, name)
    found |= {f"motion.shared.{name}": block for name, block in motion.shared.items()}
    found["joints"] = performance.joints()
    found["rate"] = motion.angles.new_tensor(performance.rate)
    if performance.bone_scales is not None:
        found["bone_scales"] = performance.bone_scales
    if performance.contact is not None:
        found["contact"] = performance.contact
    if performance.trust is not None:
        found |= {"trust": performance.trust.value, "expected_error": performance.trust.error}
    return {name: values.detach().clone().contiguous() for name, values in found.items()}


def _numbers(values: Tensor | NDArray[np.float64]) -> NDArray[np.float64]:
    array = values.numpy(force=True) if isinstance(values, Tensor) else values
    return np.ascontiguousarray(array, dtype=np.float64)


# --- The result of a capture, and its files -------------------------------------------------------

_LAST_FRAME = 1 << 53  # files hold numbers that far
_FRAME_BATCH = 256  # frames posed at once while writing: bounds memory


@dataclass(frozen=True)
class StageReport:
    """Seconds a stage took."""

    name: str
    wall: float
    cpu: float


@dataclass(frozen=True)
class Performance:
    """Captured motion of one person, with what it was captured from.

    Attributes:
        actor: the person, with the bone lengths the motion was solved for.
        cameras: C views.
        detections: as given, (F, C, 16).
        motion: (F,).
        rate: frames a second.
        config: settings of the capture, or of what took it to another actor.
        gaps: half-open frame ranges in which nobody was detected; they are interpolated.
        windows: how the solve of each window went.
        stages: time of each stage.
        lost: frames that should follow, but could not be read.
        bone_scales: log factors of the actor's bone groups, (S,), when they were solved.
        warnings: what a user should know.
        surface: vertices of every frame, where the surface itself was captured.
        refinement: what the images added, where stages looked at them.
        contours: how contours met the edges of images, where a stage did that.
        floor: that feet stand on, where they do.
        contact: probability that the left and the right foot stand, (F, 2), likewise.
        trust: how far each frame can be trusted.
        up: axis of the world, or its opposite, that points up, (3,), where it is known or everybody
            in a scene tells it together; None for the one along which the person stands.
    """

    actor: Actor
    cameras: Camera
    detections: Detections
    motion: Motion
    rate: float
    config: CaptureConfig | RetargetConfig
    gaps: tuple[tuple[int, int], ...] = ()
    windows: tuple[WindowReport, ...] = ()
    stages: tuple[StageReport, ...] = ()
    lost: int = 0
    bone_scales: Tensor | None = None
    warnings: tuple[str, ...] = field(default=())
    surface: SurfaceFrames | None = None
    refinement: Refinement | None = None
    contours: ContourRefinement | None = None
    floor: Floor | None = None
    contact: Tensor | None = None
    trust: Trust | None = None
    up: Tensor | None = None

    def __post_init__(self) -> None:
        counts = {"motion": self.frames}
        counts |= {} if self.contact is None else {"contact": len(self.contact)}
        counts |= {} if self.trust is None else {"trust": len(self.trust.value)}
        counts |= {"windows": self.windows[-1].window.stop} if self.windows else {}
        if len(set(counts.values())) > 1:
            raise InputError(
                f"performance: has {counts} frames; expected as many of each: capture a part of "
                "the detections, or replace all of these"
            )
        check_radians(angles=self.motion.angles)
        if any(not 0 <= start < stop <= self.frames for start, stop in self.gaps) or self.lost < 0:
            raise InputError(
                f"performance: has gaps {self.gaps!r:.80} in {self.frames} frames, lost {self.lost}"
                "; expected (start, stop) within them, and 0 or more"
            )

    @property
    def frames(self) -> int:
        """F."""
        return self.motion.angles.shape[-2]

    @property
    def complete(self) -> bool:
        """Whether every frame was captured from detections by a solve that went well."""
        return not self.not_captured

    @property
    def trusted(self) -> bool:
        """Whether at least three quarters of the frames can be trusted."""
        return self.trust is None or not self.trust.considerable

    @property
    def not_captured(self) -> tuple[tuple[int, int], ...]:
        """Half-open frame ranges: nobody detected, a solve that failed, or frames not read."""
        failed = torch.arange(self.frames + self.lost) >= self.frames
        unsolved = [w.window for w in self.windows if w.status == Status.NOT_FINITE]
        for start, stop in (*self.gaps, *((w.start, w.stop) for w in unsolved)):
            failed[start:stop] = True
        return tuple(ranges(failed))

    def to(self, like: Tensor) -> Self:
        """The same result with the type and device of a tensor; for drawing, on the CPU."""
        return replace(
            self,
            actor=copy.deepcopy(self.actor).to(like),
            cameras=self.cameras.to(like),
            detections=self.detections.to(like),
            motion=self.motion.to(like),
            contact=None if self.contact is None else self.contact.to(like),
            bone_scales=None if self.bone_scales is None else self.bone_scales.to(like),
            up=None if self.up is None else self.up.to(like),
        )

    @property
    def shown(self) -> SurfaceFrames:
        """The surface to draw: the captured one, or that of the motion."""
        if self.surface is not None:
            return self.surface
        return SkinnedSurface(self.actor, self.motion)

    def joints(self) -> Tensor:
        """Landmarks in the world, (F, 16, 3), metres."""
        with torch.no_grad():
            return self.actor.joints(self.motion)

    @property
    def upward(self) -> Tensor:
        """``up`` where it is known, else along which axis of the world the person stands, (3,)."""
        return upright(self.joints()) if self.up is None else self.up

    def to_pandas(self, first_frame: int = 0) -> Any:
        """A ``pandas.DataFrame`` with a row for each frame; see ``frame_table`` for its columns.

        Args:
            first_frame: number of the motion's first frame in the video.

        Raises:
            InputError: pandas is not installed, or the first frame has no such number.
        """
        _require_number(first_frame)
        try:
            pandas: Any = import_module("pandas")
        except ImportError as error:
            raise InputError("to_pandas needs pandas; run: pip install pandas") from error
        rows = pandas.RangeIndex(first_frame, first_frame + self.frames, name="frame")
        return pandas.DataFrame(frame_table(self), index=rows).rename_axis(columns=LEVELS)

    def state(self) -> Mapping[str, Tensor]:
        """Motion, joints, trust and the rate as tensors under plain names, to be saved."""
        return state(self)

    def bone_transforms(self) -> np.ndarray:
        """Rest-to-posed transforms of the template's bones, (F, B, 4, 4)."""
        with torch.no_grad():
            parts = [
                self.actor.bone_transforms(self.motion[start : start + _FRAME_BATCH]).cpu()
                for start in range(0, self.frames, _FRAME_BATCH)
            ]
        stacked: np.ndarray = torch.cat(parts).double().numpy()
        return stacked

    def save(
        self,
        folder: str | Path,
        first_frame: int = 0,
        run: Mapping[str, Any] | None = None,
        view_names: Sequence[str] | None = None,
    ) -> None:
        """Write the files of the result into a folder; an older result there is replaced.

        They appear together, once all are complete, and what is left of an older result goes.

        Args:
            folder: made if it does not exist.
            first_frame: number of the motion's first frame in the video.
            run: what the caller knows about the run (versions, inputs), added to run.json.
            view_names: of the views, for folders of masks where there are several.

        Raises:
            InputError: the folder cannot be written, somebody else writes into it, the first frame
                has no such number, or the rate is none.
        """
        _require_number(first_frame)
        frame_rate(self.rate)
        for line in saved_doubts(self):
            warnings.warn(line, stacklevel=2)
        with made_folder(folder) as place:
            finish(place)
            with replacing(place) as scratch:
                write_result(self, scratch, first_frame, run, view_names)

    def report(self, first_frame: int = 0) -> dict[str, Any]:
        """What happened, as plain values: gaps, windows, times, bone lengths, warnings."""
        scales = self.bone_scales
        names = self.actor.skeleton.group_names
        return {
            "frames": self.frames,
            "fps": self.rate,
            "complete": self.complete,
            "not_captured": [[a + first_frame, b + first_frame] for a, b in self.not_captured],
            "windows": [
                {
                    "frames": [w.window.start + first_frame, w.window.stop + first_frame],
                    "status": w.status.name.lower(),
                    "steps": w.steps,
                    "energy": w.energy,
                    "terms": w.terms,
                }
                for w in self.windows
            ],
            "energy": self._frame_energy(),
            "quality": None if self.trust is None else self.trust.report(first_frame),
            "floor": None if self.floor is None else self.floor.report(),
            "stages": {s.name: {"wall_s": s.wall, "cpu_s": s.cpu} for s in self.stages},
            "bone_scales": None
            if scales is None
            else {n: float(v) for n, v in zip(names, scales.exp(), strict=True)},
            "warnings": list(self.warnings),
            **(
                {}
                if self.refinement is None
                else {"refinement": self.refinement.report(first_frame)}
            ),
            **({} if self.contours is None else {"contours": self.contours.report()}),
        }

    def _frame_energy(self) -> dict[str, list[float]]:
        """Each energy of every frame, the mean over the windows that the frame is in."""
        count = np.zeros(self.frames)
        sums: dict[str, np.ndarray] = {}
        for report in self.windows:
            inside = slice(report.window.start, report.window.stop)
            count[inside] += 1
            for name, values in report.frame_terms.items():
                sums.setdefault(name, np.zeros(self.frames))[inside] += values
        return {n: [float(f"{x:.4g}") for x in v / count] for n, v in sums.items()}


def _require_number(first_frame: object) -> None:
    """Refuse what numbers no frame."""
    whole = isinstance(first_frame, int | float | np.integer) and not isinstance(first_frame, bool)
    if not whole or not 0 <= first_frame < _LAST_FRAME or first_frame != int(first_frame):  # type: ignore[operator, call-overload]
        raise InputError(f"first_frame is {first_frame!r}, expected a whole number of 0 or more")
