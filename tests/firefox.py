"""A headless Firefox driven through WebDriver BiDi, which it speaks by itself."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection, connect

NAMES = ("firefox-esr", "firefox")
_PATIENCE = 60.0  # s
_LISTENS = re.compile(r"WebDriver BiDi listening on (ws://\S+)")


def find_firefox() -> str | None:
    """Path of an installed browser, or None."""
    return next((found for name in NAMES if (found := shutil.which(name))), None)


class FirefoxPage:
    """One page of a browser."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket, self._number = socket, 0
        self.send("session.new", capabilities={})
        self._context = self.send("browsingContext.getTree")["contexts"][0]["context"]

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the protocol and wait for its result."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        self._socket.send(json.dumps(message))
        while True:
            answer = json.loads(self._socket.recv(timeout=_PATIENCE))
            if answer.get("id") == self._number:
                assert answer["type"] == "success", (method, answer)
                result: dict[str, Any] = answer["result"]
                return result

    def go(self, path: Path) -> None:
        """Load a file."""
        address = path.resolve().as_uri()
        self.send("browsingContext.navigate", context=self._context, url=address, wait="complete")

    def evaluate(self, expression: str) -> Any:
        """The value of an expression, promises awaited; what JSON can hold."""
        text = f"(async () => JSON.stringify((await ({expression})) ?? null))()"
        answer = self.send(
            "script.evaluate",
            expression=text,
            target={"context": self._context},
            awaitPromise=True,
        )
        assert answer["type"] == "success", answer["exceptionDetails"]["text"]
        return json.loads(answer["result"]["value"])


@contextmanager
def firefox(profile: Path) -> Iterator[FirefoxPage]:
    """A new browser with one blank page; it is ended afterwards.

    Args:
        profile: folder for its files, new.
    """
    program = find_firefox()
    assert program is not None, "no Firefox is installed"
    profile.mkdir(parents=True)
    said = profile / "said.txt"
    with said.open("w") as file:
        process = subprocess.Popen(
            [program, "--headless", "--no-remote", "--profile", str(profile),
             "--remote-debugging-port", "0", "about:blank"],
            stdout=file, stderr=subprocess.STDOUT, start_new_session=True,
        )  # fmt: skip
    try:
        address = f"{_address(said, process)}/session"
        with connect(address, max_size=None, open_timeout=_PATIENCE) as to:
            yield FirefoxPage(to)
    finally:
        process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _address(said: Path, process: subprocess.Popen[bytes]) -> str:
    """Where the browser listens, as it writes it."""
    end = time.monotonic() + _PATIENCE
    while (found := _LISTENS.search(said.read_text())) is None:
        assert process.poll() is None and time.monotonic() < end, "Firefox does not start"
        time.sleep(0.05)
    return found[1]
