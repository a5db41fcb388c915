"""Every command of ``rptcam`` with its options, as ``--help`` prints them."""

import argparse
import os
from collections.abc import Iterator

from rptcam_cl.cli import build_parser

INTRODUCTION = """# All commands

Which commands and options are there? This page is what `rptcam COMMAND --help` prints.
[Rendering](../render.md) and the pages about lenses, focus and the viewfinder show them at work.
"""


def command_page() -> str:
    """The whole page, one section for each command."""
    os.environ["COLUMNS"] = "100"
    return INTRODUCTION + "".join(section(parser) for parser in commands(build_parser()))


def commands(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    """A parser and those of its subcommands, from the top."""
    yield parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for child in action.choices.values():
                yield from commands(child)


def section(parser: argparse.ArgumentParser) -> str:
    """Help of one command."""
    return f"\n## {parser.prog}\n\n```text\n{parser.format_help()}```\n"
