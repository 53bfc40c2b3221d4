"""``perfcap demo``: the shipped clip, captured and compared with its truth."""

from __future__ import annotations

from pathlib import Path

from perfcap.app.capture import run_capture
from perfcap.app.console import PlainConsole
from perfcap.app.evaluate import error_table, evaluate
from perfcap.commands.capture import Capture
from perfcap.io.actor import models_folder

ACTOR = "sam"


def run_demo(out: Path, overwrite: bool = False) -> int:
    """Capture the demo clip and print its errors; returns the exit code."""
    source = models_folder() / "demo"
    code = run_capture(
        Capture(
            videos=(source / "video.mp4",),
            actor=(ACTOR,),
            cameras=source / "camera.json",
            detections=(source / "detections.npz",),
            out=out,
            bones="template",
            until="track_motion",
            resume=True,
            overwrite=overwrite,
        )
    )
    console = PlainConsole()
    console.print(error_table(evaluate(out / "motion.npz", source / "truth.npz")))
    for line in (
        f"look at {out / 'overlay.mp4'}; open {out / 'capture.glb'} in Blender",
        f"perfcap view {out} plays it in a browser",
    ):
        console.print(line, soft_wrap=True)
    return code
