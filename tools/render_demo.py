"""Render the demo clip: the default actor dances in front of a known camera.

The motion is stored with the clip, so nothing else is needed to make it again::

    python tools/render_demo.py --motion models/demo/truth.npz --out models/demo

A new motion comes from the packed CMU library, a folder with ``clips.npz`` and ``clips.csv``::

    python tools/render_demo.py --cmu LIBRARY --clip 05_10 --start 20 --out models/demo

``--preview`` writes a few frames with their truth and detections drawn over them.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import torch
from demo_clip import stage
from demo_clip.choreography import carry_over, fit, low_pass, smooth
from numpy.typing import NDArray

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.camera import Camera
from perfcap.io.actor import load_actor
from perfcap.io.clip import Clip
from perfcap.io.video_writer import VideoWriter
from perfcap.pipeline.appearance import Appearance
from perfcap.render import (
    ProjectedMesh,
    draw_overlay,
    render,
    shade_ground,
    visibility,
)

sys.path.append(str(Path(__file__).resolve().parents[1] / "experiments"))
import cmu
from demo_clip import files

Image = NDArray[np.uint8]

RATE, RECORDED_RATE = 30.0, 60.0  # Hz
SENSOR_NOISE = 1.6  # grey levels
VIGNETTE = 0.10  # of the brightness, lost at the corners
QUALITY = 18  # x264's constant rate factor
SUPERSAMPLING = 3
MARGIN = 20  # px between the dancer's landmarks and the border


def dance(library: Path, clip: str, start: int, frames: int, actor: Actor) -> Motion:
    """Frames of a recorded clip, at RATE, danced by the actor."""
    recorded = low_pass(cmu.landmarks(library, clip, step=1).numpy(), RECORDED_RATE)
    places = recorded[:: round(RECORDED_RATE / RATE)]
    ankles = [LANDMARKS.index(name) for name in ("r_ankle", "l_ankle")]
    floor = float(np.percentile(places[:, ankles, 1], 5))
    used = torch.tensor(places[start : start + frames].copy())
    if len(used) < frames:
        raise SystemExit(f"--start {start}: clip {clip} has only {len(places)} frames at 30 Hz")
    subject = cmu.skeleton(library, clip)
    fitted = smooth(subject, fit(subject, used, RATE), RATE)
    return carry_over(fitted, subject, floor, actor, RATE)


def film(actor: Actor, motion: Motion, camera: Camera, seed: int) -> Iterator[Image]:
    """Pictures (H, W, 3) of the motion, one a frame."""
    rng = np.random.default_rng(seed)
    skin = Appearance.of(actor.template)
    plate, floor = stage.plate(camera, seed)
    faces, lighting = skin.faces, stage.LIGHTING
    for frame in range(motion.frames):
        with torch.no_grad():
            surface = actor.surface(motion[frame : frame + 1])[0]
        vertices = surface[skin.representative].float()
        darker = shade_ground(plate, camera, vertices, faces, lighting)
        behind = torch.where(floor[..., None], darker, plate)
        picture = render(
            ProjectedMesh.seen_by(camera, vertices, faces),
            skin.texture,
            behind,
            lighting,
            visibility(vertices, faces, lighting),
            SUPERSAMPLING,
        )
        yield exposed(picture.image.numpy(), rng)


def exposed(image: Image, rng: np.random.Generator) -> Image:
    """The picture as a camera takes it: a little darker at the corners, a little noisy."""
    down, across = (np.linspace(-1, 1, size) for size in image.shape[:2])
    bright = 1 - VIGNETTE * 0.5 * (down[:, None] ** 2 + across**2)
    noise = rng.normal(0, SENSOR_NOISE, image.shape)
    seen: Image = np.clip(np.rint(image * bright[..., None] + noise), 0, 255).astype(np.uint8)
    return seen


def preview(folder: Path, path: Path, count: int = 8) -> None:
    """Frames side by side, plain and with truth and detections drawn."""
    clip = Clip.open(folder / "video.mp4")
    with np.load(folder / "detections.npz") as seen, np.load(folder / "truth.npz") as truth:
        pixels = stage.camera().project(torch.tensor(truth["joints3d"]))[:, 0].numpy()
        joints2d, confidence = seen["joints2d"], seen["confidence2d"]
    columns = []
    for frame in np.linspace(0, len(pixels) - 1, count).astype(int):
        plain = clip.read(int(frame), int(frame) + 1)[0, 0]
        drawn = draw_overlay(plain, None, pixels[frame], joints2d[frame], confidence[frame])
        columns.append(np.concatenate([plain, drawn]))
    cv2.imwrite(str(path), np.concatenate(columns, 1)[..., ::-1])


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--motion", type=Path, help="truth.npz of an earlier clip")
    source.add_argument("--cmu", type=Path, help="folder of the packed CMU library")
    parser.add_argument("--clip", default="05_10", help="its clip")
    parser.add_argument("--start", type=int, default=20, help="first frame, counted at 30 Hz")
    parser.add_argument("--frames", type=int, default=120)
    parser.add_argument("--actor", default="sam")
    parser.add_argument("--seed", type=int, default=1, help="of detections and noise")
    parser.add_argument("--out", type=Path, required=True, help="folder of the clip")
    parser.add_argument("--preview", type=Path, help="picture of a few frames")
    return parser.parse_args()


def main() -> None:
    options = arguments()
    actor, camera, rate = load_actor(options.actor), stage.camera(), RATE
    if options.motion:
        motion, rate = files.read_truth(options.motion, actor)
    else:
        motion = dance(options.cmu, options.clip, options.start, options.frames, actor)
    joints = actor.joints(motion)
    pixels = camera.project(joints)
    if pixels.min() < MARGIN or pixels.max() > stage.SIZE - 1 - MARGIN:
        raise SystemExit("the dancer leaves the picture; choose other frames")
    options.out.mkdir(parents=True, exist_ok=True)
    files.save_truth(options.out / "truth.npz", actor, motion, rate)
    files.save_camera(options.out / "camera.json", camera, rate)
    files.save_detections(options.out / "detections.npz", camera, joints, options.seed)
    with VideoWriter(options.out / "video.mp4", rate, crf=QUALITY, preset="slow") as writer:
        for image in film(actor, motion, camera, options.seed):
            writer.write(image)
    files.save_manifest(options.out)
    if options.preview:
        preview(options.out, options.preview)


if __name__ == "__main__":
    main()
