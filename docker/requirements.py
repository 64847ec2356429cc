"""Prints what the project requires, with the extras that are named: `python requirements.py jobs traces`.

The images install it before the source is there, so that a change of the source does not fetch the libraries again.
"""

from __future__ import annotations

import sys
import tomllib

with open("pyproject.toml", "rb") as file:
    project = tomllib.load(file)["project"]
print(*project["dependencies"], sep="\n")
for extra in sys.argv[1:]:
    print(*project["optional-dependencies"][extra], sep="\n")
