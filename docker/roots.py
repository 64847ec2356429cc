"""Does what a Dockerfile says, in folders: each stage is the root of a bootstrapped Debian, each RUN a chroot there.

Everything runs in namespaces of its own; nothing stays mounted. Package sources, certificates and pip's settings are
this machine's, and only there while an image is built.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

from dockerfile import Copy, Stage, context, copied, read, variables

ROOT = Path(__file__).resolve().parent.parent
CERTIFICATES = Path("/etc/ssl/certs/ca-certificates.crt")
SLIM = ["usr/share/doc", "usr/share/man", "usr/share/locale", "usr/share/info", "var/cache/apt", "var/lib/apt/lists"]
CLEAN = """# as in Debian's own images
DPkg::Post-Invoke { "rm -f /var/cache/apt/archives/*.deb /var/cache/apt/*.bin || true"; };
APT::Update::Post-Invoke { "rm -f /var/cache/apt/archives/*.deb /var/cache/apt/*.bin || true"; };
Dir::Cache::pkgcache "";
Dir::Cache::srcpkgcache "";
"""


class Image(NamedTuple):
    """An image: the folder that is its root, and its last stage."""

    root: Path
    stage: Stage

    @property
    def user(self) -> str:
        """The user that its containers are, "UID:GID"."""
        return self.stage.said("USER")[-1]


def inside(
    root: Path, user: str, folder: str, environment: dict[str, str], mounts: dict[Path, str], *, read_only: bool = False
) -> list[str]:
    """The words before a command that run it in a root, as init of its own namespaces, and end all that it started.

    Args:
        root: the folder.
        user: "UID:GID".
        folder: to run it in.
        environment: all of its variables.
        mounts: files and folders of this machine, and where they are seen.
        read_only: whether nothing of the root itself may be written.
    """
    there = shlex.quote(str(root))
    steps = [
        "mount --make-rprivate /",
        f"mount --bind {there} {there}",
        f"mount -t proc proc {there}/proc",
        f"mount --rbind /dev {there}/dev",
    ]
    steps.append(f"mount -t tmpfs -o mode=1777 tmpfs {there}/tmp")
    for source, target in mounts.items():
        kind = "mkdir -p" if source.is_dir() else "touch"
        steps.append(f"{kind} {there}{target} && mount --bind {shlex.quote(str(source))} {there}{target}")
    if read_only:
        steps.append(f"mount -o remount,bind,ro {there}")
    given = shlex.join(f"{name}={value}" for name, value in environment.items())
    steps.append(f'exec chroot --userspec={user} {there} env -i {given} sh -c \'cd "$0" && exec "$@"\' {folder} "$@"')
    script = " && ".join(steps)
    return ["unshare", "--mount", "--pid", "--fork", "--kill-child", "sh", "-c", script, "sh"]


def base_of(image: str, work: Path) -> Path:
    """A bootstrapped Debian in place of the image debian:SUITE-slim; made once."""
    suite = re.fullmatch(r"debian:([a-z]+)-slim", image)
    if suite is None:
        raise SystemExit(f"{image} cannot be made here: only debian:SUITE-slim")
    root = work / f"base-{suite[1]}"
    if not (root / "made").exists():
        print(f"==> bootstrapping {image}", flush=True)
        shutil.rmtree(root, ignore_errors=True)
        here = re.search(r"^VERSION_CODENAME=(.*)$", Path("/etc/os-release").read_text(), re.M)
        sources = Path("/etc/apt/sources.list.d/debian.sources").read_text()
        mirror = re.search(r"^URIs: (\S+)", sources, re.M)
        if here is None or mirror is None:
            raise SystemExit(
                "this machine's own Debian packages have no source in /etc/apt/sources.list.d/debian.sources"
            )
        subprocess.run(
            ["debootstrap", "--variant=minbase", suite[1], str(root), mirror[1]], check=True, stdout=subprocess.DEVNULL
        )
        (root / "etc/apt/sources.list").unlink(missing_ok=True)
        (root / "etc/apt/sources.list.d/debian.sources").write_text(sources.replace(here[1], suite[1]))
        (root / "etc/dpkg/dpkg.cfg.d/slim").write_text("".join(f"path-exclude=/{path}/*\n" for path in SLIM[:4]))
        for path in SLIM:
            shutil.rmtree(root / path, ignore_errors=True)
            (root / path).mkdir()
        (root / "etc/apt/apt.conf.d/slim").write_text(CLEAN)
        (root / "etc/resolv.conf").write_text("")
        (root / "made").touch()
    return root


def build(name: str, work: Path) -> Image:
    """Does what a Dockerfile says; returns the image of its last stage."""
    file = ROOT / "docker" / f"{name}.Dockerfile"
    seen = copy_context(file, work / f"{name}-context")
    roots: dict[str, Path] = {}
    stages = read(file)
    for number, stage in enumerate(stages):
        root = work / f"{name}-{stage.name or 'image'}"
        shutil.rmtree(root, ignore_errors=True)
        base = roots.get(stage.base) or base_of(stage.base, work)
        subprocess.run(["cp", "-a", "--reflink=auto", str(base), str(root)], check=True)
        do_stage(stage, root, seen, roots)
        (root / "run/certificates.crt").unlink(missing_ok=True)
        roots[stage.name or str(number)] = root
    return Image(root, stages[-1])


def copy_context(file: Path, folder: Path) -> Path:
    """What the build sees of the repository: files that are in git or would be, without what is ignored."""
    listed = ["git", "-C", str(ROOT), "ls-files", "--cached", "--others", "--exclude-standard"]
    paths = subprocess.run(listed, capture_output=True, text=True, check=True).stdout.splitlines()
    shutil.rmtree(folder, ignore_errors=True)
    for path in context(paths, file.with_name(f"{file.name}.dockerignore").read_text()):
        if (ROOT / path).is_file():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / path, folder / path)
    return folder


def do_stage(stage: Stage, root: Path, seen: Path, roots: dict[str, Path]) -> None:
    """Does the steps of a stage in its root."""
    user, folder = "0:0", "/"
    environment = {"PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin", "HOME": "/root"}
    ours = {name: value for name, value in os.environ.items() if name.startswith("PIP_") and name != "PIP_FIND_LINKS"}
    ours |= {"PIP_CERT": "/run/certificates.crt", "DEBIAN_FRONTEND": "noninteractive"}
    mounts = {CERTIFICATES: "/run/certificates.crt", Path("/etc/resolv.conf").resolve(): "/etc/resolv.conf"}
    for step in stage.steps:
        match step.word:
            case "ENV":
                environment |= variables(step.rest)
            case "USER":
                user = step.rest
                environment["HOME"] = home_of(user, root)
            case "WORKDIR":
                folder = step.rest
                (root / folder.lstrip("/")).mkdir(parents=True, exist_ok=True)
            case "COPY":
                copy(copied(step.rest), root, folder, seen, roots)
            case "RUN":
                print(f"==> RUN {step.rest[:150]}", flush=True)
                words = inside(root, user, folder, ours | environment, mounts)
                with (root.parent / f"{root.name}.log").open("ab") as log:
                    done = subprocess.run([*words, "/bin/sh", "-c", step.rest], stdout=log, stderr=log, check=False)
                if done.returncode:
                    raise SystemExit(f"failed ({done.returncode}): {step.rest}\nsee {root}.log")


def home_of(user: str, root: Path) -> str:
    """The home folder of a user, "UID:GID"."""
    entries = [line.split(":") for line in (root / "etc/passwd").read_text().splitlines()]
    return next(entry[5] for entry in entries if entry[2] == user.partition(":")[0])


def copy(said: Copy, root: Path, folder: str, seen: Path, roots: dict[str, Path]) -> None:
    """Does a COPY: files into a folder, or the content of a folder into another."""
    place = root / os.path.join(folder, said.target).lstrip("/")
    for source in said.sources:
        path = (roots[said.stage] if said.stage else seen) / source.lstrip("/")
        if path.is_dir():
            place.mkdir(parents=True, exist_ok=True)
            subprocess.run(["cp", "-a", f"{path}/.", str(place)], check=True)
        elif said.target.endswith("/") or len(said.sources) > 1:
            place.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, place / path.name)
        else:
            shutil.copy(path, place)
