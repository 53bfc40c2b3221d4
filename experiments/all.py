"""Every experiment, one after the other; ``--small`` runs little of each, in minutes."""

from __future__ import annotations

import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import report
from report import Report, Table

# arguments of a small run; what is not named here is no experiment of its own
SMALL: dict[str, tuple[str, ...]] = {
    "adjoint_speed": ("--windows", "1", "--repeats", "1", "--directions", "1"),
    "auto_rig": ("--people", "4", "--every", "30", "--sequences", "dev_tight"),
    "batch": ("--clips", "4"),
    "calibration_sweep": ("--seeds", "1", "--turns", "5", "--lenses", "0.1", "--shifts", "0.02"),
    "clocks": ("--views", "3", "--clips", "1", "--frames", "60"),
    "cut_scans": ("--sequences", "rendered/dev_tight", "--crown", "0.06", "--arm", "0.3"),
    "feet": (),
    "first_capture": (),
    "fast_motion": ("--clips", "2", "--views", "1", "4", "--frames", "50"),
    "angle_limits": ("--clips", "1", "--views", "4", "--sequences", "dev_dance", "--unseen", "2"),
    "hands": ("--step", "60"),
    "joint_table": ("--clips", "3", "--frames", "60"),
    "leg_swaps": ("--seeds", "1", "--frames", "40"),
    "multi_view": (),
    "noise_sweep": ("--seeds", "1", "--levels", "0", "2", "--frames", "60"),
    "occlusion": ("--seeds", "1", "--lengths", "5", "--frames", "60"),
    "bundle_adjustment": (),
    "own_skeleton": (),
    "peers": ("--sequences", "dev_views", "--alone", "dev_tight", "--no-real"),
    "people_association": ("--seeds", "2"),
    "people_joints": ("--sequences", "dev_duo", "--no-fewer"),
    "pose_refiner": ("--clips", "3", "--frames", "60"),
    "retarget": ("--frames", "20"),
    "robot_playback": ("--frames", "20"),
    "rendered_accuracy": ("--no-ablations", "--sequences", "dev_tight"),
    "shoulders": ("--frames", "200",),
    "solver_classics": (),
    "solver_speed": ("--windows", "2", "--slow", "0"),
    "trajectory_prior": ("--views", "4", "--ranks", "10", "--clips", "1", "--frames", "40"),
    "trust": (),
    "template_quality": (
        "--seeds", "1", "--frames", "6", "--smooth", "20", "--sizes", "1.1",
        "--sequences", "dev_tight",
    ),
    "two_views": ("--clips", "2", "--frames", "40", "--lasting", "12"),
    "term_ablation": ("--seeds", "1", "--frames", "60"),
    "weight_sweep": ("--seeds", "1", "--factors", "0.5", "2", "--frames", "60"),
    "window_sweep": ("--seeds", "1", "--frames", "60"),
}  # fmt: skip
LONG = (
    "adapt_head",
    "actor_import", "actor_sheets", "bias_through_solver", "body_fit", "boundary_trust",
    "contour_bodies", "contour_clocks", "contour_cues", "contours", "deformation_speed",
    "detector_frames",
    "detector_noise", "detector_photographs", "export_check", "filmed_tracks",
    "finetune_through_solver", "followed_person",
    "given_cameras",
    "hand_held", "held_out_masks", "image_memory", "joint_places",
    "joint_refinement", "late_poses", "late_views", "learned_edges", "lens",
    "looked_joints", "lifter_films", "lifter_motion",
    "lifter_real", "long_clip", "long_surface", "lost_limbs", "mask_corruption", "mask_doubt",
    "moved_cameras", "moved_masks", "orbit_frames", "paired_or_soft", "pairs_of_clips",
    "people_detected",
    "people_labels", "people_memory", "people_prior", "people_real", "people_tracker",
    "planted_mistakes", "pose_fusion", "real_body",
    "real_silhouettes", "report_speed", "segmentation_ablation", "shaken_masks",
    "shape_over_time", "sides_of_clips", "silhouette_speed", "stage_ablation", "surface_speed",
    "trust_video", "trust_views", "trust_wrong_views", "video_alone", "video_speed", "view_stages",
    "views_sweep", "way_lengths", "worst_masks",
)  # fmt: skip


# make what they need themselves
_NO_DATA = (
    "adjoint_speed", "batch", "body_fit", "bundle_adjustment", "deformation_speed",
    "first_capture", "image_memory", "joint_places", "long_clip", "own_skeleton", "paired_or_soft",
    "shape_over_time", "silhouette_speed", "solver_classics", "solver_speed",
)  # fmt: skip


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    small: bool = False
    """Little of each, and none of those that take minutes whatever is asked for."""
    only: tuple[str, ...] = ()
    """Some of them."""


def run(config: Experiment) -> Report:
    """Run scripts as a user would; a failure does not stop the others."""
    names = config.only or tuple(sorted(SMALL if config.small else {*SMALL, *LONG}))
    rows = []
    for name in names:
        start = time.monotonic()
        small = SMALL.get(name, ()) if config.small else ()
        script = Path(__file__).with_name(f"{name}.py")
        data = () if name in _NO_DATA else ("--data", str(config.data))
        command = [sys.executable, str(script), *data, *small]
        code = subprocess.run(command, check=False).returncode
        rows.append((name, "done" if code == 0 else f"failed, {code}", time.monotonic() - start))
    return Report((Table("experiments", ("script", "end", "seconds"), tuple(rows), 0),))


if __name__ == "__main__":
    report.main(run, Experiment, "all")
