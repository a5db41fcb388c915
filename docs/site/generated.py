"""Pages that are made when the site is built: the Python interface, the keys of scene files, the command line."""

from docs.site.command_reference import command_page
from docs.site.contents import Nav
from docs.site.key_reference import key_page
from docs.site.python_reference import FOLDER, ROOMS, room_page

COMMANDS, KEYS = "reference/commands.md", "reference/keys.md"
PAGES = {room: f"{FOLDER}/{room or 'rptcam_cl'}.md" for room in ROOMS}
NAV: dict[str, Nav] = {
    "Reference": [
        {"All keys of a scene": KEYS},
        {"All commands": COMMANDS},
        {"Python": [{f"rptcam_cl.{room}".rstrip("."): page} for room, page in PAGES.items()]},
    ]
}


def generated_pages() -> dict[str, str]:
    """Text of every generated page by its place in the site."""
    return {COMMANDS: command_page(), KEYS: key_page()} | {page: room_page(room) for room, page in PAGES.items()}
