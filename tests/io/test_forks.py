"""Children forked from a process that has read videos and run networks, with several threads."""

import gc
import os
import subprocess
import sys
import weakref
from pathlib import Path

import pytest
from video_files import make_video

from perfcap.io.video import VideoFile

CODE = """
import gc, os, signal, sys
import numpy as np
import torch
from perfcap.detect.onnx import OnnxDetector
from perfcap.io import models_folder
from perfcap.io.clip import Clip

clip = Clip.open(sys.argv[1])
clip.read_view(0, 0, 3)
network = OnnxDetector(models_folder() / "detectors" / "rendered")
image = np.random.default_rng(0).integers(0, 255, (1, 224, 224, 3), np.uint8)
expected = network.estimate(image).joints2d
assert torch.get_num_threads() == 2
child = os.fork()
if not child:
    signal.alarm(60)
    assert np.array_equal(clip.read_view(0, 3, 6), Clip.open(sys.argv[1]).read_view(0, 3, 6))
    assert torch.allclose(torch.as_tensor(network.estimate(image).joints2d),
                          torch.as_tensor(expected), rtol=1e-4)
    del clip, network
    gc.collect()
    os._exit(0)
sys.exit(os.waitpid(child, 0)[1] and 1)
"""


@pytest.mark.long
@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system does not fork")
def test_a_child_goes_on_with_an_open_video_and_network(tmp_path: Path) -> None:
    script = tmp_path / "look.py"
    script.write_text(CODE)
    video = make_video(tmp_path / "video.mp4", 20)
    call = [sys.executable, "-W", "ignore", str(script), str(video)]
    two = {**os.environ, "OMP_NUM_THREADS": "2"}
    ended = subprocess.run(call, env=two, check=False, timeout=120)
    assert ended.returncode == 0


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="threads cannot be counted")
def test_a_video_that_nobody_holds_is_let_go_of_at_once(tmp_path: Path) -> None:
    video = VideoFile(make_video(tmp_path / "video.mp4", 20))
    gone = weakref.ref(video)
    gc.disable()
    try:
        before = len(os.listdir("/proc/self/task"))
        video.read(0, 3)
        del video
        assert gone() is None
        assert len(os.listdir("/proc/self/task")) == before
    finally:
        gc.enable()
