import subprocess
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def tracked(checkout: Path) -> list[str]:
    """Files under version control, relative to the checkout, that are there."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=checkout, capture_output=True, text=True, check=True).stdout
    return [name for name in listed.split("\0") if name and (checkout / name).is_file()]
