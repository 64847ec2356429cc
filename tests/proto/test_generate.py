"""The stubs in the service are those of the protos, and the protos are described to the last field."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from itertools import pairwise

import pytest

from proto.generate import HOMES, PROTO, generate
from tests.conftest import ROOT


@pytest.mark.parametrize("package", HOMES)
def test_the_stubs_generated_again_are_the_same_bytes(package: str) -> None:
    stubs = ROOT.joinpath(*HOMES[package].split("."))
    generated = {path.as_posix(): text.encode() for path, text in generate(package).items()}
    present = {
        path.relative_to(stubs).as_posix(): path.read_bytes()
        for path in (stubs / package).rglob("*.py*")
        if path.name != "__init__.py" and path.suffix != ".pyc"
    }
    assert generated == present


def test_every_field_has_a_comment_above_it() -> None:
    protos = sorted(PROTO.rglob("*.proto"))
    assert protos
    for proto in protos:
        lines = proto.read_text().splitlines()
        for above, line in pairwise(lines):
            if re.search(r"^\s*(message|service|rpc|oneof) | = \d+;$", line):
                assert above.strip().startswith("//"), f"{proto.name}: {line}"
            assert len(line) <= 120, f"{proto.name}: {line}"


@pytest.mark.slow
def test_the_protos_keep_the_rules_of_buf() -> None:
    npm = shutil.which("npm") or pytest.skip("buf comes with npm")
    with tempfile.TemporaryDirectory() as folder:
        install = [npm, "install", "--prefix", folder, "@bufbuild/buf"]
        if subprocess.run(install, capture_output=True, check=False).returncode:
            pytest.skip("buf cannot be installed here")
        buf = f"{folder}/node_modules/.bin/buf"
        for command in (["lint"], ["format", "--diff", "--exit-code"]):
            done = subprocess.run([buf, *command], cwd=ROOT, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stdout + done.stderr
