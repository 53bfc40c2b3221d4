"""The command line. Nothing heavy is imported before a command runs."""

from __future__ import annotations

import logging
import sys
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated

import tyro

from perfcap import __version__
from perfcap.commands.actor import (
    ActorBuild,
    ActorCommand,
    ActorFit,
    ActorFrames,
    ActorInspect,
    ActorTools,
)
from perfcap.commands.capture import Batch, Capture, Demo, Doctor
from perfcap.commands.models import ListModels, Models, ModelsCommand, TryNetwork, WriteManifest
from perfcap.commands.results import Evaluate, Export, Render, Report, Retarget, View
from perfcap.commands.train import Train, TrainCommand, TrainDetector, TrainHead, TrainLifter
from perfcap.errors import InputError, one_line, sentence

Command = (
    Annotated[Demo, tyro.conf.subcommand("demo")]
    | Annotated[Capture, tyro.conf.subcommand("capture")]
    | Annotated[Batch, tyro.conf.subcommand("batch")]
    | Annotated[Evaluate, tyro.conf.subcommand("evaluate")]
    | Annotated[Render, tyro.conf.subcommand("render")]
    | Annotated[Report, tyro.conf.subcommand("report")]
    | Annotated[View, tyro.conf.subcommand("view")]
    | Annotated[Export, tyro.conf.subcommand("export")]
    | Annotated[Retarget, tyro.conf.subcommand("retarget")]
    | Annotated[ActorTools, tyro.conf.subcommand("actor")]
    | Annotated[Doctor, tyro.conf.subcommand("doctor")]
    | Annotated[Models, tyro.conf.subcommand("models")]
    | Annotated[Train, tyro.conf.subcommand("train")]
)
COMMANDS = (
    *("demo", "capture", "batch", "evaluate", "render", "report", "view"),
    *("export", "retarget", "actor", "doctor", "models", "train"),
)

_LONGEST_OPTION = 100  # letters
_LONGEST = 4096  # letters of a word, as of a path; messages about longer ones take seconds


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point: 0 done, 2 wrong call or input (one line says what), 3 captured with gaps."""
    given = sys.argv[1:] if arguments is None else list(arguments)
    handler = logging.StreamHandler()
    handler.setFormatter(_Line())
    logging.basicConfig(level=logging.WARNING, handlers=[handler])
    try:
        code = _run(given)
    except KeyboardInterrupt:
        sys.stderr.write("perfcap: interrupted\n")
        code = 130
    except Exception as error:
        told = sentence(error)
        if told is None:
            raise
        sys.stderr.write(f"perfcap: {told}\n")
        code = 2
    sys.exit(code)


def _run(arguments: list[str]) -> int:
    for number, text in enumerate(arguments):
        if not text or (text.endswith("=") and text.startswith("--")):
            after = f" after {arguments[number - 1]}" if number and not text else ""
            raise InputError(
                f"{text or 'the argument'}{after}: is empty, expected a value; is a variable unset?"
            )
        if "\0" in text:
            raise InputError(f"{text}: holds a zero character; expected none in names and options")
        if len(text) > _LONGEST:
            raise InputError(
                f"{text[:40]}...: has {len(text)} letters, expected {_LONGEST} at most"
            )
        name, _, _ = text.partition("=")
        if name.startswith("--") and len(name) > _LONGEST_OPTION:
            # looking for the nearest option takes the square of its length
            raise InputError(f"{name}: is no option; perfcap --help lists them")
    if arguments[:1] == ["--version"]:
        sys.stdout.write(f"perfcap {__version__}\n")
        return 0
    if arguments and not arguments[0].startswith("-") and arguments[0] not in COMMANDS:
        raise InputError(_no_command(arguments[0]))
    command = tyro.cli(
        Command,
        prog="perfcap",
        args=arguments,
        description="Human performance capture: skeleton motion and deforming surface from video.",
    )
    return _carry_out(command)


def _carry_out(command: Command) -> int:
    """Run a command; returns the exit code. What it needs is imported here, when it is known."""
    match command:
        case ActorTools() | Models() | Train():
            return _carry_out_part(command.command)
        case Demo():
            from perfcap.app.demo import run_demo

            return run_demo(command.out, command.overwrite)
        case Capture():
            from perfcap.app.capture import point_to, run_capture

            code = run_capture(command)
            point_to(command.folder)
            return code
        case Batch():
            from perfcap.app.batch import run_batch

            return run_batch(command)
        case Doctor():
            from perfcap.app.doctor import run_doctor

            return run_doctor(command)
        case _:
            return _carry_out_later(command)


def _carry_out_later(command: Evaluate | Render | Export | Retarget | Report | View) -> int:
    """Run a command on a finished capture; returns the exit code."""
    match command:
        case Evaluate():
            from perfcap.app.evaluate import run_evaluate

            return run_evaluate(command)
        case Render():
            from perfcap.app.render import run_render

            return run_render(command)
        case Export():
            from perfcap.app.export import run_export

            return run_export(command)
        case Retarget():
            from perfcap.app.retarget import run_retarget

            return run_retarget(command)
        case Report():
            from perfcap.app.report import run_report

            return run_report(command)
        case View():
            from perfcap.app.report import run_view

            return run_view(command.folder)


def _carry_out_part(command: ActorCommand | ModelsCommand | TrainCommand) -> int:
    """Run a command of ``perfcap actor``, ``models`` or ``train``; returns the exit code."""
    match command:
        case ActorInspect():
            from perfcap.app.actor_inspect import run_inspect

            return run_inspect(command.actor, command.mapping, command.out)
        case ActorBuild():
            from perfcap.app.actor_build import run_build

            return run_build(command)
        case ActorFit():
            from perfcap.app.actor_fit import run_fit

            return run_fit(command)
        case ActorFrames():
            from perfcap.app.actor_frames import run_frames

            return run_frames(command)
        case ListModels():
            from perfcap.app.models import run_list

            return run_list(command.folder)
        case WriteManifest() | TryNetwork():
            from perfcap.app.models import run_network

            return run_network(command)
        case TrainLifter():
            from perfcap.app.train import run_train_lifter

            return run_train_lifter(command)
        case TrainDetector():
            from perfcap.app.train_detector import run_train_detector

            return run_train_detector(command)
        case TrainHead():
            from perfcap.app.train_head import run_train_head

            return run_train_head(command)


def _no_command(word: str) -> str:
    """What is wrong with a first word that is no command, and what may have been meant."""
    near = get_close_matches(word[:_LONGEST_OPTION].lower(), COMMANDS, 1)
    if near:
        meant = f"did you mean {near[0]}?"
    elif Path(word).suffix:
        meant = f"to capture a video: perfcap capture {word}"
    else:
        meant = f"expected one of {', '.join(COMMANDS)}"
    return f"{word}: is no command of perfcap; {meant}"


class _Line(logging.Formatter):
    """One printable line a message, whatever it quotes."""

    def format(self, record: logging.LogRecord) -> str:
        return f"perfcap: {one_line(record.getMessage())}"
