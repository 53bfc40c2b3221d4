"""A network run by onnxruntime: checked when opened, quiet, on one thread; and its input."""

from __future__ import annotations

import hashlib
import logging
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perfcap.detect.manifest import InputSpec, ModelFile
from perfcap.detect.onnx_file import read_model
from perfcap.detect.onnx_prune import prune_outputs
from perfcap.errors import InputError
from perfcap.forks import abandon_after_fork
from perfcap.setting_checks import require_count

Array = NDArray[Any]

_PROVIDERS = {"cpu": "CPUExecutionProvider", "cuda": "CUDAExecutionProvider"}
_DTYPES = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(uint8)": np.uint8,
    "tensor(int32)": np.int32,
}

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class Execution:
    """Where and how a network runs.

    Attributes:
        provider: ``cpu``; ``cuda``; ``auto`` for CUDA where onnxruntime has it.
        threads: of the CPU. They sleep between calls: spinning ones take cores from others.
    """

    provider: str = "auto"
    threads: int = 1

    def __post_init__(self) -> None:
        require_count(self.threads, "threads")


class Session:
    """An open network with named inputs and outputs.

    Args:
        file: the model.
        execution: provider and threads.
        wanted: outputs that will be asked for; what only others need is left out. All if none is
            named, or one that the model does not have.

    Attributes:
        path: the model's file.
        shapes: of each input and output, by name; an axis of open size is None.
        dtypes: numpy's type of each input.
        warnings: what a user should know, such as a GPU that was asked for and is not used.
    """

    def __init__(
        self, file: ModelFile, execution: Execution | None = None, wanted: Sequence[str] = ()
    ) -> None:
        self.path = file.path
        self._settings = file, execution or Execution(), tuple(wanted)
        names, self.warnings = _providers(self._settings[1].provider)
        self._session: Any = None
        session = self._opened()
        if names[0] not in session.get_providers():
            self.warnings = (*self.warnings, _fallback(names[0]))
        inputs, outputs = session.get_inputs(), session.get_outputs()
        self.inputs = tuple(node.name for node in inputs)
        self.outputs = tuple(node.name for node in outputs)
        self.shapes = {node.name: _shape(node.shape) for node in (*inputs, *outputs)}
        self.dtypes = {node.name: _DTYPES.get(node.type) for node in inputs}
        abandon_after_fork(self)

    def _opened(self) -> Any:
        """The session of this process."""
        if self._session is None:
            file, execution, wanted = self._settings
            data, outside = read_model(file.path)
            _check_digest(file, data)
            names, _ = _providers(execution.provider)
            # bytes that were checked are the bytes that run; only weights beside them need the path
            source = str(file.path) if outside else prune_outputs(data, wanted)
            self._session = _open(file.path, source, names, execution.threads)
        return self._session

    def abandon(self) -> object:
        """Give up the open network without closing it; see ``perfcap.forks``."""
        held, self._session = self._session, None
        return held

    def __reduce__(self) -> tuple[Any, ...]:
        """Sessions do not travel between processes: the model is opened again over there."""
        return Session, self._settings

    @property
    def provider(self) -> str:
        """Where it runs, such as ``CPUExecutionProvider``."""
        return str(self._opened().get_providers()[0])

    def run(self, feeds: Mapping[str, Array], outputs: Sequence[str]) -> list[Array]:
        """Outputs by name of inputs by name; inputs are made contiguous first.

        Raises:
            InputError: the network refuses, in its own words.
        """
        ready = {name: np.ascontiguousarray(value) for name, value in feeds.items()}
        session = self._opened()
        try:
            found: list[Array] = session.run(list(outputs), ready)
        except Exception as error:  # onnxruntime's classes share no base of their own
            raise InputError(f"{self.path}: cannot be run ({_first_line(error)})") from None
        return found

    def require_output(self, name: str, field: str) -> None:
        """Refuse a name that is none of the model's outputs.

        Raises:
            InputError: names what the model has.
        """
        if name not in self.outputs:
            raise InputError(
                f"{self.path.parent}: {field} names output {name!r}, the model has "
                f"{', '.join(self.outputs)}; expected one of these"
            )


def _open(path: Path, source: str | bytes, providers: list[str], threads: int) -> Any:
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 4  # what matters comes back as an error
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.add_session_config_entry("session.inter_op.allow_spinning", "0")
    try:
        return onnxruntime.InferenceSession(source, options, providers=providers)
    except Exception as error:  # likewise
        raise InputError(f"{path}: {_reason(_first_line(error))}") from None


def _reason(text: str) -> str:
    """What onnxruntime means, and what to do."""
    operator = re.search(r"No Op registered for (\S+)", text) or re.search(
        r"implementation for (\S+)", text
    )
    if operator:
        return (
            f"uses operator {operator.group(1)}, which onnxruntime does not know; export with "
            "standard operators or an older opset"
        )
    if "opset" in text.lower() or "ir_version" in text.lower() or "IR version" in text:
        return f"is newer than onnxruntime ({text}); export with an older opset"
    if "protobuf" in text.lower():
        return "is not an ONNX model; export the network again"
    return f"cannot be opened ({text}); export the network again"


def _first_line(error: Exception) -> str:
    text = " ".join(str(error).split())
    return re.sub(r"^\[ONNXRuntimeError\] : \d+ : \w+ : ", "", text)[:300]


def _check_digest(file: ModelFile, data: bytes) -> None:
    found = hashlib.sha256(data).hexdigest()
    if found != file.sha256:
        raise InputError(
            f"{file.path}: has sha256 {found[:12]}..., the manifest says {file.sha256[:12]}...; "
            "restore the model, or correct the manifest if the change is meant"
        )


def _providers(wanted: str) -> tuple[list[str], tuple[str, ...]]:
    """Providers in order of preference; the CPU is always the last."""
    import onnxruntime

    available = onnxruntime.get_available_providers()
    cpu, cuda = _PROVIDERS["cpu"], _PROVIDERS["cuda"]
    if wanted not in (*_PROVIDERS, "auto"):
        raise InputError(f"provider {wanted!r} is unknown; expected auto, cpu or cuda")
    if wanted == "cpu" or (wanted == "auto" and cuda not in available):
        return [cpu], ()
    if cuda not in available:
        return [cpu], (_fallback(cuda),)
    return [cuda, cpu], ()


def _fallback(provider: str) -> str:
    return (
        f"onnxruntime has no {provider}: detection runs on the CPU; for a GPU replace the package "
        "onnxruntime by onnxruntime-gpu"
    )


def _shape(shape: Sequence[Any]) -> tuple[int | None, ...]:
    return tuple(axis if isinstance(axis, int) and axis >= 0 else None for axis in shape)


# --- Crops as a network of images wants them, and whether it does ---------------------------------


def prepare_crops(crops: NDArray[np.uint8], spec: InputSpec) -> NDArray[Any]:
    """The input of a network for crops (N, h, w, 3), RGB."""
    channels = crops[..., ::-1] if spec.color == "bgr" else crops
    if "int" in spec.dtype:
        values: NDArray[Any] = channels.astype(spec.dtype)
    else:
        values = _normalised(channels, spec).astype(spec.dtype, copy=False)
    return values if spec.layout == "nhwc" else values.transpose(0, 3, 1, 2)


def _normalised(channels: NDArray[np.uint8], spec: InputSpec) -> NDArray[np.float32]:
    """(pixel x scale - mean) / std; steps that change no number are left out."""
    values = channels.astype(np.float32)
    if spec.scale != 1:
        values *= np.float32(spec.scale)
    if any(spec.mean):
        values -= np.asarray(spec.mean, np.float32)
    if any(value != 1 for value in spec.std):
        values /= np.asarray(spec.std, np.float32)
    return values


def check_image_input(path: Path, spec: InputSpec, session: Session) -> tuple[str, int]:
    """Name of a network's only input, and its fixed batch, 0 when open.

    Args:
        path: of the manifest.
        spec: what the manifest says.
        session: the open network.

    Raises:
        InputError: manifest and network do not fit each other.
    """
    name = spec.name or session.inputs[0]
    if len(session.inputs) != 1 or name not in session.inputs:
        raise InputError(
            f"{path}: input {name!r} is to be the model's only one, it has "
            f"{', '.join(session.inputs)}; expected a network of one image"
        )
    height, width = spec.size
    image = (3, height, width) if spec.layout == "nchw" else (height, width, 3)
    found = session.shapes[name]
    fits = len(found) == 4 and all(
        a is None or a == b for a, b in zip(found[1:], image, strict=True)
    )
    if not fits:
        raise InputError(
            f"{path}: input.size and layout mean (N, {', '.join(map(str, image))}), the "
            f"model wants {_shown(found)}; correct input.size or input.layout"
        )
    if session.dtypes[name] != np.dtype(spec.dtype).type:
        wanted = session.dtypes[name]
        raise InputError(
            f"{path}: input.dtype is {spec.dtype}, the model wants "
            f"{np.dtype(wanted).name if wanted else 'another type'}; correct input.dtype"
        )
    return name, found[0] or 0


def _shown(shape: Sequence[int | None]) -> str:
    return f"({', '.join('N' if axis is None else str(axis) for axis in shape)})"
