"""Project folders of other programs in place of videos, cameras and joints."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from perfcap.app.console import PlainConsole
from perfcap.commands.views import Views
from perfcap.io.project import Project, open_project

_LOG = logging.getLogger(__name__)

Asked = TypeVar("Asked", bound=Views)


def in_project(request: Asked) -> Asked:
    """A request with the files of its project, where it names a project's folder alone.

    What the request says itself stays. One sentence says what was found.

    Raises:
        InputError: a project that lacks something.
    """
    found = find_project(
        request.videos, request.cameras, joints=not request.detections and not request.detector
    )
    if found is None:
        return request
    return replace(
        request,
        videos=found.videos,
        cameras=found.cameras,
        detections=request.detections or found.detections,
    )


def find_project(
    videos: Sequence[Path], cameras: Path | None, *, joints: bool = True
) -> Project | None:
    """The project that is given in place of videos, told in a sentence; None where it is none.

    Raises:
        InputError: a project that lacks something.
    """
    found = open_project(videos[0], cameras=cameras, joints=joints) if len(videos) == 1 else None
    if found is None:
        return None
    PlainConsole().print(found.sentence(), soft_wrap=True)
    for line in found.warnings:
        _LOG.warning("%s", line)
    return found
