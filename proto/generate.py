"""Writes the Python stubs of the protos anew: `python proto/generate.py`. grpcio-tools brings protoc."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from importlib.resources import files
from pathlib import Path

PROTO = Path(__file__).resolve().parent
HOMES = {
    "shapeconcepts": "service.transports.grpc.generated",
    "inference": "service.transports.open_inference.generated",
}


def generate(package: str) -> dict[Path, str]:
    """The stubs of the protos in a folder beside this file, by their paths below that folder's parent.

    protoc takes folders of protos for top-level packages of Python, but ours live inside the service.
    """
    protos = sorted(str(path.relative_to(PROTO)) for path in (PROTO / package).rglob("*.proto"))
    with tempfile.TemporaryDirectory() as folder:
        includes = [f"-I{PROTO}", f"-I{files('grpc_tools') / '_proto'}"]
        outputs = [f"--{kind}_out={folder}" for kind in ("python", "pyi", "grpc_python")]
        subprocess.run([sys.executable, "-m", "grpc_tools.protoc", *includes, *outputs, *protos], check=True)
        written = {path.relative_to(folder): path.read_text() for path in Path(folder).rglob("*.py*")}
    imports = re.compile(rf"^from {package}\b", re.MULTILINE)
    return {
        path: imports.sub(f"from {HOMES[package]}.{package}", text)
        for path, text in written.items()
        if not path.stem.endswith("_grpc") or "Servicer" in text  # protos without a service give empty ones
    }


def main() -> None:
    """Writes them where the service imports them from."""
    for package, home in HOMES.items():
        for path, text in generate(package).items():
            PROTO.parent.joinpath(*home.split("."), path).write_text(text)


if __name__ == "__main__":
    main()
