"""The training loop: reproducible, resumable, on one process or several."""

from __future__ import annotations

import copy
import json
import logging
import math
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

import torch
from torch import Tensor, distributed, nn

from perfcap.errors import InputError
from perfcap.train.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from perfcap.train.config import LoopConfig

LAST, BEST, LOG = "last.safetensors", "best.safetensors", "metrics.jsonl"

_LOG = logging.getLogger(__name__)


Model = TypeVar("Model", bound=nn.Module)


class Task(Protocol[Model]):
    """What is learned."""

    model: Model

    def loss(self, number: int, size: int, progress: float) -> dict[str, Tensor]:
        """Losses on batch ``number`` of ``size`` samples; ``loss`` is minimised, others shown.

        ``progress`` is the share of the steps that are done.
        """

    def evaluate(self, model: nn.Module) -> dict[str, float]:
        """Scores of a model; the first is the one to make small."""


def train(
    task: Task[Model],
    config: LoopConfig,
    folder: Path,
    described: Mapping[str, Any],
    *,
    resume: bool = False,
    progress: Callable[[str, int, int], None] | None = None,
    watch: Callable[[int, Mapping[str, float]], None] | None = None,
) -> Model:
    """Train a task's model; the best average of its weights is returned and kept.

    A run that was stopped and resumed ends with the same numbers as one that was not: batches and
    dropout depend on the step alone.

    Args:
        task: what to learn; its model is trained in place.
        config: of the loop.
        folder: for ``last`` and ``best`` checkpoints and ``metrics.jsonl``.
        described: the whole configuration and what the data are, kept in checkpoints; those of a
            resumed run must be the same.
        resume: go on from the last checkpoint, if there is one.
        progress: told what is done and what there is to do.
        watch: given all numbers that are logged, such as a TensorBoard writer.

    Raises:
        InputError: settings that learn nothing, a checkpoint of others, or a loss that is not
            finite.
    """
    config.require_sound()
    state = _State(task, config, described)
    if resume and (folder / LAST).is_file():
        state.restore(load_checkpoint(folder / LAST))
    log = _Log(folder / LOG, state.step, watch)
    while state.step < config.steps:
        log.note(state.step, state.advance())
        if progress is not None:
            progress("train", state.step, config.steps)
        done = state.step == config.steps
        if state.step % config.evaluate_every == 0 or done:
            scores = task.evaluate(state.averaged)
            log.write(state.step, scores)
            if state.better(scores) and _first_process():
                save_checkpoint(folder / BEST, state.best_checkpoint())
        if (state.step % config.save_every == 0 or done) and _first_process():
            save_checkpoint(folder / LAST, state.checkpoint())
    if _place()[1] > 1:
        distributed.barrier()  # the first process has written the best weights
    if (folder / BEST).is_file():
        state.averaged.load_state_dict(load_checkpoint(folder / BEST).part("average"))
    return state.averaged.eval()


class _State(Generic[Model]):
    """Everything that changes while training."""

    def __init__(self, task: Task[Model], config: LoopConfig, described: Mapping[str, Any]) -> None:
        self.task, self.config = task, config
        self.described = json.dumps(described, sort_keys=True, default=str)
        self.optimizer = torch.optim.AdamW(
            _decayed(task.model, config.weight_decay), lr=config.learning_rate
        )
        self.averaged = _copy(task.model)
        self.step, self.best = 0, math.inf

    def advance(self) -> dict[str, float]:
        """One step; returns its numbers."""
        config, model = self.config, self.task.model.train()
        rate = learning_rate(config, self.step)
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        rank, processes = _place()
        number = self.step * processes + rank
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(mixed_seed(config.seed, number))  # dropout
            losses = self.task.loss(number, config.batch, self.step / config.steps)
        if not bool(torch.isfinite(losses["loss"])):
            raise InputError(
                f"training: the loss is not finite at step {self.step}; lower the learning rate, "
                "or look for NaN in the data"
            )
        self.optimizer.zero_grad()
        losses["loss"].backward()  # type: ignore[no-untyped-call]
        _share_gradients(model)
        nn.utils.clip_grad_norm_(model.parameters(), config.clip)
        self.optimizer.step()
        self.step += 1
        self._average()
        return {name: float(value.detach()) for name, value in losses.items()} | {"rate": rate}

    def better(self, scores: Mapping[str, float]) -> bool:
        """Whether the first score is the smallest yet."""
        score = next(iter(scores.values()))
        improved = score < self.best
        self.best = min(self.best, score)
        return improved

    def checkpoint(self) -> Checkpoint:
        """All that is needed to go on."""
        moments = {
            f"{i}.{name}": value.reshape(-1) if value.dim() == 0 else value
            for i, state in self.optimizer.state_dict()["state"].items()
            for name, value in state.items()
        }
        tensors = {f"optimizer.{name}": value for name, value in moments.items()}
        tensors |= {f"model.{k}": v for k, v in self.task.model.state_dict().items()}
        return self._with_average(tensors)

    def best_checkpoint(self) -> Checkpoint:
        """The weights alone."""
        return self._with_average({})

    def restore(self, saved: Checkpoint) -> None:
        """Go on from a checkpoint.

        Raises:
            InputError: it belongs to another configuration.
        """
        if saved.values["config"] != self.described:
            raise InputError(
                f"{saved.path}: was made with another configuration or --start, or of other "
                "motion, videos, cameras, joints, actors, backgrounds or photographs; expected the "
                "same to resume; give another --out, or leave --resume"
            )
        self.task.model.load_state_dict(saved.part("model"))
        self.averaged.load_state_dict(saved.part("average"))
        self.step, self.best = int(saved.values["step"]), float(saved.values["best"])
        moments: dict[int, dict[str, Tensor]] = {}
        for key, value in saved.part("optimizer").items():
            index, name = key.split(".", 1)
            scalar = name == "step"
            moments.setdefault(int(index), {})[name] = value.reshape(()) if scalar else value
        groups = self.optimizer.state_dict()["param_groups"]
        self.optimizer.load_state_dict({"state": moments, "param_groups": groups})

    def _with_average(self, tensors: dict[str, Tensor]) -> Checkpoint:
        tensors |= {f"average.{k}": v for k, v in self.averaged.state_dict().items()}
        values = {"step": str(self.step), "best": repr(self.best), "config": self.described}
        return Checkpoint(tensors, values)

    def _average(self) -> None:
        """Move the running mean; fast at first, when weights still move far."""
        keep = min(self.config.average, (1 + self.step) / (10 + self.step))
        with torch.no_grad():
            pairs = zip(self.averaged.parameters(), self.task.model.parameters(), strict=True)
            for weight, new in pairs:
                weight.lerp_(new, 1 - keep)
            buffers = zip(self.averaged.buffers(), self.task.model.buffers(), strict=True)
            for constant, value in buffers:
                constant.copy_(value)


class _Log:
    """``metrics.jsonl``: means of losses between evaluations, and scores."""

    def __init__(
        self, path: Path, step: int, watch: Callable[[int, Mapping[str, float]], None] | None
    ) -> None:
        self._path, self._watch = path, watch
        self._sums: dict[str, float] = {}
        self._count = 0
        self._since = time.perf_counter()
        if _first_process():
            path.parent.mkdir(parents=True, exist_ok=True)
            _cut(path, step)

    def note(self, step: int, values: Mapping[str, float]) -> None:
        for name, value in values.items():
            self._sums[name] = self._sums.get(name, 0.0) + value
        self._count += 1

    def write(self, step: int, scores: Mapping[str, float]) -> None:
        means = {name: total / max(1, self._count) for name, total in self._sums.items()}
        seconds = (time.perf_counter() - self._since) / max(1, self._count)
        line = {"step": step, **means, **scores, "seconds_a_step": seconds}
        self._sums, self._count, self._since = {}, 0, time.perf_counter()
        if not _first_process():
            return
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")
        _LOG.info("%s", line)
        if self._watch is not None:
            self._watch(step, line)


def learning_rate(config: LoopConfig, step: int) -> float:
    """Linear to the peak, then a cosine to zero at the last step."""
    if step < config.warmup:
        return config.learning_rate * (step + 1) / config.warmup
    share = (step - config.warmup) / max(1, config.steps - config.warmup)
    return 0.5 * config.learning_rate * (1 + math.cos(math.pi * share))


def mixed_seed(seed: int, number: int) -> int:
    """One seed of two numbers, far apart for neighbours (the finaliser of SplitMix64)."""
    mask = 2**64 - 1
    value = (seed * 0x9E3779B97F4A7C15 + number + 1) * 0xBF58476D1CE4E5B9 & mask
    value = (value ^ value >> 30) * 0x94D049BB133111EB & mask
    return (value ^ value >> 31) & (2**63 - 1)


def _decayed(model: nn.Module, weight_decay: float) -> list[dict[str, Any]]:
    """Parameter groups: matrices decay, offsets and scales do not."""
    parameters = [p for p in model.parameters() if p.requires_grad]
    return [
        {"params": [p for p in parameters if p.dim() > 1], "weight_decay": weight_decay},
        {"params": [p for p in parameters if p.dim() <= 1], "weight_decay": 0.0},
    ]


def _copy(model: Model) -> Model:
    return copy.deepcopy(model).eval().requires_grad_(False)


def _place() -> tuple[int, int]:
    """Rank and number of processes."""
    if distributed.is_available() and distributed.is_initialized():
        return distributed.get_rank(), distributed.get_world_size()
    return 0, 1


def _first_process() -> bool:
    return _place()[0] == 0


def _share_gradients(model: nn.Module) -> None:
    """Mean of the gradients of all processes, so that their weights stay the same."""
    processes = _place()[1]
    if processes == 1:
        return
    for parameter in model.parameters():
        if parameter.grad is not None:
            distributed.all_reduce(parameter.grad)
            parameter.grad /= processes


def _cut(path: Path, step: int) -> None:
    """Drop lines of steps that will be taken again."""
    if not path.is_file():
        return
    lines = path.read_text(encoding="utf-8").splitlines()
    kept = [line for line in lines if json.loads(line)["step"] <= step] if step else []
    path.write_text("".join(f"{line}\n" for line in kept), encoding="utf-8")
