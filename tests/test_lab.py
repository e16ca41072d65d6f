"""`make lab` as a reader meets it: JupyterLab in a browser, all of notebook 06 run, a slider moved.

The browser is driven by its DevTools protocol; without Chromium there is nothing to see.
"""

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import time
import urllib.request
from contextlib import contextmanager
from pathlib import Path

import pytest
import websocket

ROOT = Path(__file__).resolve().parents[1]
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
NOTEBOOK = "06_refinement.ipynb"
WINDOW = {"width": 1400, "height": 900, "deviceScaleFactor": 2, "mobile": False}
PANEL = "[...jupyterapp.shell.widgets('main')].find(w => w.content?.widgets?.length)"
#: Scrolls to the sliders.
SHOW = f"""(async () => {{
    const panel = {PANEL}, cells = panel.content.widgets;
    jupyterapp.shell.activateById(panel.id);
    const number = cells.findIndex(cell => cell.model.sharedModel.source.includes('Sliders('));
    panel.content.activeCellIndex = number;
    await panel.content.scrollToItem(number, 'start');
}})()"""
PLACES = """[...document.querySelectorAll('.widget-slider, .widget-image')].map(element => {
    const {top, bottom, width} = element.getBoundingClientRect();
    return {top, bottom, width, pixels: element.naturalWidth};
})"""
SOURCE = "document.querySelector('.widget-image').src"


@contextmanager
def running(command, folder, pattern):
    """A process in ``folder``, ended with all that it has started; gives what it says by
    ``pattern`` once it is ready."""
    log = folder / f"{Path(command[0]).name}.log"
    with log.open("wb") as file:
        process = subprocess.Popen(
            command, cwd=folder, stdout=file, stderr=file, start_new_session=True
        )
    try:
        yield waited_for(lambda: re.search(pattern, log.read_text(errors="replace")))[1]
    finally:
        os.killpg(process.pid, signal.SIGTERM)
        process.wait(30)


def waited_for(asked, seconds=90):
    end = time.monotonic() + seconds
    while not (answer := asked()):
        assert time.monotonic() < end
        time.sleep(0.1)
    return answer


class Page:
    """A page of Chromium."""

    def __init__(self, port):
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json") as answer:
            (about, *_) = [tab for tab in json.load(answer) if tab["type"] == "page"]
        self.socket = websocket.create_connection(about["webSocketDebuggerUrl"], timeout=240)
        self.calls = 0

    def call(self, method, **parameters):
        self.calls += 1
        self.socket.send(json.dumps({"id": self.calls, "method": method, "params": parameters}))
        while (answer := json.loads(self.socket.recv())).get("id") != self.calls:
            pass
        return answer["result"]

    def value(self, script):
        more = {"awaitPromise": True, "returnByValue": True}
        answer = self.call("Runtime.evaluate", expression=script, **more)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait_for(self, script):
        waited_for(lambda: self.value(script))


@pytest.fixture
def lab(tmp_path):
    """Port of `make lab` in a folder of its own: nothing is saved into the repository."""
    for name in (".venv", "Makefile", "tools", "data_synth", "paperrepro"):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / "notebooks").mkdir()
    shutil.copy(ROOT / "notebooks" / NOTEBOOK, tmp_path / "notebooks")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    arguments = (
        f"--no-browser --ip=127.0.0.1 --port={port} --ServerApp.port_retries=0 "
        "--IdentityProvider.token=test --LabApp.expose_app_in_browser=True"
    )
    command = ["make", "-o", ".venv/.ready", "lab", f"ARGS={arguments}"]
    with running(command, tmp_path, "(is running at)"):
        yield port


@pytest.fixture
def page(tmp_path):
    command = [
        CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu", "--remote-debugging-port=0",
        "--remote-allow-origins=*", f"--user-data-dir={tmp_path / 'browser'}", "about:blank",
    ]  # fmt: skip
    with running(command, tmp_path, r"DevTools listening on ws://[\d.]+:(\d+)/") as port:
        page = Page(port)
        page.call("Emulation.setDeviceMetricsOverride", **WINDOW)
        page.call("Emulation.setFocusEmulationEnabled", enabled=True)
        yield page


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium here: install it to look at JupyterLab")
def test_sliders_move_the_roof_in_jupyterlab(lab, page):
    page.call(
        "Page.navigate", url=f"http://127.0.0.1:{lab}/lab/tree/notebooks/{NOTEBOOK}?token=test"
    )
    page.wait_for(f"!!window.jupyterapp && !!{PANEL}")
    page.value(f"{PANEL}.sessionContext.ready")
    assert page.value("jupyterapp.commands.execute('notebook:run-all-cells')") is True
    assert page.value("document.querySelectorAll('.jp-Dialog').length") == 0
    assert page.value("document.querySelectorAll('[data-mime-type$=error]').length") == 0

    page.value(SHOW)
    page.wait_for("document.querySelectorAll('.widget-image').length == 1")
    *sliders, picture = page.value(PLACES)
    assert len(sliders) == 3
    assert picture["bottom"] - sliders[0]["top"] < 0.6 * WINDOW["height"]
    assert picture["pixels"] == WINDOW["deviceScaleFactor"] * picture["width"]

    before = page.value(SOURCE)
    page.value("document.querySelector('.noUi-handle').focus()")
    for kind in ("keyDown", "keyUp"):
        page.call("Input.dispatchKeyEvent", type=kind, key="ArrowRight", windowsVirtualKeyCode=39)
    page.wait_for(f"{SOURCE} != {json.dumps(before)}")
