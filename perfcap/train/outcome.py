"""What came of a training: whether anything was learned, and more than was known before."""

from __future__ import annotations

from collections.abc import Iterator, Mapping


def outcome_doubts(
    scores: Mapping[str, float], guess: Mapping[str, float], start: Mapping[str, float] | None
) -> Iterator[str]:
    """What scores on people who were not learned from say against using a network.

    Args:
        scores: of it; the first is the one to make small.
        guess: of answering everything with the mean.
        start: of the network that it began as; None of one that began at random.
    """
    name, score = next(iter(scores.items()))
    if not score < guess[name]:
        yield (
            f"the trained network is no better than the mean of all answers ({name} {score:.3g} "
            f"and {guess[name]:.3g} on people it has not learned from): it has learned nothing; "
            "train longer, or with a lower learning rate (metrics.jsonl has the losses), and look "
            "at what it learns from"
        )
    elif start is not None and not score < start[name]:
        yield (
            f"the trained network is no better than the one it started from ({name} {score:.3g} "
            f"and {start[name]:.3g} on people it has not learned from); keep that one, or train "
            "with a lower learning rate, longer, or from more"
        )
