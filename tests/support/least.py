"""Print the least of each package that users of pyproject.toml may have, for pip: `make least` runs the tests so."""

import re
import tomllib
from pathlib import Path

PROJECT = tomllib.loads(Path("pyproject.toml").read_text("utf-8"))["project"]
TOOLS = ("test", "dev", "bench")
extras = [each for name, some in PROJECT["optional-dependencies"].items() if name not in TOOLS for each in some]
found = [re.fullmatch(r"([\w.-]+)>=([\w.]+)", each) for each in (*PROJECT["dependencies"], *extras)]
print(*(f"{each[1]}=={each[2]}" + ("" if each[2][-2:-1] == "a" else ".*") for each in found if each))
