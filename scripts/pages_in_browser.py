"""Opens pages of `deadtime` in headless Chromium and checks them: no error on the console, plots drawn, zoom linked, names shown and not run; figures zoom, show numbers,
switch their curves and change with their pickers; tables sort.

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
    browser.script(f"document.querySelector('#plots .plot').dispatchEvent(new KeyboardEvent('keydown', {{key: '{name}', bubbles: true}}))")


def range_shown(browser: Browser) -> list[float]:
    return [float(word) for word in str(browser.script("document.querySelector('#tools output').textContent")).replace("−", "-").split()[0:3:2]]


def check(browser: Browser, page: Path, shots: Path | None) -> list[str]:
    """What is wrong with a page."""
    wrong: list[str] = []
    # Several reports have the same name, each in a folder of its own.
    called = page.parent.name if page.stem == "report" else page.stem
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
            charts = browser.script("document.querySelectorAll('#plots canvas, .figure canvas, .figure table, main table').length")
            # Pixels that are not the background's, in every plot.
            blank = browser.script(
                "[...document.querySelectorAll('#plots canvas, .figure canvas')].filter((c) => { const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;"
                " let n = 0; for (let i = 3; i < d.length; i += 4) n += d[i] > 0; return n < 200; }).length"
            ) + browser.script("[...document.querySelectorAll('.figure')].filter((f) => !f.querySelector('canvas') && !f.querySelector('td')).length")
            over = browser.script("document.documentElement.scrollWidth - document.documentElement.clientWidth")
            if not charts or blank or over > 0:
                wrong.append(f"{width} {scheme}: {charts} plots, {blank} of them blank, {over} pixels too wide")
            if shots:
                height = int(browser.script("document.documentElement.scrollHeight"))
                shot = browser.call("Page.captureScreenshot", captureBeyondViewport=True, clip={"x": 0, "y": 0, "width": width, "height": min(height, 6000), "scale": 1})
                (shots / f"{called}-{width}-{scheme}.png").write_bytes(base64.b64decode(shot["data"]))
    wrong += figures(browser) + tables(browser)
    if browser.script("document.querySelector('#plots canvas') !== null"):
        wrong += linked(browser)
    if shots:
        (shots / f"{called}.pdf").write_bytes(base64.b64decode(browser.call("Page.printToPDF", printBackground=True)["data"]))
    return wrong


def figures(browser: Browser) -> list[str]:
    """What figures with pickers do not do."""
    wrong: list[str] = []
    pause = lambda: browser.script("new Promise((done) => setTimeout(done, 250))")  # noqa: E731
    for name in browser.script("[...document.querySelectorAll('.figure')].map((f) => f.id)"):  # type: ignore[union-attr]
        of = f"document.getElementById('{name}')"
        drawn = f"(() => {{ const c = {of}.querySelector('canvas'); return c ? c.toDataURL() : {of}.textContent; }})()"
        if browser.script(f"{of}.querySelector('canvas') !== null"):
            whole = browser.script(drawn)
            press = f"{of}.querySelector('.plot').dispatchEvent(new KeyboardEvent('keydown', {{key: '%s', bubbles: true}}))"
            browser.script(press % "+")
            pause()
            near = browser.script(drawn)
            browser.script(press % "0")
            pause()
            if near == whole or browser.script(drawn) != whole:
                wrong.append(f"{name}: + does not zoom, or 0 does not show all again")
            box = browser.script(f"(() => {{ {of}.scrollIntoView(); const b = {of}.querySelector('.u-over').getBoundingClientRect(); return [b.left, b.top, b.width, b.height]; }})()")
            left, top, width, height = (float(v) for v in box)  # type: ignore[union-attr]
            for share in (0.3, 0.35, 0.4, 0.5):
                browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=left + share * width, y=top + height / 2)
            pause()
            told = browser.script(f"[...{of}.querySelectorAll('.u-legend .u-value')].map((v) => v.textContent).join(' ')")
            if not any(c.isdigit() for c in str(told)):
                wrong.append(f"{name}: hovering shows no value: {told}")
            switched = f"(() => {{ const l = {of}.querySelectorAll('.u-legend tr')[1]; l.querySelector('th').dispatchEvent(new KeyboardEvent('keydown', {{key: 'Enter', bubbles: true}})); return l.classList.contains('u-off'); }})()"
            if browser.script(switched) == browser.script(switched):
                wrong.append(f"{name}: a name in the legend does not switch its curve")
        # Every choice of every picker is drawn, and the last differs from the first.
        for at in range(int(browser.script(f"{of}.querySelectorAll('select').length"))):  # type: ignore[call-overload]
            menu = f"{of}.querySelectorAll('select')[{at}]"
            choices = int(browser.script(f"{menu}.options.length"))  # type: ignore[call-overload]
            pictures = []
            for choice in range(choices):
                browser.script(f"(() => {{ const m = {menu}; m.selectedIndex = Math.min({choice}, m.options.length - 1); m.dispatchEvent(new Event('change')); }})()")
                pause()
                pictures.append(browser.script(drawn))
                if not browser.script(f"{of}.querySelector('canvas, td') !== null"):
                    wrong.append(f"{name}: nothing is drawn for choice {choice} of picker {at}")
            if choices > 1 and len(set(pictures)) < 2:
                wrong.append(f"{name}: picker {at} changes nothing")
    told = [str(e["params"])[:300] for e in browser.events if e["method"] in ("Runtime.exceptionThrown", "Page.javascriptDialogOpening")]
    return wrong + told


def tables(browser: Browser) -> list[str]:
    """What tables whose headings sort do not do."""
    return browser.script(
        """[...document.querySelectorAll('table.sorts, table.heat')].flatMap((t) => {
          const rows = t.tBodies[0].rows.length, buttons = [...t.tHead.querySelectorAll('button')];
          if (rows < 2 || !buttons.length) return [];
          const order = () => [...t.tBodies[0].rows].map((r) => r.textContent).join('|');
          const last = buttons[0];
          last.click();
          const rising = order(), said = last.parentElement.getAttribute('aria-sort');
          last.click();
          const same = new Set([...t.tBodies[0].rows].map((r) => r.cells[0].textContent)).size < 2;
          return said === 'ascending' && t.tBodies[0].rows.length === rows && (same || order() !== rising) ? [] : ['the table ' + t.caption.textContent + ' does not sort'];
        })"""
    )  # type: ignore[return-value]


def linked(browser: Browser) -> list[str]:
    """What curves over time that share an axis do not do."""
    wrong: list[str] = []
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
    box = browser.script("(() => { const b = document.querySelector('#plots .u-over').getBoundingClientRect(); scrollTo(0, scrollY + b.top - 200); const c = document.querySelector('#plots .u-over').getBoundingClientRect(); return [c.left, c.top, c.width, c.height]; })()")
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
    values = browser.script("[...document.querySelectorAll('#plots .u-legend .u-value')].map((v) => v.textContent)")
    if not any(any(c.isdigit() for c in str(v)) for v in values):  # type: ignore[union-attr]
        wrong.append(f"hovering shows no value: {values}")
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
