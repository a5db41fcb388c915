import subprocess
from pathlib import Path

import pytest
from pathspec import GitIgnoreSpec


def under_version_control(checkout: Path) -> list[str]:
    """Files that git tracks; in a copy without its repository, those that it would not ignore."""
    if (checkout / ".git").exists():
        done = subprocess.run(["git", "ls-files", "-z"], cwd=checkout, capture_output=True, text=True, check=True)
        return done.stdout.split("\0")
    ignored = GitIgnoreSpec.from_lines((checkout / ".gitignore").read_text("utf-8").splitlines())
    return list(ignored.match_tree_files(checkout, negate=True))


@pytest.fixture(scope="session")
def tracked(checkout: Path) -> list[str]:
    """Files under version control, relative to the checkout, that are there."""
    return sorted(name for name in under_version_control(checkout) if name and (checkout / name).is_file())
