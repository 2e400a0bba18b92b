"""The cell of a view in Chromium: it shows the gateway's page, and the exact picture where that can't be reached."""

import contextlib
import http.server
import shutil
import sys
import threading
import time

import pytest

import isoscope
import skips
from isoscope import viewer

PATIENCE_S = 180  # a limit for waiting, far above what is needed


@pytest.fixture(autouse=True)
def without_widgets(monkeypatch):
    monkeypatch.setitem(sys.modules, "anywidget", None)
    viewer._widget_class.cache_clear()
    yield
    viewer._widget_class.cache_clear()


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    missing = [name for name in ("chromium", "chromedriver") if shutil.which(name) is None]
    try:
        from selenium import webdriver
        from selenium.webdriver.chrome.options import Options
        from selenium.webdriver.chrome.service import Service
    except ImportError:
        missing.append("python3-selenium")
    if missing:
        skips.skip("browser", f"no {', '.join(missing)}")
    options = Options()
    options.binary_location = shutil.which("chromium")
    for argument in (
        "--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader", "--window-size=1300,900", f"--user-data-dir={tmp_path_factory.mktemp('profile')}",
    ):  # fmt: skip
        options.add_argument(argument)
    browser = webdriver.Chrome(service=Service(shutil.which("chromedriver")), options=options)
    yield browser
    browser.quit()


class Notebook:
    """A page of its own origin that shows the HTML of one cell, as a notebook does."""

    def __init__(self):
        self.cell = ""
        notebook = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self):
                body = f'<!doctype html><meta charset="utf-8"><body data-jp-theme-light="true">{notebook.cell}</body>'.encode()
                self.send_response(200)
                self.send_header("Content-Type", "text/html; charset=utf-8")
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, *_):
                pass

        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.origin = f"http://localhost:{self.server.server_address[1]}"
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def close(self):
        self.server.shutdown()
        self.server.server_close()


@pytest.fixture
def notebook():
    with contextlib.closing(Notebook()) as notebook:
        yield notebook


def until(browser, condition):
    end = time.monotonic() + PATIENCE_S
    while not browser.execute_script(f"return Boolean({condition})"):
        assert time.monotonic() < end, f"never came: {condition}; the log: {browser.get_log('browser')}"
        time.sleep(0.05)


def show(browser, notebook, view):
    browser.switch_to.default_content()
    notebook.cell = view._repr_mimebundle_()["text/html"]
    browser.get(notebook.origin)


def test_the_cell_is_the_page_with_its_controls(browser, notebook, dataset):
    view = dataset.view(127.5, view="top", size=(500, 400), origin=notebook.origin)
    show(browser, notebook, view)
    until(browser, "document.querySelector('iframe')")
    frame = browser.find_element("css selector", "iframe")
    assert frame.size == {"width": 828, "height": 448} and not browser.find_elements("css selector", "img")
    browser.switch_to.frame(frame)
    until(browser, "window.isoscope && isoscope.view.isExact")
    state = browser.execute_script("return isoscope.view.getState()")
    assert state["surfaces"][0]["isovalue"] == 127.5
    assert [state["camera"]["eye"][axis] for axis in "xyz"] == list(dataset.camera("top").eye)
    # The isovalue of the cell moves, and no token is left in its address.
    isovalue = browser.find_element("css selector", "#surfaces input[type=number]")
    isovalue.clear()
    isovalue.send_keys("60\n")
    until(browser, "isoscope.view.isExact && isoscope.view.getState().surfaces[0].isovalue === 60")
    assert "token" not in browser.execute_script("return location.href")
    assert browser.execute_script("return document.getElementById('histogram').getBoundingClientRect().width") > 0


def test_the_cell_stays_the_picture_for_another_origin_and_after_the_end(browser, notebook, folder):
    with isoscope.serve(folder, renderer="cpu", threads=1) as client:
        show(browser, notebook, client["shells"].view(127.5, size=(200, 150), origin="http://localhost:1"))
        until(browser, "document.querySelector('.isoscope-note').textContent")
        note = browser.execute_script("return document.querySelector('.isoscope-note').textContent")
        assert notebook.origin in note and "view(origin=...)" in note
        view = client["shells"].view(127.5, size=(200, 150), origin=notebook.origin)
        view._repr_mimebundle_()
    show(browser, notebook, view)
    until(browser, "document.querySelector('.isoscope-note').textContent")
    assert browser.execute_script("return document.querySelector('img').naturalWidth") == 200
    assert not browser.find_elements("css selector", "iframe")
