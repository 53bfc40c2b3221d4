"""``python -m experiments list [WORD ...]``, and ``python -m experiments run NAME [OPTIONS ...]``.

The scripts by what they show; words choose those whose name, line or group has them.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from pathlib import Path

FOLDER = Path(__file__).resolve().parent

GROUPS = {
    "How accurate is the motion?": (
        "rendered_accuracy", "own_skeleton", "multi_view", "views_sweep", "video_alone", "peers",
        "lifter_real", "fast_motion", "angle_limits", "joint_table", "pose_refiner", "pose_fusion",
    ),
    "And the surface?": (
        "stage_ablation", "real_silhouettes", "segmentation_ablation", "shaken_masks",
        "held_out_masks", "worst_masks", "boundary_trust", "paired_or_soft",
    ),
    "Raw images, without background or masks (Rhodin et al. 2016)": (
        "contours", "contour_cues", "contour_clocks",
    ),
    "Bodies and characters": (
        "body_fit", "real_body", "shape_over_time", "orbit_frames", "auto_rig", "actor_import",
        "actor_sheets", "template_quality", "shoulders",
    ),
    "Several people": (
        "people_association", "people_detected", "people_joints", "people_labels", "people_prior",
        "people_real",
    ),
    "What if the input is bad?": (
        "noise_sweep", "occlusion", "calibration_sweep", "clocks", "leg_swaps", "mask_corruption",
        "trust", "trust_video", "trust_views", "trust_wrong_views", "planted_mistakes",
        "looked_joints", "late_poses",
    ),
    "What is each part worth?": (
        "term_ablation", "weight_sweep", "window_sweep", "trajectory_prior", "feet",
    ),
    "Detectors, lifters, and learning through the solver": (
        "detector_frames", "detector_photographs", "detector_noise", "lifter_motion",
        "bias_through_solver", "finetune_through_solver", "adjoint_speed",
    ),
    "The solver": ("solver_classics", "solver_speed", "bundle_adjustment"),
    "How fast, and how much memory?": (
        "long_clip", "long_surface", "image_memory", "surface_speed", "deformation_speed",
        "silhouette_speed", "report_speed", "batch", "first_capture",
    ),
    "Into other programs": ("export_check", "retarget", "robot_playback"),
    "All of them": ("all",),
}  # fmt: skip


def main(arguments: Sequence[str]) -> int:
    """Run a command; returns the exit code."""
    match list(arguments):
        case ["list", *words]:
            print("\n".join(listing(words)) or f"nothing has {' '.join(words)}")
            return 0
        case ["run", name, *options]:
            return _run(name, options)
    print(__doc__, file=sys.stderr)
    return 2


def listing(words: Sequence[str] = ()) -> Iterator[str]:
    """Groups, and a line for each of their scripts that has all of some words."""
    for group, names in groups().items():
        lines = [f"  {name:<24}{first_line(name)}" for name in names]
        chosen = [
            line for line in lines if all(w.lower() in f"{group} {line}".lower() for w in words)
        ]
        if chosen:
            yield from (f"\n{group}", *chosen)


def groups() -> dict[str, tuple[str, ...]]:
    """The groups, and what is in none of them."""
    found = {each for names in GROUPS.values() for each in names}
    guard = "\nif __name__ == "
    scripts = (p for p in sorted(FOLDER.glob("*.py")) if guard in p.read_text(encoding="utf-8"))
    more = tuple(path.stem for path in scripts if path.stem not in found)
    return {**GROUPS, **({"More": more} if more else {})}


def first_line(name: str) -> str:
    """What a script says of itself, in a line."""
    said = ast.get_docstring(ast.parse((FOLDER / f"{name}.py").read_text(encoding="utf-8")))
    return (said or "").splitlines()[0]


def _run(name: str, options: Sequence[str]) -> int:
    known = [each for names in groups().values() for each in names]
    name = name.removesuffix(".py")
    if name not in known:
        near = get_close_matches(name, known, 1)
        hint = f"did you mean {near[0]}?" if near else "python -m experiments list names them"
        print(f"experiments: {name} is none; {hint}", file=sys.stderr)
        return 2
    return subprocess.run([sys.executable, FOLDER / f"{name}.py", *options], check=False).returncode


sys.exit(main(sys.argv[1:]))
