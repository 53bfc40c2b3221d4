"""Modules of the viewer run by node."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import perfcap.report
from perfcap.report.page import bundle

NODE = shutil.which("node")
ASSETS = Path(perfcap.report.__file__).with_name("assets")


def run(imports: str, expression: str, given: Any) -> Any:
    """The value of an expression over ``given`` and what is imported, through JSON."""
    modules = {path.name: path.read_text(encoding="utf-8") for path in ASSETS.glob("*.js")}
    modules["entry.js"] = (
        f"{imports}\nconst given = {json.dumps(given)};\nconsole.log(JSON.stringify({expression}));"
    )
    assert NODE is not None
    done = subprocess.run(
        [NODE, "--input-type=module", "-"],
        input=bundle(modules, "entry.js"),
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout)
