"""The documentation as a site: its contents, its links and its generated pages; it builds strictly."""

import ast
import importlib.util
import inspect
import json
import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from functools import partial
from html.parser import HTMLParser
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import unquote

import pytest
from PIL import Image
from playwright.sync_api import Browser

import rptcam_cl
from docs.site.contents import Nav, linked, nav_of, slug, spaced
from docs.site.docstrings import as_markdown
from docs.site.generated import NAV, PAGES
from docs.site.key_reference import key_page
from docs.site.python_reference import (
    PROPERTIES,
    ROOMS,
    examples,
    module_of,
    modules_of,
    public_names,
    room_page,
    signature,
)
from examples.show_keys import models
from rptcam_cl.scene.load import scene_json_schema
from tests.support.browsing import chromium, needs_chromium
from tests.support.pages import all_blocks


def pages_of(nav: Nav) -> Iterator[str]:
    """Every page of the contents, in their order."""
    for entry in nav:
        for place in entry.values():
            if isinstance(place, str):
                yield place
            else:
                yield from pages_of(place)


def test_contents_have_the_four_kinds_of_pages_and_every_page_once(checkout: Path) -> None:
    nav = nav_of((checkout / "docs" / "index.md").read_text("utf-8"), NAV)
    assert [next(iter(entry)) for entry in nav] == [
        "Contents", "Tutorial", "How-to", "Reference", "Explanation", "Project",
    ]  # fmt: skip
    found = list(pages_of(nav))
    assert len(found) == len(set(found))
    assert {path.name for path in (checkout / "docs").glob("*.md")} | {*PAGES.values()} <= {*found}


@pytest.fixture(scope="module")
def site(checkout: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site as `make docs` builds it: a warning is an error (with --quiet mkdocs would not count any)."""
    if importlib.util.find_spec("material") is None:
        pytest.skip("mkdocs-material is not installed; the extra docs brings it")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    done = subprocess.run(command, cwd=checkout, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


class Addresses(HTMLParser):
    """What a page links to, what it loads, and the names of its parts."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.links: set[str] = set()
        self.loads: set[str] = set()
        self.names: set[str] = set()
        self.feed(page.read_text("utf-8"))

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        for name, value in attributes:
            if name in ("src", "srcset", "poster", "data", "href", "xlink:href"):
                (self.links if tag == "a" else self.loads).add(value or "")
            elif name == "id":
                self.names.add(value or "")


@pytest.mark.slow
def test_site_builds_without_a_warning_and_finds_keys_names_and_options(site: Path) -> None:
    texts = json.loads((site / "search" / "search_index.json").read_text("utf-8"))["docs"]
    found = " ".join(item["title"] + " " + item["text"] for item in texts)
    assert all(word in found for word in ("pixel_pitch_um", "best_film_distance", "--best-focus-field", "Veach"))
    assert "tutorial.html" in Addresses(site / "index.html").links


@pytest.mark.slow
def test_pages_load_nothing_from_another_host_and_their_links_lead_somewhere(site: Path) -> None:
    # 404.html is for servers: it stands at any address, so its own are absolute.
    pages = {page: Addresses(page) for page in site.rglob("*.html") if page != site / "404.html"}
    assert len(pages) > 60
    foreign = {address for page in pages.values() for address in page.loads if re.match(r"https?:|//", address)}
    texts = [path.read_text("utf-8") for path in (*site.rglob("*.css"), *pages)]
    foreign |= {found for text in texts for found in re.findall(r"(?:url\(|@import)[\s\"']*(?:https?:)?//[^)]*", text)}
    assert foreign == set()
    broken = []
    for page, addresses in pages.items():
        for address in addresses.links | addresses.loads:
            if not re.match(r"\w+:", address):
                place, _, name = unquote(address).partition("#")
                target = (page.parent / place).resolve() if place else page
                if not target.is_file() or (name and target in pages and name not in pages[target].names):
                    broken.append((str(page.relative_to(site)), address))
    assert broken == []


@pytest.mark.slow
@needs_chromium
def test_search_finds_words_from_the_folder_without_a_network_and_over_http(site: Path) -> None:
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(SimpleHTTPRequestHandler, directory=str(site)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        with chromium() as browser:
            from_folder = hits(browser, site.as_uri(), "vignetting", offline=True)
            assert "vignetting_table" in from_folder
            assert hits(browser, f"http://127.0.0.1:{server.server_port}", "vignetting", offline=False) == from_folder
    finally:
        server.shutdown()
        server.server_close()


def hits(browser: Browser, root: str, query: str, *, offline: bool) -> list[str]:
    """Headings of what the search finds from a page below the top; that all of it comes from the site is checked."""
    page = browser.new_context(offline=offline).new_page()
    requests: list[str] = []
    complaints: list[str] = []
    page.on("request", lambda request: requests.append(request.url))
    page.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda problem: complaints.append(str(problem)))
    page.goto(f"{root}/reference/commands.html")
    page.click(".md-search__input")
    page.keyboard.type(query)
    page.wait_for_selector(".md-search-result__item")
    found = page.locator(".md-search-result__item :is(h1, h2)").all_inner_texts()
    # the first of all may be a page whose head has not the word, only its sections
    page.locator(".md-search-result__item a", has_text=query).first.click()
    page.wait_for_selector("mark")  # the word, on its page
    assert complaints == []
    assert [url for url in requests if not url.startswith((f"{root}/", "about:", "data:"))] == []
    return found


def test_links_lead_to_pages_of_the_site() -> None:
    assert (
        linked("docs/layers.md", "[a](../README.md) [b](lenses.md#coatings)") == "[a](index.md) [b](lenses.md#coatings)"
    )
    assert linked("docs/layers.md", "[a](../examples/README.md)") == "[a](examples/README.md)"
    assert (
        linked("examples/README.md", "[a](../docs/images/x.png) [b](studio)")
        == "[a](../images/x.png) [b](studio/index.md)"
    )
    assert linked("docs/scene.md", "[a](#noise-1) [b](https://a.org/x)") == "[a](#noise_1) [b](https://a.org/x)"
    assert linked("docs/python-examples.md", "[a](layers.md#x) [b](#rooms)", "reference/python") == (
        "[a](../../layers.md#x) [b](../../python-examples.md#rooms)"
    )
    assert linked("docs/layers.md", "```text\n[a](../README.md)\n```") == "```text\n[a](../README.md)\n```"


def test_headings_are_named_as_on_github_and_lists_begin_after_an_empty_line() -> None:
    assert slug("What is `checked`, and how fast?") == "what-is-checked-and-how-fast"
    assert spaced("text\n- one\n- two\n\n```text\na\n- b\n```\n") == "text\n\n- one\n- two\n\n```text\na\n- b\n```\n"


@pytest.mark.slow
def test_every_key_of_a_scene_stands_on_the_page_of_keys() -> None:
    page = key_page()
    for name, part in scene_json_schema()["$defs"].items():
        missing = [key for key in part["properties"] if f"| `{key}` |" not in page]
        assert missing == [], name
    assert "| `resolution` | Width and height of the whole film [pixels]; fewer than 2^31 pixels together. |" in page


def test_every_name_of_the_package_has_a_program_and_so_has_every_room() -> None:
    assert {*rptcam_cl.__all__} - {*examples()} == set()
    assert {f"rptcam_cl.{room}" for room in ROOMS if room} - {*examples()} == set()
    assert all("```python" in text for text in examples().values())


def test_every_kind_of_shape_material_light_and_camera_has_its_picture(checkout: Path) -> None:
    parts = {name: part["properties"] for name, part in scene_json_schema()["$defs"].items()}
    chosen = {name for name, keys in parts.items() if any("const" in keys.get(key, {}) for key in ("kind", "shape"))}
    assert len(chosen) > 40 and chosen == models()
    page = key_page()
    for name in chosen:
        assert page.count(f"](../images/keys/{name}.jpg)") == 2, name  # in the overview, and beside its keys
        with Image.open(checkout / "docs" / "images" / "keys" / f"{name}.jpg") as picture:
            assert picture.width == 240


SERVED_INSIDE = {
    "keep_for_next_frame",
    "is_carried_out",
    "relieve",
    "denoised_later",
    "lights",
    "light_groups",
    "sketch_of_ghosts",
}  # autofocus calls the first, the viewfinder others


def test_programs_use_every_member_of_the_results_and_every_argument_of_render() -> None:
    trees = [ast.parse(block.text) for block in all_blocks("python")]
    nodes = [node for tree in trees for node in ast.walk(tree)]
    used = {node.attr for node in nodes if isinstance(node, ast.Attribute)}
    arguments = {node.arg for node in nodes if isinstance(node, ast.keyword)} | {"scene"}
    settings = [node.keys for node in nodes if isinstance(node, ast.Dict)]  # of **settings
    arguments |= {key.value for keys in settings for key in keys if isinstance(key, ast.Constant)}
    for kind in ("Change", "FocusReport", "Frame", "Image", "Progress", "RenderSession"):
        members = vars(getattr(rptcam_cl, kind)).items()
        public = {
            name for name, member in members if name[0] != "_" and (callable(member) or isinstance(member, PROPERTIES))
        }
        assert public - used - SERVED_INSIDE == set(), kind
    assert inspect.signature(rptcam_cl.render).parameters.keys() - arguments == set()


@pytest.mark.parametrize("room", ROOMS)
def test_every_function_and_class_of_a_room_is_described(room: str) -> None:
    module = module_of(room)
    places = [(module, name) for name in module.__all__] if not room else [
        (each, name) for each in modules_of(module) for name in public_names(each)
    ]  # fmt: skip
    values = {name: getattr(each, name) for each, name in places}
    assert len(values) > 2
    described = {name: value for name, value in values.items() if inspect.isfunction(value) or inspect.isclass(value)}
    assert [name for name, value in described.items() if not inspect.getdoc(value)] == []


def test_page_of_the_package_has_signatures_units_and_errors() -> None:
    page = room_page("")
    assert [name for name in rptcam_cl.__all__ if f"\n## {name}\n" not in page] == []
    assert "    seconds: float | None = None,\n" in page
    assert "- `seconds`: Time to render [s]; the picture ends after whole samples, at least one." in page
    assert "- `DeviceError`: No device fits, or a kernel failed." in page
    assert "[layers.md](../../layers.md)" in page


def test_docstrings_and_signatures_are_written_as_pages_have_them() -> None:
    def called(first: int, *, second: str = "x", **more: float) -> None:
        """Do it with ``first``, see docs/layers.md.

        Parameters
        ----------
        first : int
            How many [mm].
        """

    assert signature("called", called) == "called(first: int, *, second: str = 'x', **more: float) -> None"
    assert as_markdown(inspect.getdoc(called) or "") == (
        "Do it with `first`, see [layers.md](../../layers.md).\n\n**Parameters**\n\n- `first` (int): How many [mm]."
    )
