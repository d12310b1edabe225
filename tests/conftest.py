"""What tests of several folders use."""

import os
import shutil
from pathlib import Path

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome")


@pytest.fixture(scope="session")
def chromium():
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    if path is None:
        pytest.skip("no Chromium was found")
    with playwright.sync_playwright() as run:
        # Root, as in containers, has no sandbox.
        arguments = ["--no-sandbox"] if os.geteuid() == 0 else []
        browser = run.chromium.launch(executable_path=path, args=arguments)
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def axe_script():
    """axe-core, to be run in a page."""
    axe = pytest.importorskip("axe_playwright_python", reason="axe-core is not installed")
    return (Path(axe.__file__).parent / "axe.min.js").read_text("utf-8")
