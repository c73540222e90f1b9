"""TensorBoard as people see it: the pages of two runs in a browser."""

import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from http.client import HTTPConnection
from pathlib import Path

import pytest
from training_bodies import recorded

from pcnclaws.data.hdf5 import write_scenes
from pcnclaws.train import train

# Longest that the server, or a page of it, may take [s].
PATIENCE = 60.0
PAGES = {
    "scalars": ("learning_rate", "gradient_norm/elasticity"),
    "images": ("motion/body_2",),
    "histograms": ("features/elasticity/0",),
    "hparams": ("hparams/test_mse", "training.learning_rate"),
    "mesh": ("points",),
}


@pytest.fixture
def address(in_process, tmp_path: Path) -> Iterator[str]:
    """Where TensorBoard shows a sweep of two short trainings."""
    write_scenes(tmp_path / "x.h5", recorded(3))
    short = ("training.iterations=4", "training.check_every=2", "training.segment_length={first: 10, last: 10}")
    options = ("experiment=elasticity_multi", "data.trajectories=x.h5", "logger.every=1", *short)
    done = in_process(train, "train", *options, "training.learning_rate=1e-3,1e-2", "--multirun")
    assert done.status == 0, done.err
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [
        sys.executable,
        "-m",
        "tensorboard.main",
        "--logdir",
        str(tmp_path / "outputs" / "runs"),
        "--port",
        str(port),
    ]
    server = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        _wait_for(port)
        yield f"http://127.0.0.1:{port}/"
    finally:
        server.terminate()
        server.wait()


@pytest.mark.slow
def test_a_browser_finds_what_was_written_on_each_page(address: str, tmp_path: Path) -> None:
    playwright = pytest.importorskip("playwright.sync_api")
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        pytest.skip("no chromium is installed")
    with playwright.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1500, "height": 1000})
        for name, words in PAGES.items():
            page.goto(f"{address}#{name}")
            page.reload()
            for word in words:
                page.get_by_text(word).first.wait_for(timeout=1e3 * PATIENCE, state="attached")
            assert page.screenshot(path=tmp_path / f"{name}.png")
        browser.close()


def _wait_for(port: int) -> None:
    """Returns once the server answers and has read what there is."""
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        connection = HTTPConnection("127.0.0.1", port)
        try:
            connection.request("GET", "/data/plugin/images/tags")
            if b"motion/" in connection.getresponse().read():
                return
        except ConnectionError:
            pass
        finally:
            connection.close()
        time.sleep(0.5)
    raise TimeoutError(f"no answer from port {port}")
