"""Which file belongs to which view, or image, as far as names tell."""

from __future__ import annotations

import re
from collections.abc import Sequence


def find_view(name: str, views: Sequence[str]) -> int | None:
    """Which view a file is named after, or None when its name does not tell.

    The same name, or the only one of which it is a part or that is a part of it, counted in whole
    words and numbers: ``cam01`` and ``Cam_1`` belong to ``int_cam01_img``, ``cam10`` does not.
    """
    if name in views:
        return list(views).index(name)
    matches = [i for i, view in enumerate(views) if _within(name, view) or _within(view, name)]
    return matches[0] if len(matches) == 1 else None


def match_views(names: Sequence[str], views: Sequence[str]) -> list[int] | None:
    """The view of each of several files, all different, or None when the names do not tell.

    Where ``find_view`` does not know, words that all names share are left out: ``cam01_json``,
    ``cam02_json`` belong to ``int_cam01_img``, ``int_cam02_img``.
    """
    found = [find_view(name, views) for name in names]
    if None in found:
        own = _distinctive(views)
        found = [own.index(words) if words in own else None for words in _distinctive(names)]
    known = [view for view in found if view is not None]
    return known if len(known) == len(names) == len(set(known)) else None


def rows_of(names: Sequence[str], images: Sequence[str]) -> list[int]:
    """The frame of each of some names, where all of them are those of images; else none."""
    places = {name: frame for frame, name in enumerate(images)}
    return [places[name] for name in names] if places.keys() >= set(names) else []


def _within(part: str, whole: str) -> bool:
    words, text = _words(part), _words(whole)
    starts = range(len(text) - len(words) + 1)
    return bool(words) and any(text[i : i + len(words)] == words for i in starts)


def _distinctive(names: Sequence[str]) -> list[list[str]]:
    """Words of each name that not all names have; none where this leaves a name empty."""
    words = [_words(name) for name in names]
    shared = set.intersection(*map(set, words)) if len(words) > 1 else set()
    left = [[word for word in name if word not in shared] for name in words]
    return left if all(left) else [[] for _ in names]


def _words(name: str) -> list[str]:
    return [word.lstrip("0") or "0" for word in re.findall(r"[a-z]+|[0-9]+", name.lower())]
