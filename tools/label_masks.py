"""Label silhouettes of a video by hand, and look at labels.

    python tools/label_masks.py page cam01.mp4 --count 12 --out label.html
    python tools/label_masks.py show cam01.mp4 cam01.json --out sheet.png

``page`` writes a self-contained page for any browser: click along the person's outline, drag
points, start further outlines for further parts or holes (filled by the even-odd rule), and save
a JSON file. ``show`` draws a file's outlines on its frames. Coordinates are pixels of the video
with pixel centres at integers.
"""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import tyro
from numpy.typing import NDArray

from perfcap.io.clip import open_source
from perfcap.io.mask_files import read_labels

Image = NDArray[np.uint8]

_PAGE = Path(__file__).with_suffix(".html")
_GREEN = (64, 255, 64)
_SHEET_HEIGHT = 900  # px of a frame in a contact sheet
_BITS = 4  # of cv2's fixed-point coordinates


@dataclass(frozen=True)
class Page:
    """Write the page that frames are labelled in."""

    video: tyro.conf.Positional[Path]
    """A video or a folder of images."""
    out: Path = Path("label.html")
    """The page."""
    count: int = 12
    """Frames, spread evenly over the video."""

    def run(self) -> None:
        """Write it."""
        source = open_source(self.video)
        frames = np.linspace(0, len(source) - 1, self.count).round().astype(int)
        height, width = source.size
        content = {
            "video": self.video.name,
            "size": [height, width],
            "pictures": {int(f): _as_url(source.read(f, f + 1)[0]) for f in frames},
        }
        # "<" cannot end the script element early
        text = json.dumps(content).replace("<", "\\u003c")
        self.out.write_text(
            _PAGE.read_text(encoding="utf-8").replace("/*CONTENT*/", text), encoding="utf-8"
        )


@dataclass(frozen=True)
class Show:
    """Draw labels on their frames."""

    video: tyro.conf.Positional[Path]
    """The video that was labelled."""
    labels: tyro.conf.Positional[Path]
    """The file the page saved."""
    out: Path = Path("labels.png")
    """The picture."""

    def run(self) -> None:
        """Write it."""
        source = open_source(self.video)
        rows = []
        for frame, polygons in read_labels(self.labels, source.size).items():
            picture = np.ascontiguousarray(source.read(frame, frame + 1)[0][..., ::-1])
            lines = [np.rint(p * 2**_BITS).astype(np.int32) for p in polygons]
            cv2.polylines(picture, lines, True, _GREEN, 1, cv2.LINE_AA, _BITS)
            scale = _SHEET_HEIGHT / picture.shape[0]
            rows.append(cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
        cv2.imwrite(str(self.out), np.concatenate(rows, 1))


def _as_url(frame: Image) -> str:
    _, data = cv2.imencode(".jpg", frame[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 92])
    return "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode()


Command = (
    Annotated[Page, tyro.conf.subcommand("page")] | Annotated[Show, tyro.conf.subcommand("show")]
)

if __name__ == "__main__":
    command: Page | Show = tyro.cli(Command, description=__doc__)
    command.run()
