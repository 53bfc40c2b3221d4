"""Lenses and image sizes under the names that programs and their users give them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from perfcap.errors import InputError

# as ``_plain`` leaves them
_LENS = frozenset({"distortion", "distortions", "distortioncoefficients", "distortioncoeffs",
                   "dist", "distcoef", "distcoefs", "distcoeff", "distcoeffs"})  # fmt: skip
_COEFFICIENTS = frozenset({"d", "k1", "k2", "k3", "p1", "p2"})
_FISHEYE = frozenset({"fisheye", "isfisheye"})
_MODELS = frozenset({"model", "cameramodel", "cameratype", "type", "lens", "lensmodel", "lenstype",
                     "projection", "distortionmodel", "distortiontype"})  # fmt: skip
_OTHER_MODELS = ("fish", "equidist", "equisolid", "kannala", "omnidir")
_NO = ("false", "no", "0", "")
_SIZES = frozenset({"size", "resolution", "imagesize", "imgsize", "imageresolution"})
_HEIGHTS, _WIDTHS = (
    frozenset({name, f"image{name}", f"img{name}"}) for name in ("height", "width")
)


def lens_of(where: str, stated: Mapping[str, Any]) -> Any:
    """Coefficients of OpenCV's model among what a file says of a camera; None where none are.

    Raises:
        InputError: a lens of another model, coefficients stated twice, or under a name that is
            not read.
    """
    _require_pinhole(where, stated)
    given = [key for key in stated if _plain(key) in _LENS]
    for key in stated:
        if key not in given and _of_lens(key):
            raise InputError(
                f"{where}: has {key!r:.40}, which is not read; call the coefficients distortion: "
                "k1, k2, p1, p2, k3"
            )
    if len(given) > 1:
        raise InputError(f"{where}: has {' and '.join(given)}; expected one of them, distortion")
    return stated[given[0]] if given else None


def size_of(stated: Mapping[str, Any]) -> tuple[Any, Any]:
    """Image height and width, which may be one list of width and height; None where not stated."""
    plain = {_plain(key): value for key, value in stated.items()}
    height, width = (
        next((plain[name] for name in names if name in plain), None)
        for names in (_HEIGHTS, _WIDTHS)
    )
    if height is not None and width is not None:
        return height, width
    for value in (plain[name] for name in _SIZES if name in plain):
        if isinstance(value, list) and len(value) == 2:
            return value[1], value[0]
    return height, width


def _require_pinhole(where: str, stated: Mapping[str, Any]) -> None:
    for key, value in stated.items():
        said = str(value).lower()
        other = _plain(key) in _FISHEYE and bool(value) and said not in _NO
        if _plain(key) in _MODELS and isinstance(value, str):
            other = any(word in said for word in _OTHER_MODELS)
        if other:
            raise InputError(
                f"{where}: {key} = {said:.40}; expected a pinhole camera with OpenCV's "
                "five-coefficient distortion; undistort the video and calibrate the result"
            )


def _of_lens(key: str) -> bool:
    """Whether a key says how a lens bends light."""
    plain = _plain(key)
    said = "distor" in plain and not plain.startswith("undistor")
    return (said and plain not in _MODELS) or plain in _COEFFICIENTS


def _plain(key: object) -> str:
    """A name however its words are put together: distCoeffs and dist_coeffs are one."""
    return str(key).lower().replace("_", "").replace("-", "")
