"""The parts of the page that are text: they read the same without a script."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from perfcap.io.result import Result
from perfcap.io.result_folder import own_file
from perfcap.report.marks import Mark
from perfcap.report.markup import Content, Markup, element, join

_STAGES = {
    "initialize": "Each frame on its own",
    "solve_bone_lengths": "Bone lengths",
    "track_motion": "Motion over windows",
    "extract_silhouettes": "Masks",
    "refine_pose": "Motion on the masks",
    "extract_silhouettes_again": "Masks again",
    "refine_surface": "Surface on the masks",
    "extract_silhouettes_3": "Masks where people meet",
    "refine_surface_2": "Surface on these masks",
    "extract_silhouettes_4": "Masks where people meet again",
    "follow_frames": "Frame by frame",
}
_FILES = {
    "capture.glb": "textured character with its animation: Blender, game engines, browsers",
    "motion.bvh": "animation of the bones",
    "motion.npz": "joints, root and angles, arrays",
    "scene.glb": "everybody with their animations: Blender, game engines, browsers",
    "people.json": "who is who, and how surely",
    "surface.npz": "vertices of every frame, arrays",
    "overlay.mp4": "input with outline and skeleton",
    "textured.mp4": "input with the textured character",
    "detections.npz": "detected joints",
    "metrics.json": "errors against a truth",
    "run.json": "what happened, numbers of every frame",
    "config.yaml": "settings",
}
_METRICS = {
    "pa_mpjpe_mm": ("Joints, similarity-aligned", "mm"),
    "mpjpe_root_mm": ("Joints, roots aligned", "mm"),
    "mpjpe_transl_mm": ("Joints, translation-aligned", "mm"),
    "mpjpe_first_frame_mm": ("Joints, first frame's offset removed", "mm"),
    "mpjpe_mm": ("Joints, absolute", "mm"),
    "pck3d_150": ("3DPCK at 150 mm", "%"),
    "auc3d": ("3DPCK, area under curve", "%"),
    "reproj_px": ("Joints in the image", "px"),
    "accel_err_mm_per_frame2": ("Acceleration error", "mm/frame²"),
    "jitter_jerk_m_s3": ("Jerk", "m/s³"),
    "jitter_jerk_gt_m_s3": ("Jerk of the truth", "m/s³"),
    "surface_transl_mm": ("Surface, translation-aligned", "mm"),
    "silhouette_iou": ("Outline of the surface, overlap", "%"),
    "segmentation_iou": ("Masks, overlap", "%"),
}
_CONFIG_LIMIT = 200_000  # characters
_ROWS = 400
_SHARE = element("span", "Share of the longest", class_="hidden")


def summary(result: Result, rows: slice) -> Markup:
    """One line of facts about the capture."""
    frames, views = rows.stop - rows.start, result.report.get("views")
    facts = [
        ("frames", f"{frames} of {result.frames}" if frames < result.frames else f"{frames}"),
        ("length", f"{frames / result.rate:.2f} s at {result.rate:g} fps"),
        ("views", str(len(views)) if isinstance(views, list) else "unknown"),
        ("actor", _actor(result)),
    ]
    items = [element("div", element("dt", name), element("dd", value)) for name, value in facts]
    return element("dl", items, class_="facts")


def status(result: Result) -> Markup:
    """Whether everything was captured, in words and in colour."""
    if result.report.get("complete") is True:
        return element("span", "complete", class_="badge good")
    return element("span", "with gaps", class_="badge bad")


def warnings(result: Result, marks: Sequence[Mark], notes: Sequence[str]) -> Markup:
    """What the capture warned of, frames to look at, and what this page had to leave out."""
    told = [*_texts(result.report.get("input_warnings")), *_texts(result.report.get("warnings"))]
    items = [element("li", _sentence(text)) for text in told[:_ROWS]]
    items += [
        element("li", _jump(m.start, _span(m)), " ", m.text, class_=f"mark-{m.kind}") for m in marks
    ]
    listed = element("ul", items, class_="warnings") if items else None
    quiet = (
        None if items else element("p", "None: the person was detected and every frame was solved.")
    )
    about = element("ul", [element("li", note) for note in notes], class_="notes")
    missing = (element("h3", "Not in this report"), about) if notes else None
    return join([listed, quiet, missing])


def metrics_table(metrics: Mapping[str, Any]) -> Markup | None:
    """Errors that ``perfcap evaluate`` found, and what it said of the truth."""
    rows = [
        element(
            "tr", element("th", title, scope="row"), element("td", f"{metrics[key]:.1f} {unit}")
        )
        for key, (title, unit) in _METRICS.items()
        if isinstance(metrics.get(key), int | float)
    ]
    if not rows:
        return None
    notes = [element("li", _sentence(text)) for text in _texts(metrics.get("notes"))[:_ROWS]]
    table = element("table", element("tbody", rows), class_="numbers")
    return join([table, element("ul", notes, class_="warnings") if notes else None])


def stages(report: Mapping[str, Any]) -> Markup:
    """Seconds of each stage, with bars."""
    listed = report.get("stages")
    known = (
        {n: v for n, v in listed.items() if isinstance(v, dict)} if isinstance(listed, dict) else {}
    )
    if not known:
        return element("p", "The capture did not record its times.")
    longest = max(_seconds(v, "wall_s") for v in known.values()) or 1.0
    head = element(
        "tr",
        [element("th", text, scope="col") for text in ("Stage", "Time", _SHARE, "Processor")],
    )
    body = [
        element(
            "tr",
            element("th", _STAGES.get(name, name), scope="row"),
            element("td", f"{_seconds(each, 'wall_s'):.1f} s"),
            element("td", _bar(_seconds(each, "wall_s") / longest), class_="bar"),
            element("td", f"{_seconds(each, 'cpu_s'):.1f} s"),
        )
        for name, each in known.items()
    ]
    table = element("table", element("thead", head), element("tbody", body), class_="numbers")
    return join([table, _totals(report)])


def window_table(report: Mapping[str, Any]) -> Markup | None:
    """How the solve of each window ended."""
    listed = report.get("windows")
    rows = (
        [_window(w) for w in listed[:_ROWS] if isinstance(w, dict)]
        if isinstance(listed, list)
        else []
    )
    rows = [row for row in rows if row]
    if not rows:
        return None
    names = ("Frames", "Ended", "Steps", "Energy")
    head = element("tr", [element("th", name, scope="col") for name in names])
    return element("table", element("thead", head), element("tbody", rows), class_="numbers")


def configuration(result: Result) -> Markup:
    """The call, versions, and all settings."""
    request = result.report.get("request")
    call = request if isinstance(request, dict) else {}
    packages = result.report.get("packages")
    versions = {
        "perfcap": result.report.get("perfcap"),
        "Python": result.report.get("python"),
        "system": result.report.get("platform"),
        **(packages if isinstance(packages, dict) else {}),
    }
    return join(
        [
            _folded("Call", _pairs({k: v for k, v in call.items() if v not in (None, [], False)})),
            _folded("Versions", _pairs({k: v for k, v in versions.items() if v is not None})),
            _folded("Settings", element("pre", _settings(result.folder), tabindex=0)),
        ]
    )


def files(folder: Path) -> Markup:
    """Links to the files beside the page."""
    there = [(name, text) for name, text in _FILES.items() if own_file(folder, name) is not None]
    rows = [
        element(
            "li",
            element("a", name, href=quote(name), download=name),
            element("span", _size(folder / name), class_="size"),
            element("span", text, class_="what"),
        )
        for name, text in there
    ]
    if (folder / "masks").is_dir():
        rows.append(
            element(
                "li",
                element("a", "masks/", href="masks/"),
                element("span", "", class_="size"),
                element("span", "a PNG for every frame", class_="what"),
            )
        )
    return element("ul", rows, class_="files")


def _actor(result: Result) -> str:
    request = result.report.get("request")
    named = request.get("actor") if isinstance(request, dict) else None
    return Path(named).stem if isinstance(named, str) and named else result.template.name


def _window(window: Any) -> Markup | None:
    """Row of a table; None for what does not say which frames it is about."""
    span = window.get("frames") if isinstance(window, dict) else None
    if not isinstance(span, list) or len(span) != 2 or not all(isinstance(x, int) for x in span):
        return None
    energy = window.get("energy")
    total = f"{energy:.0f}" if isinstance(energy, int | float) else "unknown"
    status, steps = (str(window.get(name, "unknown")) for name in ("status", "steps"))
    link = element("td", _jump(span[0], f"{span[0]} to {span[1] - 1}"))
    cells = [element("td", text) for text in (status.replace("_", " "), steps, total)]
    return element("tr", link, cells)


def _jump(frame: int, text: str) -> Markup:
    """A button that shows a frame of the video."""
    return element("button", text, type="button", class_="jump", data_frame=frame)


def _span(mark: Mark) -> str:
    last = mark.stop - 1
    return f"frame {mark.start}" if last == mark.start else f"frames {mark.start} to {last}"


def _totals(report: Mapping[str, Any]) -> Markup | None:
    parts = []
    if isinstance(report.get("wall_s"), int | float):
        parts.append(f"{report['wall_s']:.1f} s in all, with reading and writing")
    if isinstance(report.get("peak_memory_mib"), int | float):
        parts.append(f"{report['peak_memory_mib']:.0f} MiB of memory at most")
    return element("p", "; ".join(parts) + ".", class_="hint") if parts else None


def _bar(share: float) -> Markup:
    rect = element("rect", width=f"{100 * min(max(share, 0.0), 1.0):.1f}%", height="100%", rx=2)
    return element("svg", rect, aria_hidden="true", focusable="false")


def _seconds(stage: Mapping[str, Any], key: str) -> float:
    value = stage.get(key)
    good = isinstance(value, int | float) and math.isfinite(value)
    return float(value) if good and value is not None else 0.0


def _pairs(values: Mapping[str, Any]) -> Markup:
    rows = [
        element("div", element("dt", name), element("dd", list(_shown(value))))
        for name, value in values.items()
    ]
    return element("dl", rows, class_="pairs")


def _shown(value: Any) -> Iterator[Content]:
    parts = value if isinstance(value, list) else [value]
    for number, part in enumerate(parts):
        if number:
            yield element("br")
        yield str(part)


def _folded(title: str, content: Markup) -> Markup:
    return element("details", element("summary", title), content)


def _settings(folder: Path) -> str:
    path = own_file(folder, "config.yaml")
    if path is None:
        return "config.yaml is missing"
    try:
        with path.open(encoding="utf-8") as file:
            return file.read(_CONFIG_LIMIT)
    except (OSError, UnicodeDecodeError):
        return "config.yaml cannot be read"


def _size(path: Path) -> str:
    size = path.stat().st_size
    return f"{size / 1e6:.1f} MB" if size >= 1e5 else f"{max(1, round(size / 1e3))} kB"


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def _texts(value: Any) -> list[str]:
    return [str(each) for each in value] if isinstance(value, list) else []
