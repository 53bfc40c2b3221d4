"""A headless Chromium driven through its DevTools protocol, and what it noticed."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

from websockets.sync.client import ClientConnection, connect

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--use-angle=swiftshader",  # WebGL without a graphics card
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-gpu-vsync",
    "--autoplay-policy=no-user-gesture-required",
    "--remote-debugging-port=0",
)
_PATIENCE = 60.0  # s
_KEYS = {" ": ("Space", 32), "Home": ("Home", 36), "End": ("End", 35)} | {
    f"Arrow{way}": (f"Arrow{way}", 37 + i) for i, way in enumerate(("Left", "Up", "Right", "Down"))
}
_INSIDE = ("data:", "blob:")  # addresses that are part of a page


def find_chromium() -> str | None:
    """Path of an installed browser, or None."""
    return next((found for name in NAMES if (found := shutil.which(name))), None)


class Page:
    """One page of a browser.

    Attributes:
        process: the browser's; its session is that of all its processes.
        console: errors and warnings that the page or the browser wrote, and thrown ones.
        requests: addresses that were asked for, beside the page itself and what lies in it.
    """

    def __init__(self, socket: ClientConnection, process: int) -> None:
        self.process = process
        self._socket = socket
        self._number = 0
        self._address = ""
        self.console: list[str] = []
        self.requests: list[str] = []
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.send(f"{domain}.enable")

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the protocol and wait for its result."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        self._socket.send(json.dumps(message))
        while True:
            answer = json.loads(self._socket.recv(timeout=_PATIENCE))
            if answer.get("id") == self._number:
                assert "error" not in answer, (method, answer["error"])
                result: dict[str, Any] = answer["result"]
                return result
            self._notice(answer.get("method", ""), answer.get("params", {}))

    def _notice(self, method: str, event: dict[str, Any]) -> None:
        if method == "Network.requestWillBeSent":
            address = event["request"]["url"]
            if not address.startswith(_INSIDE) and address.split("#")[0] != self._address:
                self.requests.append(address)
        elif method == "Runtime.exceptionThrown":
            details = event["exceptionDetails"]
            self.console.append(details.get("exception", {}).get("description", details["text"]))
        elif method == "Runtime.consoleAPICalled" and event["type"] in ("error", "warning"):
            self.console.append(" ".join(str(arg.get("value")) for arg in event["args"]))
        elif method == "Log.entryAdded" and event["entry"]["level"] in ("error", "warning"):
            self.console.append(event["entry"]["text"])

    def open(self, path: Path) -> Self:
        """Load a file and wait until its script is done."""
        self._address = path.resolve().as_uri()
        self.send("Page.navigate", url=self._address)
        self.wait("document.documentElement?.dataset.state === 'ready'")
        return self

    def evaluate(self, expression: str) -> Any:
        """The value of an expression, promises awaited."""
        answer = self.send(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait(self, expression: str, seconds: float = _PATIENCE) -> None:
        """Wait until an expression is true."""
        end = time.monotonic() + seconds
        while not self.evaluate(expression):
            assert time.monotonic() < end, f"never true: {expression}; {self.console}"
            time.sleep(0.02)

    def resize(self, width: int, height: int, scale: float = 1, mobile: bool = False) -> None:
        """Size of the window in pixels of the page."""
        self.send(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=scale,
            mobile=mobile,
        )
        self.send("Emulation.setTouchEmulationEnabled", enabled=mobile)

    def media(self, **features: str) -> None:
        """Preferences such as ``prefers_color_scheme="dark"``."""
        listed = [{"name": k.replace("_", "-"), "value": v} for k, v in features.items()]
        self.send("Emulation.setEmulatedMedia", features=listed)

    def press(self, key: str, shift: bool = False) -> None:
        """Press and release a key."""
        code, number = _KEYS.get(key, (f"Key{key.upper()}", ord(key.upper()[0])))
        plain = {"key": key, "code": code, "windowsVirtualKeyCode": number}
        typed = {"text": key} if len(key) == 1 else {}
        more = {"modifiers": 8} if shift else {}
        self.send("Input.dispatchKeyEvent", type="keyDown", **plain, **typed, **more)
        self.send("Input.dispatchKeyEvent", type="keyUp", **plain, **more)

    def box(self, selector: str) -> tuple[float, float, float, float]:
        """Left, top, width and height of an element, scrolled into view."""
        left, top, width, height = self.evaluate(
            f"""(() => {{
              const element = document.querySelector({json.dumps(selector)});
              element.scrollIntoView({{ block: "center", behavior: "instant" }});
              const box = element.getBoundingClientRect();
              return [box.left, box.top, box.width, box.height];
            }})()"""
        )
        return left, top, width, height

    def click(self, selector: str, across: float = 0.5, down: float = 0.5) -> None:
        """Click into an element, by default its middle."""
        left, top, width, height = self.box(selector)
        self.drag((left + across * width, top + down * height))

    def drag(self, *places: tuple[float, float], button: str = "left") -> None:
        """Press the mouse at the first place and release it at the last."""
        self._mouse("mouseMoved", places[0])
        self._mouse("mousePressed", places[0], button=button, clickCount=1)
        for place in places[1:]:
            self._mouse("mouseMoved", place, button=button, buttons=1 if button == "left" else 2)
        self._mouse("mouseReleased", places[-1], button=button, clickCount=1)

    def scroll(self, place: tuple[float, float], amount: float) -> None:
        """Turn the wheel."""
        self._mouse("mouseWheel", place, deltaX=0, deltaY=amount)

    def _mouse(self, kind: str, place: tuple[float, float], **more: Any) -> None:
        self.send("Input.dispatchMouseEvent", type=kind, x=place[0], y=place[1], **more)

    def screenshot(self, path: Path | None = None, full: bool = False, **more: Any) -> bytes:
        """PNG of what is seen, or of the whole page."""
        answer = self.send("Page.captureScreenshot", captureBeyondViewport=full, **more)
        data = base64.b64decode(answer["data"])
        if path is not None:
            path.write_bytes(data)
        return data


@contextmanager
def browser(profile: Path) -> Iterator[Page]:
    """A new browser with one blank page; it is ended afterwards.

    Args:
        profile: folder for its files, new.
    """
    program = find_chromium()
    assert program is not None, "no Chromium is installed"
    process = subprocess.Popen(
        [program, *FLAGS, f"--user-data-dir={profile}", "about:blank"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        with connect(_page_address(profile, process), max_size=None, open_timeout=_PATIENCE) as to:
            yield Page(to, process.pid)
    finally:
        process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _page_address(profile: Path, process: subprocess.Popen[bytes]) -> str:
    """Where the browser's page listens, as it writes it into its profile."""
    end = time.monotonic() + _PATIENCE
    file = profile / "DevToolsActivePort"
    while not (file.exists() and len(file.read_text().split()) == 2):
        assert process.poll() is None and time.monotonic() < end, "Chromium does not start"
        time.sleep(0.05)
    port, path = file.read_text().split()
    with connect(f"ws://127.0.0.1:{port}{path}", open_timeout=_PATIENCE) as whole:
        whole.send(json.dumps({"id": 1, "method": "Target.getTargets"}))
        targets = json.loads(whole.recv(timeout=_PATIENCE))["result"]["targetInfos"]
    page = next(target["targetId"] for target in targets if target["type"] == "page")
    return f"ws://127.0.0.1:{port}/devtools/page/{page}"
