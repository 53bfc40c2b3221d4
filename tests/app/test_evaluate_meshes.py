"""True surfaces with vertices of their own, as the MonoPerfCap benchmark has them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from rendered_files import metrics_of, save_motion
from runs import Command

from perfcap.io.surface_file import save_surface

FRAMES = 12


def body(frame: int, mesh: trimesh.Trimesh) -> np.ndarray:
    """An ellipsoid 1.8 m tall that walks, bends and swells."""
    time = frame / 4
    points = mesh.vertices * [0.3, 0.9, 0.2 + 0.05 * np.sin(2 * time)]
    points[:, 0] += 0.25 * np.sin(time) * points[:, 1] ** 2 + 0.05 * frame
    return np.asarray(points)


@pytest.fixture
def result(tmp_path: Path) -> Path:
    """On a template of its own, 3 cm behind the truth."""
    ball = trimesh.creation.icosphere(subdivisions=2)
    vertices = np.stack([body(frame, ball) for frame in range(FRAMES)])
    vertices[..., 2] += 0.03
    folder = tmp_path / "r"
    save_motion(folder, np.random.default_rng(0).normal(size=(FRAMES, 16, 3)))
    save_surface(folder / "surface.npz", [vertices], ball.faces, np.arange(FRAMES), 30.0)
    return folder


def write(
    folder: Path, scale: float = 1000.0, frame_of: Callable[[int], int] = lambda frame: frame
) -> None:
    place = folder / "Pablo_outdoor"
    (place / "ground_truth").mkdir(parents=True)
    lens, turn = np.diag([1500.0, 1500, 1, 1]), np.eye(4)
    rows = [" ".join(map(str, matrix.ravel())) for matrix in (lens, turn)]
    (place / "calib.txt").write_text(
        "Skeletool Camera Calibration File V1.0\nname 0\n"
        f"intrinsic {rows[0]}\nextrinsic {rows[1]}\nradial 0\n"
    )
    ball = trimesh.creation.uv_sphere(count=[24, 24])
    for frame in range(FRAMES):
        points = scale * body(frame_of(frame), ball)
        lines = [
            "OFF",
            f"{len(points)} {len(ball.faces)} 0",
            *(f"{x} {y} {z}" for x, y, z in points),
        ]
        lines += [f"3 {a} {b} {c}" for a, b, c in ball.faces]
        (place / "ground_truth" / f"{frame:04d}.off").write_text("\n".join(lines))


def evaluated(result: Path, truth: Path, perfcap: Command) -> tuple[dict[str, object], list[str]]:
    options = ["--dataset", "monoperfcap", "--sequence", "Pablo_outdoor", "--every", 3]
    assert perfcap(["evaluate", result, "--truth", truth, *options]).code == 0
    values = metrics_of(result)
    return values, values["notes"][1:]  # the first says how files were numbered


@pytest.mark.long
def test_surfaces_of_any_topology_are_compared(
    tmp_path: Path, result: Path, perfcap: Command
) -> None:
    write(tmp_path / "t")
    values, notes = evaluated(result, tmp_path / "t", perfcap)
    assert values["mesh_frames"] == 4 and not notes
    assert isinstance(values["surface_transl_mm"], float)
    assert values["surface_transl_mm"] < 8  # two triangulations of one shape
    assert values["surface_abs_mm"] > 12  # 3 cm in depth, less along the sides


@pytest.mark.long
@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"scale": 1.0}, "true surfaces are 0.001 times as large as that of the result"),
        ({"frame_of": lambda frame: max(frame - 2, 0)}, "true surfaces of 2 frames later"),
    ],
)
def test_wrong_true_surfaces_are_named(
    tmp_path: Path, result: Path, perfcap: Command, options: dict[str, object], said: str
) -> None:
    write(tmp_path / "t", **options)  # type: ignore[arg-type]
    _, notes = evaluated(result, tmp_path / "t", perfcap)
    assert len(notes) == 1 and said in notes[0]
