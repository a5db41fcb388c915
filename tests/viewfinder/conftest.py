"""A browser before the viewfinder of an example, for tests of the page."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

from rptcam_cl.viewfinder.engine import Viewfinder
from tests.support.browsing import chromium, served, settled, until, visited

SIZE = (320, 180)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as found:
        yield found


@pytest.fixture(scope="module")
def scene_file(checkout: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example, with fewer samples."""
    text = (checkout / "examples" / "first_light.yaml").read_text("utf-8")
    file = tmp_path_factory.mktemp("scene") / "first_light.yaml"
    file.write_text(text.replace("spp: 256", "spp: 16"), "utf-8")
    swapped = "".join(f"{b} {g} {r}\n" for b in (0, 1) for g in (0, 1) for r in (0, 1))  # red and blue
    (file.parent / "swapped.cube").write_text(f"LUT_3D_SIZE 2\n{swapped}", "utf-8")
    return file


@pytest.fixture(scope="module")
def viewing(scene_file: Path) -> Iterator[tuple[Viewfinder, str]]:
    with served(scene_file, size=SIZE) as found:
        yield found


@pytest.fixture
def finder(viewing: tuple[Viewfinder, str]) -> Viewfinder:
    return viewing[0]


@pytest.fixture(scope="module")
def address(viewing: tuple[Viewfinder, str]) -> str:
    return viewing[1]


@pytest.fixture
def page(browser: Browser, address: str) -> Iterator[Page]:
    with visited(browser, address) as found:
        settled(found)
        yield found
        found.evaluate("window.sent = []")
        found.click("[data-tab=out]")
        found.click("[data-name=reset]")
        until(found, "window.sent.some((each) => each.type === 'reset')")
        found.wait_for_timeout(200)
