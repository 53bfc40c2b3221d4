"""The command line. Nothing heavy is imported before a command runs."""

from __future__ import annotations

import logging
import sys
from collections.abc import Sequence
from typing import Annotated, Protocol

import tyro

from perfcap.cli.actor import ActorTools
from perfcap.cli.capture import Capture, Demo, Doctor
from perfcap.cli.results import Evaluate, Export, Render, Report, View
from perfcap.cli.train import Train
from perfcap.errors import InputError

Command = (
    Annotated[Demo, tyro.conf.subcommand("demo")]
    | Annotated[Capture, tyro.conf.subcommand("capture")]
    | Annotated[Evaluate, tyro.conf.subcommand("evaluate")]
    | Annotated[Render, tyro.conf.subcommand("render")]
    | Annotated[Report, tyro.conf.subcommand("report")]
    | Annotated[View, tyro.conf.subcommand("view")]
    | Annotated[Export, tyro.conf.subcommand("export")]
    | Annotated[ActorTools, tyro.conf.subcommand("actor")]
    | Annotated[Doctor, tyro.conf.subcommand("doctor")]
    | Annotated[Train, tyro.conf.subcommand("train")]
)


class Runnable(Protocol):
    """A command with its options."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        ...


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point: 0 done, 2 wrong call or input (one line says what), 3 captured with gaps."""
    logging.basicConfig(level=logging.WARNING, format="perfcap: %(message)s")
    command: Runnable = tyro.cli(
        Command,
        prog="perfcap",
        args=arguments,
        description="Human performance capture: skeleton motion and deforming surface from video.",
    )
    try:
        code = command.run()
    except InputError as error:
        sys.stderr.write(f"perfcap: {error}\n")
        code = 2
    except KeyboardInterrupt:
        sys.stderr.write("perfcap: interrupted\n")
        code = 130
    sys.exit(code)
