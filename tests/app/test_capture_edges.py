"""``perfcap capture --edges``: which weights are asked for, and which calls are refused."""

from __future__ import annotations

import hashlib
import tomllib
from pathlib import Path
from typing import Any

import pytest

from perfcap.app.capture_request import edge_network, edges_of, used_files
from perfcap.commands.capture import Capture
from perfcap.errors import InputError
from perfcap.io import models_folder

SHIPPED = models_folder() / "edges" / "learned" / "weights.safetensors"


def request(**options: Any) -> Capture:
    return Capture(videos=(Path("a.mp4"),), out=Path("out"), **options)


def test_the_shipped_ones_are_asked_for_and_read() -> None:
    contours = request(preset="rhodin2016")
    assert edges_of(contours) == SHIPPED
    assert SHIPPED in used_files(contours, [])
    assert edge_network(contours) is not None


def test_weights_of_ones_own(tmp_path: Path) -> None:
    own = tmp_path / "weights.safetensors"
    own.write_bytes(SHIPPED.read_bytes())
    for path in (own, tmp_path):
        assert edges_of(request(preset="rhodin2016", edges=str(path))) == own


@pytest.mark.parametrize(
    "options", [{}, {"preset": "rhodin2016", "edges": "plain"}, {"edges": "plain"}]
)
def test_nobody_asks_for_them(options: dict[str, str]) -> None:
    assert edges_of(request(**options)) is None
    assert edge_network(request(**options)) is None


def test_weights_that_are_not_there() -> None:
    with pytest.raises(InputError, match="--edges canny: no such weights; expected learned"):
        edges_of(request(preset="rhodin2016", edges="canny"))


def test_the_shipped_file_is_that_of_its_manifest() -> None:
    (file,) = tomllib.loads(SHIPPED.with_name("manifest.toml").read_text(encoding="utf-8"))["file"]
    data = SHIPPED.read_bytes()
    assert (len(data), hashlib.sha256(data).hexdigest()) == (file["size"], file["sha256"])


def test_weights_of_ones_own_that_nobody_asks_for(tmp_path: Path) -> None:
    own = tmp_path / "weights.safetensors"
    own.write_bytes(SHIPPED.read_bytes())
    with pytest.raises(InputError, match="--preset default has no contours that meet edges"):
        edges_of(request(edges=str(own)))
