"""What mkdocs does for this site beyond reading docs: generated pages, pages from beside docs, GitHub's links."""

import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from mkdocs.structure.files import File, Files  # noqa: E402

from docs.site import contents  # noqa: E402
from docs.site.generated import NAV, generated_pages  # noqa: E402

PLACES: dict[str, str] = {}  # page of the site: its file in the checkout


def on_config(config: Any) -> Any:
    """Take the contents from docs/index.md, and name headings as GitHub does."""
    config.nav = contents.nav_of((ROOT / "docs" / "index.md").read_text("utf-8"), NAV)
    config.mdx_configs["toc"]["slugify"] = lambda heading, separator: contents.slug(heading)
    return config


def on_files(files: Files, config: Any) -> Files:
    """Add the generated pages, and whatever pages link to beside docs."""
    for name, text in generated_pages().items():
        files.append(File.generated(config, name, content=text))
    ahead = [f"docs/{file.src_uri}" for file in files.documentation_pages() if file.generated_by is None]
    PLACES.update({contents.in_site(page): page for page in ahead})
    while ahead:
        page = ahead.pop()
        for path in contents.targets(page, (ROOT / page).read_text("utf-8")):
            place = contents.in_site(path)
            if path.startswith("docs/") or place in PLACES or not (ROOT / path).exists() or place == "index.md":
                continue
            PLACES[place] = path
            if (ROOT / path).is_dir():
                files.append(File.generated(config, f"{path}/index.md", content=listing(path)))
            else:
                files.append(File.generated(config, place, abs_src_path=str(ROOT / path)))
                if path.endswith(".md"):
                    ahead.append(path)
    return files


def listing(folder: str) -> str:
    """A page that names the files of a folder."""
    names = sorted(path.name for path in (ROOT / folder).iterdir() if path.name[0] not in "._")
    return f"# Files in {folder}\n\n" + "".join(f"- `{name}`\n" for name in names)


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Lead links to the pages of the site, and let lists and tables begin as on GitHub."""
    place = PLACES.get(page.file.src_uri)
    return contents.spaced(contents.linked(place, markdown) if place else markdown)
