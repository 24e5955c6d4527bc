"""Opens pages of `deadtime gap` and `deadtime estimate` in headless Chromium and checks them: no error on the console, plots drawn, zoom linked, names shown and not run.

    python scripts/pages_in_browser.py [--shots FOLDER] PAGE.html ...

At 390, 1280 and 1920 pixels, light and dark; with --shots a picture of each is written, and the page printed as PDF. Needs nothing but Chromium; without one it says so and passes.
"""

from __future__ import annotations

import argparse
import base64
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

WIDTHS = (390, 1280, 1920)


class Browser:
    """Chromium, driven over its debugging pipe."""

    def __init__(self, program: str, folder: str) -> None:
        # Not 3 and 4, which the browser reads and writes.
        (commands, self._commands), (self._answers, answers) = [tuple(os.dup(end) for end in os.pipe()) for _ in range(2)]

        def wire() -> None:
            first, second = os.dup(commands), os.dup(answers)
            os.dup2(first, 3)
            os.dup2(second, 4)

        options = ["--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", f"--user-data-dir={folder}", "--remote-debugging-pipe", "about:blank"]
        self._process = subprocess.Popen([program, *options], preexec_fn=wire, close_fds=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(commands)
        os.close(answers)
        self._number, self._read, self.events = 0, b"", []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: object) -> dict:
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if hasattr(self, "_session"):
            message["sessionId"] = self._session
        os.write(self._commands, json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self._read:
                self._read += os.read(self._answers, 1 << 20) or self._gone()
            text, self._read = self._read.split(b"\0", 1)
            answer = json.loads(text)
            if answer.get("id") == self._number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return answer["result"]
            self.events.append(answer)

    def _gone(self) -> bytes:
        raise RuntimeError("the browser ended")

    def script(self, text: str) -> object:
        answer = self.call("Runtime.evaluate", expression=text, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(str(answer["exceptionDetails"]))
        return answer["result"].get("value")

    def end(self) -> None:
        self._process.terminate()
        self._process.wait()


def key(browser: Browser, name: str) -> None:
    browser.script(f"document.querySelector('.plot').dispatchEvent(new KeyboardEvent('keydown', {{key: '{name}', bubbles: true}}))")


def range_shown(browser: Browser) -> list[float]:
    return [float(word) for word in str(browser.script("document.querySelector('#tools output').textContent")).replace("−", "-").split()[0:3:2]]


def check(browser: Browser, page: Path, shots: Path | None) -> list[str]:
    """What is wrong with a page."""
    wrong: list[str] = []
    for width in WIDTHS:
        for scheme in ("light", "dark"):
            browser.events.clear()
            browser.call("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=width < 600)
            browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
            browser.call("Page.navigate", url=page.as_uri())
            browser.script("new Promise((done) => { const look = () => document.readyState === 'complete' ? setTimeout(done, 300) : setTimeout(look, 50); look(); })")
            for event in browser.events:
                told = event["params"].get("entry", {}).get("text") if event["method"] == "Log.entryAdded" else None
                if event["method"] == "Runtime.exceptionThrown":
                    told = str(event["params"]["exceptionDetails"])
                if event["method"] == "Runtime.consoleAPICalled" and event["params"]["type"] in ("error", "warning"):
                    told = str(event["params"]["args"])
                if event["method"] == "Page.javascriptDialogOpening":
                    told = "a name was run: a dialog opened"
                if told:
                    wrong.append(f"{width} {scheme}: {told}")
            charts = browser.script("document.querySelectorAll('#plots canvas').length")
            # Pixels that are not the background's, in every plot.
            blank = browser.script(
                "[...document.querySelectorAll('#plots canvas')].filter((c) => { const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;"
                " let n = 0; for (let i = 3; i < d.length; i += 4) n += d[i] > 0; return n < 200; }).length"
            )
            over = browser.script("document.documentElement.scrollWidth - document.documentElement.clientWidth")
            if not charts or blank or over > 0:
                wrong.append(f"{width} {scheme}: {charts} plots, {blank} of them blank, {over} pixels too wide")
            if shots:
                height = int(browser.script("document.documentElement.scrollHeight"))
                shot = browser.call("Page.captureScreenshot", captureBeyondViewport=True, clip={"x": 0, "y": 0, "width": width, "height": min(height, 6000), "scale": 1})
                (shots / f"{page.stem}-{width}-{scheme}.png").write_bytes(base64.b64decode(shot["data"]))
    before = range_shown(browser)
    key(browser, "0")
    whole = range_shown(browser)
    key(browser, "+")
    near = range_shown(browser)
    key(browser, "ArrowRight")
    moved = range_shown(browser)
    if not (whole[0] <= before[0] < before[1] <= whole[1] and near[1] - near[0] < 0.6 * (whole[1] - whole[0]) and moved[0] > near[0]):
        wrong.append(f"keys: opened on {before}, 0 shows {whole}, + {near}, then right {moved}")
    # A drag across the first plot zooms the last one.
    box = browser.script("(() => { const b = document.querySelector('.u-over').getBoundingClientRect(); scrollTo(0, scrollY + b.top - 200); const c = document.querySelector('.u-over').getBoundingClientRect(); return [c.left, c.top, c.width, c.height]; })()")
    left, top, width, height = (float(v) for v in box)  # type: ignore[union-attr]
    drag = lambda kind, share: browser.call("Input.dispatchMouseEvent", type=kind, x=left + share * width, y=top + height / 2, button="left", buttons=1, clickCount=1)  # noqa: E731
    drag("mouseMoved", 0.3)
    drag("mousePressed", 0.3)
    for share in (0.35, 0.45, 0.6):
        drag("mouseMoved", share)
    drag("mouseReleased", 0.6)
    browser.script("new Promise((done) => setTimeout(done, 300))")
    zoomed = range_shown(browser)
    expected = 0.3 * (moved[1] - moved[0])
    if abs((zoomed[1] - zoomed[0]) - expected) > 0.1 * expected:
        wrong.append(f"a drag over three tenths of {moved} shows {zoomed}")
    values = browser.script("[...document.querySelectorAll('.u-legend .u-value')].map((v) => v.textContent)")
    if not any(any(c.isdigit() for c in str(v)) for v in values):  # type: ignore[union-attr]
        wrong.append(f"hovering shows no value: {values}")
    if shots:
        (shots / f"{page.stem}.pdf").write_bytes(base64.b64decode(browser.call("Page.printToPDF", printBackground=True)["data"]))
    return wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--shots", type=Path, help="folder for pictures")
    parser.add_argument("pages", type=Path, nargs="+")
    words = parser.parse_args()
    program = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if program is None:
        print("skipped: there is no Chromium")
        return 0
    if words.shots:
        words.shots.mkdir(parents=True, exist_ok=True)
    failed = False
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        browser = Browser(program, folder)
        try:
            for page in words.pages:
                wrong = check(browser, page.resolve(), words.shots)
                print(f"{page}: " + ("as it should be" if not wrong else "; ".join(wrong)))
                failed |= bool(wrong)
        finally:
            browser.end()
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
