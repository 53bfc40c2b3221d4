"""The card of a trained detector: what it is, what it learned from, how good it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from perfcap.io.atomic import writing
from perfcap.train.card import FILE
from perfcap.train.detector_config import TrainDetectorConfig


def write_detector_card(
    folder: Path,
    config: TrainDetectorConfig,
    learned: Sequence[str],
    scores: Mapping[str, float],
) -> None:
    """Write ``card.md``.

    Args:
        folder: of the model.
        config: it was trained with.
        learned: people whose motion it was shown.
        scores: on crops of people whose motion it was not shown.
    """
    rows = "\n".join(f"| {name} | {value:.3g} |" for name, value in scores.items())
    size, widths = config.detector.size, ", ".join(map(str, config.detector.widths))
    text = f"""# A detector

The crop of a person to 16 landmarks, toes included: heat maps, and maps of root-relative 3D
positions in metres.

- Input: `crops` (N, 3, {size}, {size}) float32, RGB, 0 to 255.
- Output: `heat`, `x`, `y`, `z`, each (N, 16, {size // 4}, {size // 4}); a heat map sums to one.
- Network: residual, {widths} channels at a 4th, 8th, 16th and 32nd of the resolution.
- Learned from: {config.crops} rendered crops of random bodies and clothes, moving as
  {len(learned)} recorded people ({", ".join(learned)}); {config.loop.steps} steps of
  {config.loop.batch}.
- Best weights chosen on the motion of {", ".join(config.validation)}, not shown otherwise.

## Scores on rendered crops with the motion of {", ".join(config.validation)}

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
