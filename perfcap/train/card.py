"""The card of a trained network: what it is, what it learned from, how good it is."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

from perfcap.io.atomic import writing
from perfcap.io.doctor.finding import counted
from perfcap.train.config import TrainDetectorConfig, TrainHeadConfig, TrainLifterConfig

FILE = "card.md"
_WIDTH = 100  # characters of a line


def last_part(path: Path | str) -> str:
    """What a file or folder is called, without the folders of this machine that it lies in."""
    path = Path(path)
    name = path.resolve().name if path.name in ("", "..") else path.name
    return _printable(name)


def _printable(text: str) -> str:
    """A text in one line, which can be encoded."""
    return "".join(letter if letter.isprintable() else " " for letter in text)


def weights_said(path: Path) -> str:
    """That a checkpoint's weights went in, and with them what those had learned from."""
    return f"the weights of {last_part(path)}, with what went into them"


def origin_of(run: str, sources: Sequence[str]) -> str:
    """The origin of weights for a manifest: the run, and all that went in."""
    return "; ".join((run, *sources))


def frames_said(looked_at: int, frames: int) -> str:
    """How many frames were looked at, and of how many where some were left out."""
    return counted(frames) if looked_at == frames else f"{looked_at} of {counted(frames)}"


def _went_in(sources: Sequence[str], licence: str) -> str:
    """Entries of a list: all that went in, and the licence."""
    shown = _printable(licence)
    lines = (
        f"- Went in: {'; '.join(sources)}.",
        f"- Licence of the weights: {shown}; it follows from those of all that went in.",
    )
    return "\n".join(
        textwrap.fill(
            line,
            _WIDTH,
            subsequent_indent="  ",
            break_long_words=False,
            break_on_hyphens=False,
        )
        for line in lines
    )


def write_lifter_card(
    folder: Path,
    config: TrainLifterConfig,
    learned: Sequence[str],
    sources: Sequence[str],
    licence: str,
    scores: Mapping[str, Mapping[str, float]],
    members: int = 1,
) -> None:
    """Write ``card.md``.

    Args:
        folder: of the model.
        config: it was trained with.
        learned: people it was trained on.
        sources: all that went in, a phrase each.
        licence: of the weights.
        scores: of each person that it was not trained on.
        members: networks whose answers are averaged; the last ones are of other runs.
    """
    others = f", averaged with {members - 1} of other runs" if members > 1 else ""
    rows = "\n".join(
        f"| {person} | {' | '.join(f'{value:.1f}' for value in values.values())} |"
        for person, values in scores.items()
    )
    names = list(next(iter(scores.values()))) if scores else []
    text = f"""# A lifter

2D joint tracks of one person to 3D poses: 16 landmarks, metres, relative to the middle of the hips,
in the axes of the camera, with the error expected of each joint.

- Input: `lifting_features` of a track, (N, F, 49) float32, at about 30 frames a second.
- Output: `joints` (N, F, 16, 3) and `spread` (N, F, 16), metres.
- Network: {len(config.lifter.dilations)} residual blocks of {config.lifter.channels}
  channels{others}; an answer depends on {config.lifter.reach} frames either side.
- Learned from: recorded motion of {len(learned)} people ({", ".join(learned)}) under random cameras
  with simulated detections, {config.loop.steps} steps of {config.loop.batch}.
{_went_in(sources, licence)}
- Best weights chosen by: {", ".join(config.validation)}.

## Errors on people it has not learned from, with simulated detections

| person | {" | ".join(names)} |
|---|{"---|" * len(names)}
{rows}

## Where it fails

Poses that the motion does not hold, lying and crawling above all; heavy occlusion for longer than
a second; people of other proportions than adults; cameras from steeply above. A single view does
not tell size: poses are those of somebody of average height.
"""
    with writing(folder / FILE) as file:
        file.write(text.encode())


# --- The card of a trained detector: what it is, what it learned from, how good it is -------------


def write_detector_card(
    folder: Path,
    config: TrainDetectorConfig,
    learned: Sequence[str],
    sources: Sequence[str],
    licence: str,
    scores: Mapping[str, float],
    crops: tuple[int, int],
) -> None:
    """Write ``card.md``.

    Args:
        folder: of the model.
        config: it was trained with.
        learned: people whose motion it was shown.
        sources: all that went in, a phrase each.
        licence: of the weights.
        scores: on crops of people whose motion it was not shown.
        crops: that were rendered to learn from, and to score: more than were asked for where
            these fill no whole parts.
    """
    rows = "\n".join(f"| {name} | {value:.3g} |" for name, value in scores.items())
    size, widths = config.detector.size, ", ".join(map(str, config.detector.widths))
    text = f"""# A detector

The crop of a person to 16 landmarks, toes included: heat maps, and maps of root-relative 3D
positions in metres.

- Input: `crops` (N, 3, {size}, {size}) float32, RGB, 0 to 255.
- Output: `heat`, `x`, `y`, `z`, each (N, 16, {size // 4}, {size // 4}); a heat map sums to one.
- Network: residual, {widths} channels at a 4th, 8th, 16th and 32nd of the resolution.
- Learned from: {crops[0]} rendered crops of random bodies and clothes, moving as
  {len(learned)} recorded people ({", ".join(learned)}); {config.loop.steps} steps of
  {config.loop.batch}.
{_went_in(sources, licence)}
- Best weights chosen on the motion of {", ".join(config.validation)}, not shown otherwise.

## Scores on {crops[1]} rendered crops with the motion of {", ".join(config.validation)}

| | |
|---|---|
{rows}

## Where it fails

Real photographs, unless they were learned from; poses that the motion does not hold; several people
in one crop; people of whom half is hidden or outside of the image. Left and right are confused most
where a person is seen from the side. 3D positions are those of somebody of average height.
"""
    with writing(folder / FILE) as file:
        file.write(text.encode())


# --- The card of an adapted network: what it was, what it learned from, what it gives -------------


def write_head_card(
    folder: Path,
    network: str,
    config: TrainHeadConfig,
    frames: tuple[int, int],
    scores: Mapping[str, float],
    steps: int | None,
) -> None:
    """Write ``card.md``.

    Args:
        folder: of the model.
        network: what was adapted.
        config: the head was trained with.
        frames: of the footage that were looked at, those held out included, and all of them.
        scores: on frames of the footage that it has not learned from.
        steps: of training through the solver that the weights are from: 0 where that was no
            better and they are those learned directly, None where there was none.
    """
    rows = "\n".join(f"| {name} | {value:.3g} |" for name, value in scores.items())
    text = f"""# {network}, adapted to one person's footage

The network as it was, with a linear map of its last features added to its 2D and 3D joints.

- Learned from: {frames_said(*frames)} of calibrated views of one person, without labels. The joints
  are those of a capture of all views together; each view learns to say them alone,
  {_way(steps)}.
- Chosen by the last {100 * config.held_out:.0f} % of these frames, held out at first; then learned
  again from all, as was best for them.
- Input, output, joints and licence: as those of {network}.

## Scores on these last frames

Of heads that had not learned from them.

Distances after the best similarity, from the capture of all views: nobody has measured the truth.
`held_out` is how far views that are solved alone disagree with detections of the others, 0 to 1.
`view left out` is the mean over views that a head has not learned from, each in turn; `expected` is
the root mean square of that and of the head's own error, and `output.error3d` of the manifest.

| | |
|---|---|
{rows}

## Where it fails

Other people, rooms, cameras and kinds of motion than those of the footage: there the network as
shipped is the better choice. Where all views together are wrong, it learns the mistake.
"""
    with writing(folder / FILE) as file:
        file.write(text.encode())


def _way(steps: int | None) -> str:
    """How the weights were learned, in words."""
    if steps is None:
        return "directly alone, not through the solver"
    if not steps:
        return (
            "directly alone: training through the solver as well made views that are\n  solved "
            "alone agree no better with the others, and its weights were dropped"
        )
    return (
        f"at first directly,\n  then through the solver in {steps} steps, by whether views that "
        "are solved alone agree\n  with the others"
    )
