"""What a capture opens before it begins."""

import subprocess
import sys

import pytest

_OPENED = "import sys, perfcap.app.capture; print('trimesh' in sys.modules)"


@pytest.mark.long
def test_meshes_of_robots_are_not_opened_for_a_capture() -> None:
    command = [sys.executable, "-c", _OPENED]
    told = subprocess.run(command, capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "False"
