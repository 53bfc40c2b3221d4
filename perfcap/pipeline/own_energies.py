"""Energies of an author's own: their names, and whether they say the same in every window."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import combinations

import torch

from perfcap.actor.motion import Motion
from perfcap.errors import InputError
from perfcap.pipeline.clip_problem import CONTACT, OPTIONAL, TERMS, Term
from perfcap.solve import Objective
from perfcap.solve.energy import Energy, WindowEnergy
from perfcap.temporal.window import Window

_ROUNDING = 1e-4  # of the largest energy of a frame: single precision adds rows in any order


def own_terms(energies: Mapping[str, Term] | None) -> dict[str, Term]:
    """An author's energies, if their names are free.

    Raises:
        InputError: a name is taken, or what it names cannot be called.
    """
    if energies is not None and not isinstance(energies, Mapping):
        raise InputError(
            f"energies are a {type(energies).__name__}, expected a mapping of names to functions "
            "of (actor, where)"
        )
    own = dict(energies or {})
    for name, term in own.items():
        if not isinstance(name, str):
            raise InputError(f"energies: {name!r} cannot name an energy; expected a plain word")
        if name in TERMS + CONTACT + OPTIONAL:
            taken = ", ".join(TERMS + CONTACT + OPTIONAL)
            raise InputError(f"energies: {name!r} is one of {taken}; give yours another name")
        if isinstance(term, Energy) or not callable(term):
            raise InputError(
                f"energies: {name!r} is a {type(term).__name__}; expected a function of (actor, "
                "where) that makes the energy of the frames where.frames, such as its class"
            )
    return own


@contextmanager
def saying_which_frames(
    names: Iterable[str], group: Sequence[tuple[int, Window]]
) -> Iterator[None]:
    """Errors of torch in energies of one's own say which frames they were called for."""
    try:
        yield
    except RuntimeError as error:
        own = ", ".join(names)
        if own:
            spans = ", ".join(f"{window.start} to {window.stop - 1}" for _, window in group)
            error.add_note(
                f"energies of your own ({own}) are of the frames {spans} here: take what they "
                "hold at where.frames"
            )
        raise


def warn_of_windows(
    names: Iterable[str],
    objective: Objective,
    start: Motion,
    group: Sequence[tuple[int, Window]],
) -> None:
    """Warn of energies that say something else of a frame and its pose in each of its windows.

    A row depends on its own frame alone, so that only what an energy holds can differ: targets
    that are taken from the first frame on in every window, mostly.

    Args:
        names: of an author's own energies.
        objective: of the windows.
        start: motion (N, W) in which a frame has the same pose in all windows that hold it.
        group: the windows, each with the number of its clip.
    """
    energies = dict(objective.items())
    own = {name: energies[name] for name in names if not isinstance(energies[name], WindowEnergy)}
    pairs = [
        (first, second, window, other)
        for (first, (clip, window)), (second, (its, other)) in combinations(enumerate(group), 2)
        if clip == its and window.start <= other.start < window.stop
    ]
    if not own or not pairs:
        return
    for name, energy in own.items():
        with torch.no_grad():
            shares = energy.per_frame(start)
        for first, second, window, other in pairs:
            here = shares[first, other.start - window.start :]
            there = shares[second, : len(here)]
            apart = (here - there).abs() > _ROUNDING * shares.abs().amax()
            if bool(apart.any()):
                frame = int(apart.nonzero()[0])
                warnings.warn(
                    f"energy {name!r} of frame {other.start + frame} is {float(here[frame]):.4g} "
                    f"in the window from frame {window.start} and {float(there[frame]):.4g} in "
                    f"that from {other.start}, of the same pose; take what it holds of a frame, "
                    "as targets, at where.frames, and not from the first one on",
                    stacklevel=2,
                )
                break
