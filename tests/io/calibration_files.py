"""Known cameras, and how programs write them."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

K = np.array([[900.0, 0, 320], [0, 910, 241], [0, 0, 1]])
LENS = np.array([-0.1, 0.05, 0.001, -0.002, 0.01])
NAMES = ("cam01", "cam02")


def pose(i: int) -> tuple[np.ndarray, np.ndarray]:
    rotation = cv2.Rodrigues(np.array([0.2, 0.5 * i - 0.3, 0.1]))[0]
    return rotation, np.array([0.1 * i, -0.2, 4.0])


def entry(i: int = 0) -> dict[str, Any]:
    rotation, translation = pose(i)
    return {
        "K": K.tolist(),
        "R": rotation.tolist(),
        "t": translation.tolist(),
        "distortion": LENS.tolist(),
        "width": 640,
        "height": 480,
    }


def write(path: Path, data: Any) -> Path:
    path.write_text(json.dumps(data))
    return path


def write_toml(folder: Path, extra: str = "") -> Path:
    text = ""
    for i, name in enumerate(NAMES):
        rotation, translation = pose(i)
        vector = cv2.Rodrigues(rotation)[0].reshape(-1)
        text += f'[int_{name}_img]\nname = "int_{name}_img"\nsize = [640.0, 480.0]\n'
        text += f"matrix = {K.tolist()}\ndistortions = {LENS.tolist()}\n"
        text += f"rotation = {vector.tolist()}\ntranslation = {translation.tolist()}\n{extra}\n"
    path = folder / "Calib_scene.toml"
    path.write_text(text + "[metadata]\nerror = 0.0\n")
    return path


def write_easymocap(
    folder: Path, sizes: bool = True, rotation_vector: bool = False, turn: float | None = None
) -> Path:
    """Both files; ``turn`` puts vectors of rotations so many degrees off beside the matrices."""
    inner = cv2.FileStorage(str(folder / "intri.yml"), cv2.FILE_STORAGE_WRITE)
    outer = cv2.FileStorage(str(folder / "extri.yml"), cv2.FILE_STORAGE_WRITE)
    for file in (inner, outer):
        file.startWriteStruct("names", cv2.FileNode_SEQ)
        for name in NAMES:
            file.write("", name)
        file.endWriteStruct()
    for i, name in enumerate(NAMES):
        rotation, translation = pose(i)
        inner.write(f"K_{name}", K)
        inner.write(f"dist_{name}", LENS.reshape(1, 5))
        if sizes:
            inner.write(f"H_{name}", 480)
            inner.write(f"W_{name}", 640)
        vector = cv2.Rodrigues(rotation)[0]
        outer.write(*((f"R_{name}", vector) if rotation_vector else (f"Rot_{name}", rotation)))
        if turn is not None:
            about = cv2.Rodrigues(np.array([0.0, np.radians(turn), 0.0]))[0]
            outer.write(f"R_{name}", cv2.Rodrigues(about @ rotation)[0])
        outer.write(f"T_{name}", translation.reshape(3, 1))
    inner.release()
    outer.release()
    return folder


def write_colmap(folder: Path, model: str = "OPENCV", names: tuple[str, ...] = NAMES) -> Path:
    parameters = {
        "SIMPLE_PINHOLE": "900 320 241",
        "PINHOLE": "900 910 320 241",
        "SIMPLE_RADIAL": "900 320 241 -0.1",
        "RADIAL": "900 320 241 -0.1 0.05",
        "OPENCV": "900 910 320 241 -0.1 0.05 0.001 -0.002",
        "FISHEYE": "1 2 3",
    }[model]
    lines = ["# Camera list"]
    lines += [f"{i + 1} {model} 640 480 {parameters}" for i in range(len(names))]
    (folder / "cameras.txt").write_text("\n".join(lines) + "\n")
    text = "# Image list with two lines of data per image\n"
    for i, name in enumerate(names):
        rotation, translation = pose(i)
        vector = cv2.Rodrigues(rotation)[0].reshape(-1)
        half = np.linalg.norm(vector) / 2
        quaternion = [np.cos(half), *(np.sin(half) * vector / (2 * half))]
        numbers = " ".join(repr(float(v)) for v in (*quaternion, *translation))
        points = "10.5 20.5 -1" if i == 0 else ""  # the second line may be empty
        text += f"{i + 1} {numbers} {i + 1} {name}.png\n{points}\n"
    (folder / "images.txt").write_text(text)
    return folder
