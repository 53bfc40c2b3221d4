"""The networks of a capture: found by name, run over a clip."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from perfcap.app.network_trial import require_sides
from perfcap.detect.crop import Frame
from perfcap.detect.detections import Detections
from perfcap.detect.look import Box
from perfcap.detect.manifest import FILE as MANIFEST
from perfcap.detect.manifest import PEOPLE, read_manifest
from perfcap.detect.onnx import OnnxDetector, stack_views
from perfcap.detect.people import OnnxFinder
from perfcap.detect.person import Start, follow_people, follow_person
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.actor import models_folder
from perfcap.io.clip import Clip
from perfcap.pipeline.checkpoint import NO_CHECKPOINT, Checkpoint, RememberingNetwork

DETECTORS, LIFTERS = "detectors", "lifters"
SEGMENTER = "segmenter.toml"  # of a shipped detector that answers with masks as well
NO_SEGMENTER = "none"
EDGES, WEIGHTS, PLAIN_EDGES = "edges", "weights.safetensors", "plain"

_LEAST = 2  # tracks of a view that are told apart, of whom one may be asked for
_CHUNK = 16  # frames decoded at once

# called with a stage's name, what is done and what there is to do
Tell = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Detecting:
    """How to detect joints in the images of a clip.

    Attributes:
        detectors: the networks; the first one follows the person, the others add to it.
        boxes: (left, top, right, bottom) of the person in the first frame of each view; none to
            search.
        person: which one of a search, 1 for the surest.
        chosen: whether the user said which one.
        people: how many of a search are followed, each on their own; None for that one.
        poses: whether 3D joints of the others are of use where the first one has none.
        finder: finds the people of whole images; windows are searched without one.
        watcher: tells others from the one who is followed; the finder if None.
        tell: told how far it is.
        checkpoint: keeps what the network answered.
    """

    detectors: tuple[OnnxDetector, ...]
    boxes: tuple[Box, ...] = ()
    person: int = 1
    tell: Tell = lambda stage, done, total: None
    checkpoint: Checkpoint = NO_CHECKPOINT
    people: int | None = None
    poses: bool = False
    finder: OnnxFinder | None = None
    watcher: OnnxFinder | None = None
    chosen: bool = False


def open_networks(names: Sequence[str]) -> tuple[OnnxFinder | None, tuple[OnnxDetector, ...]]:
    """What ``--detector`` names: a network that finds people, if the first does; the others.

    Raises:
        InputError: there is no such model, or none that looks at people up close; or one of the
            user's own takes left for right.
    """
    folders = [find_model(name, DETECTORS) for name in names]
    finds = [read_manifest(folder).output.kind == PEOPLE for folder in folders]
    if any(finds[1:]):
        name = names[finds.index(True, 1)]
        raise InputError(
            f"--detector {' '.join(names)}: {name} finds the people of whole images; expected one "
            "such network at most, named first"
        )
    if finds == [True]:
        raise InputError(
            f"--detector {names[0]}: finds people in whole images and does not follow them; name "
            f"networks that look up close after it: --detector {names[0]} thunder"
        )
    finder = OnnxFinder(folders[0]) if finds[0] else None
    detectors = tuple(OnnxDetector(folder) for folder in folders[finds[0] :])
    shipped = models_folder().resolve()
    networks: list[OnnxFinder | OnnxDetector] = [*filter(None, (finder,)), *detectors]
    for network in networks:
        if shipped not in network.manifest.path.resolve().parents:
            require_sides(network)
    return finder, detectors


def open_watcher(name: str | None) -> OnnxFinder | None:
    """The shipped network that tells others from the person, by its name; none without one."""
    return None if name is None else OnnxFinder(find_model(name, DETECTORS))


def find_model(name: str, kind: str) -> Path:
    """A model's folder or manifest by path, or a shipped one by name.

    Args:
        name: what the user said.
        kind: folder under ``models``.

    Raises:
        InputError: there is no such model.
    """
    path = Path(name)
    if path.is_dir() or path.is_file():
        return path
    shipped = models_folder() / kind
    if path.name == name and (shipped / name / MANIFEST).is_file():
        return shipped / name
    known = sorted(p.parent.name for p in shipped.glob(f"*/{MANIFEST}"))
    listing = f", or one of {', '.join(known)}" if known else ""
    raise InputError(
        f"--{kind.removesuffix('s')} {name}: no such folder; expected a folder with {MANIFEST} and "
        f"a model{listing}"
    )


def find_segmenter(name: str) -> Path:
    """The manifest of a network of person masks by path, or that of a shipped one by name.

    Raises:
        InputError: there is no such network.
    """
    path = Path(name)
    if path.suffix.lower() == ".onnx":
        raise InputError(
            f"--segmenter {name}: is a network without its manifest; expected {MANIFEST} of kind "
            "segmenter, or its folder (docs/detectors.md has an example)"
        )
    if path.is_dir() or path.is_file():
        return path
    shipped = models_folder() / DETECTORS
    if path.name == name and (shipped / name / SEGMENTER).is_file():
        return shipped / name / SEGMENTER
    known = ", ".join(sorted(p.parent.name for p in shipped.glob(f"*/{SEGMENTER}")))
    raise InputError(
        f"--segmenter {name}: no such folder; expected one with {MANIFEST}, or {known}, or none"
    )


def find_edge_network(name: str) -> Path | None:
    """Weights of a network of edges by path, or shipped ones by name; None for edges as they are.

    Raises:
        InputError: there are no such weights.
    """
    if name == PLAIN_EDGES:
        return None
    path, shipped = Path(name), models_folder() / EDGES
    if path.name == name and (shipped / name / WEIGHTS).is_file():
        return shipped / name / WEIGHTS
    if path.is_file():
        return path
    if (path / WEIGHTS).is_file():
        return path / WEIGHTS
    known = ", ".join(sorted(p.parent.name for p in shipped.glob(f"*/{WEIGHTS}")))
    raise InputError(
        f"--edges {name}: no such weights; expected {known}, a .safetensors file that "
        f"experiments/learned_edges.py wrote, or {PLAIN_EDGES}"
    )


def parse_boxes(numbers: Sequence[float], views: int) -> tuple[Box, ...]:
    """Four numbers a view: left, top, right, bottom.

    Raises:
        InputError: another count, or a box without area.
    """
    if not numbers:
        return ()
    if len(numbers) != 4 * views:
        raise InputError(
            f"--box: has {len(numbers)} numbers, expected LEFT TOP RIGHT BOTTOM for each of "
            f"{views} views"
        )
    boxes = []
    for i in range(0, len(numbers), 4):
        left, top, right, bottom = numbers[i : i + 4]
        if not (right > left and bottom > top):
            raise InputError(
                f"--box: {left:g} {top:g} {right:g} {bottom:g} is no box; expected left < right "
                "and top < bottom, in pixels of the video"
            )
        boxes.append((left, top, right, bottom))
    return tuple(boxes)


def detect_clip(clip: Clip, detecting: Detecting, cameras: Camera) -> Detections:
    """Joints of one person in all views of a clip, in pixels of the videos, (F, C, 16).

    Args:
        clip: the videos.
        detecting: network and settings.
        cameras: C views, in pixels of the videos.

    Raises:
        InputError: nobody is found anywhere.
    """
    boxes: Sequence[Box | None] = detecting.boxes or [None] * clip.views
    found = []
    for view, box in enumerate(boxes):
        first, *others = _remembering(detecting, view)
        frames, camera = _frames(clip, view, detecting.tell), _view(cameras, view, len(clip))
        # of several views, the others show who is followed
        alone = clip.views == 1 and detecting.people is None and not detecting.chosen
        finder = detecting.finder
        start = Start(box, detecting.person, finder, alone, detecting.watcher or finder)
        found.append(follow_person(first, frames, start, camera, others, detecting.poses))
    whole = stack_views(found)
    if not (whole.confidence2d > 0).any() and whole.joints3d is None:
        if detecting.person > 1:
            seen = f"fewer people are seen in every frame of {', '.join(clip.names)}"
            if detecting.people is not None:
                most = detecting.person - 1
                raise InputError(f"--people {detecting.people}: {seen}; expected {most} at most")
            raise InputError(
                f"--person {detecting.person}: {seen}; expected 1 for the surest, 2 for the next"
            )
        raise _nobody(clip, detecting)
    return whole


def detect_everybody(clip: Clip, detecting: Detecting, cameras: Camera) -> Detections:
    """Joints of several people, (P, F, C, 16): in every view, each slot follows somebody.

    Who that is differs from view to view. Where no network finds people in whole images, each slot
    follows on its own, and two may follow the same person.

    Raises:
        InputError: nobody is found anywhere.
    """
    count = detecting.people or 1
    if detecting.finder is not None:
        # one alone may be another person in each view, and still be put together
        return _together(clip, detecting, cameras, detecting.finder, max(count, _LEAST))
    found = []
    for person in range(1, count + 1):
        kept = detecting.checkpoint.of(f"slot{person}")
        found.append(detect_clip(clip, replace(detecting, person=person, checkpoint=kept), cameras))
    return Detections.stack(found)


def _together(
    clip: Clip, detecting: Detecting, cameras: Camera, finder: OnnxFinder, count: int
) -> Detections:
    """So many people at once, each followed by one slot alone."""
    views = []
    for view in range(clip.views):
        first, *others = _remembering(detecting, view)
        frames, camera = _frames(clip, view, detecting.tell), _view(cameras, view, len(clip))
        found = follow_people(first, frames, finder, count, camera, others, detecting.poses)
        views.append([each.without_poses() for each in found])  # slots change hands
    whole = Detections.stack([stack_views(slot) for slot in zip(*views, strict=True)])
    if not (whole.confidence2d > 0).any():
        raise _nobody(clip, detecting)
    return whole


def _nobody(clip: Clip, detecting: Detecting) -> InputError:
    return InputError(
        f"{', '.join(clip.names)}: nobody is found in any frame by "
        f"{detecting.detectors[0].manifest.path.parent}; expected a visible person; say where "
        "with --box LEFT TOP RIGHT BOTTOM"
    )


def _remembering(detecting: Detecting, view: int) -> Iterator[RememberingNetwork]:
    for number, detector in enumerate(detecting.detectors):
        yield RememberingNetwork(detector, detecting.checkpoint.kept(_kept_name(number, view)))


def _kept_name(number: int, view: int) -> str:
    return f"detect_{view}" if number == 0 else f"detect_{view}_{number}"


def _frames(clip: Clip, view: int, tell: Tell) -> Iterator[Frame]:
    total = clip.views * len(clip)
    for start in range(0, len(clip), _CHUNK):
        tell("detect", view * len(clip) + start, total)
        yield from clip.read_view(view, start, min(start + _CHUNK, len(clip)))
    tell("detect", (view + 1) * len(clip), total)


def _view(cameras: Camera, view: int, frames: int) -> Camera:
    return cameras.frames(slice(0, frames)).select([view])
