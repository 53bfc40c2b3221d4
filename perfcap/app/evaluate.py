"""``perfcap evaluate``: a result against its truth."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.table import Table

from perfcap.app.capture_folder import named_people, spare_result
from perfcap.app.console import PlainConsole, print_written
from perfcap.app.expected_doubts import expected_doubts, surface_doubt
from perfcap.app.left_out import left_out
from perfcap.app.lying import OF_THE_FLOOR, lying_doubt
from perfcap.app.scores import joint_scores, joint_tables, surface_scores
from perfcap.app.silhouettes import compare_silhouettes
from perfcap.app.truth import (
    Truth,
    find_truth,
    rate_doubts,
    read_found,
    read_truth,
)
from perfcap.app.truth_doubts import image_doubts, joint_doubts
from perfcap.app.truth_people import match_truths, read_truths
from perfcap.commands.results import Evaluate
from perfcap.errors import InputError
from perfcap.io.atomic import writing
from perfcap.io.result import identity_of, require_one_capture, retargeted_from
from perfcap.io.result_folder import METRICS, MOTION, PAGE, is_several, own_file
from perfcap.io.surface_file import open_surface

_ROWS = (
    ("frames_scored", "frames with truth", ""),
    ("pa_mpjpe_mm", "joints, similarity-aligned", "mm"),
    ("mpjpe_root_mm", "joints, root-aligned", "mm"),
    ("mpjpe_transl_mm", "joints, translation-aligned", "mm"),
    ("mpjpe_first_frame_mm", "joints, first frame's offset removed", "mm"),
    ("mpjpe_mm", "joints, absolute", "mm"),
    ("pck3d_150", "3DPCK at 150 mm", "%"),
    ("auc3d", "3DPCK area under curve", "%"),
    ("reproj_px", "joints in the image", "px"),
    ("accel_err_mm_per_frame2", "acceleration error", "mm/frame²"),
    ("jitter_jerk_m_s3", "jerk", "m/s³"),
    ("jitter_jerk_gt_m_s3", "jerk of the truth", "m/s³"),
    ("bone_length_std_mm", "bone lengths over time, deviation", "mm"),
    ("foot_skate_mm", "sliding of standing feet", "mm/frame"),
    ("penetration_mm", "feet below the floor", "mm"),
    ("surface_transl_mm", "surface, translation-aligned", "mm"),
    ("vertex_transl_mm", "vertices, translation-aligned", "mm"),
    ("surface_transl_garment_mm", "surface, loose cloth alone", "mm"),
    ("vertex_transl_garment_mm", "vertices, loose cloth alone", "mm"),
    ("vertex_abs_mm", "vertices, absolute", "mm"),
    ("surface_abs_mm", "surface, absolute", "mm"),
    ("silhouette_iou", "outline of the surface, overlap", "%"),
    ("segmentation_iou", "masks, overlap", "%"),
    ("segmentation_precision", "masks, precision", "%"),
    ("segmentation_recall", "masks, recall", "%"),
    ("segmentation_boundary_f", "masks, F measure of the outline", "%"),
)


def run_evaluate(request: Evaluate) -> int:
    """Print the table and write metrics.json; returns the exit code.

    Raises:
        InputError: a file is missing or holds something else.
    """
    if request.every < 1:
        raise InputError(f"--every is {request.every}, expected 1 or more")
    if request.out is not None:
        if request.out.suffix.lower() != ".json":
            raise InputError(f"--out {request.out}: expected the name of a file that ends in .json")
        spare_result(request.folder, request.out, METRICS)
    if is_several(request.folder):
        return _evaluate_people(request)
    truth = read_truth(request.truth, request.dataset, request.sequence)
    metrics = compare(request.folder, truth, request.every)
    _write_out(request, metrics)
    _show(metrics)
    _tell_of_page(request.folder, request.out)
    return 0


def _evaluate_people(request: Evaluate) -> int:
    """Everybody against the truth whose joints are nearest; all together in the folder's file."""
    folders = [place for place, _ in named_people(request.folder)]
    known = read_truths(request.truth, request.dataset, request.sequence)
    truths = match_truths(folders, known)
    together: dict[str, Any] = {}
    for folder, truth in zip(folders, truths, strict=True):
        metrics = compare(folder, truth, request.every) | {"truth": _name(truth)}
        _write(folder / METRICS, metrics)
        PlainConsole().print(f"\n{folder.name}: {_name(truth)}")
        _show(metrics)
        _tell_of_page(folder, None)
        together[folder.name] = metrics
    errors = [each["mpjpe_mm"] for each in together.values() if "mpjpe_mm" in each]
    if errors:
        together["mpjpe_mm"] = sum(errors) / len(errors)
        PlainConsole().print(f"everybody: joints, absolute, {together['mpjpe_mm']:.1f} mm")
    missed = [_name(true) for true in known if not any(true is each for each in truths)]
    if missed:
        note = (
            f"{request.truth}: {', '.join(missed)} of the truth belong to none of the "
            f"{len(folders)} people of {request.folder}, and count nowhere"
        )
        together["notes"] = [note]
        PlainConsole().print(note, style="yellow", soft_wrap=True)
    _write_out(request, together)
    return 0


def _tell_of_page(folder: Path, out: Path | None) -> None:
    """A page shows the errors that were there when it was made."""
    page = own_file(folder, PAGE)
    if out is None and page is not None:
        PlainConsole().print(
            f"{page} does not show these errors yet: perfcap report {folder} writes it anew",
            soft_wrap=True,
        )


def _name(truth: Truth) -> str:
    """Of a person of a data set, or of the folder that holds a file of their own."""
    sequence = truth.sequence
    return sequence.folder.parent.name if sequence.dataset == "file" else sequence.name


def _write_out(request: Evaluate, metrics: Mapping[str, Any]) -> None:
    """Write the file, and name it where the user says where it goes."""
    if request.out is None:
        _write(request.folder / METRICS, metrics)
        return
    older = request.out.exists()
    _write(request.out, metrics)
    print_written(request.out, older)


def _write(path: Path, metrics: Mapping[str, Any]) -> None:
    with writing(path) as file:
        file.write((json.dumps(metrics, indent=1) + "\n").encode())


def _show(metrics: Mapping[str, Any]) -> None:
    console = PlainConsole()
    console.print(error_table(metrics))
    for note in metrics["notes"]:
        console.print(note, style="yellow", soft_wrap=True)


def compare(folder: Path, truth: Truth, every: int = 1) -> dict[str, Any]:
    """All that the result and the truth have in common, by the names of the scorer.

    Beside the numbers: which truth it was, remarks, errors of each landmark, and of how many frames
    a mean is where these are fewer than were scored.

    Raises:
        InputError: a file is missing or holds something else, or nothing can be compared.
    """
    require_one_capture(folder)
    found = read_found(folder / MOTION)
    scores = joint_scores(found, truth)
    doubts = [*rate_doubts(found, truth), *joint_doubts(found, truth), *image_doubts(found, truth)]
    notes = [*truth.sequence.warnings, *doubts, *expected_doubts(folder, found, truth, doubts)]
    lies = lying_doubt(found, truth)
    if lies is not None:
        scores = {name: value for name, value in scores.items() if name not in OF_THE_FLOOR}
        notes.append(lies)
    source = retargeted_from(folder)
    if source is not None:
        captured = (Path(source) / MOTION).is_file()  # else a file of motion
        notes.append(
            f"{folder}: is the motion of {source} on another actor, whose bones add to all errors"
            + (f"; evaluate {source} for those of the capture" if captured else "")
        )
    surface = None
    if (folder / "surface.npz").is_file():
        surface = open_surface(folder / "surface.npz")
        errors, remarks = surface_scores(surface, truth, every)
        scores |= errors
        notes += remarks or ([] if doubts else surface_doubt(folder, scores))
    overlaps, remarks = compare_silhouettes(folder / "masks", surface, truth, every)
    scores |= overlaps
    notes += remarks
    notes += left_out(scores, found, truth, every)
    if not scores:
        raise InputError(
            f"{truth.sequence.folder}: has no truth that {folder} could be compared with; "
            f"{'; '.join(notes) or 'expected joints, surfaces or silhouettes'}"
        )
    sequence = truth.sequence
    about = {"dataset": sequence.dataset, "sequence": sequence.name, "action": sequence.action}
    tables, fewer = joint_tables(found, truth)
    capture = identity_of(folder)
    return {
        **scores,
        **about,
        **({} if capture is None else {"capture": capture}),
        "notes": notes,
        "per_joint_mm": tables,
        **({"per_joint_frames": fewer} if fewer else {}),
    }


def evaluate(result: Path, truth: Path) -> dict[str, float]:
    """Errors of the joints of a file, by the names of the scorer, for the frames it has."""
    return joint_scores(read_found(result), read_truth(find_truth(truth)))


def error_table(metrics: Mapping[str, Any]) -> Table:
    """The metrics for a terminal, as many as there are."""
    table = Table("error", "value", "unit")
    for key, title, unit in _ROWS:
        if key in metrics:
            digits = 0 if not unit else 1
            table.add_row(title, f"{metrics[key]:.{digits}f}", unit)
    return table
