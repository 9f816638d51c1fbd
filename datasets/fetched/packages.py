"""The packages that real shapes come from: their addresses, contents and licences."""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from bench import BadInput, UsageError

from .archives import files_of_deb, files_of_wheel
from .download import Archive, fetch_archive, sha256_of

DOWNLOADS = "downloads"  # in the folder of the data: unfinished downloads, and files put there by hand
CC0 = "https://creativecommons.org/publicdomain/zero/1.0/"
POOL = "pool/main/c/cgal/libcgal-demo_5.5.1-2_all.deb"


@dataclass(frozen=True)
class Package:
    """A published package with meshes in it."""

    archive: Archive
    inside: str  # the common beginning of its files' names
    source: str
    licence: str  # in a line
    notice: str  # in full
    inner: str = ""  # the archive in the archive
    notices: tuple[str, ...] = ()  # files of it that are stored beside the meshes, in full

    def read(self, path: Path, files: Mapping[str, str]) -> Iterator[tuple[str, bytes]]:
        """Those of ``files`` that it contains, and its notices, with their content."""
        wanted = {f"{self.inside}{file}": file for file in files} | {name: Path(name).name for name in self.notices}
        found = files_of_wheel(path, wanted) if path.suffix == ".whl" else files_of_deb(path, wanted, self.inner)
        return ((wanted[name], content) for name, content in found)


PACKAGES = {
    "libcgal-demo": Package(
        archive=Archive(
            name="libcgal-demo_5.5.1-2_all.deb",
            sha256="78b09b23d4d6d1bf15552a1060b419ab3fc09918486462faed197e5fc6ac3735",
            size=24_358_884,
            urls=(
                f"http://deb.debian.org/debian/{POOL}",
                "https://snapshot.debian.org/file/7a59ca34d8b228e381b2c45b4cbcf21066a7b7f1",  # by its SHA-1
                f"https://snapshot.debian.org/archive/debian/20230701T000000Z/{POOL}",
                f"http://archive.debian.org/debian/{POOL}",  # where Debian 12 will be when it is no longer maintained
            ),
            by_hand="apt-get download libcgal-demo=5.5.1-2    # on Debian 12 (bookworm)",
        ),
        inner="usr/share/doc/libcgal-dev/data.tar.gz",
        inside="data/meshes/",
        source="CGAL 5.5.1, data/meshes (Debian's libcgal-demo 5.5.1-2)",
        licence="CC0 1.0 as far as CGAL may give it; the makers of scans ask for more, see LICENCES.txt",
        notice=f"""\
Debian's copyright file for CGAL (libcgal-dev: /usr/share/doc/libcgal-dev/copyright) says: "All other files that do not
have an explicit copyright notice (e.g., all examples and some demos) are licensed under the Creative Commons CC0 1.0
license." The meshes have no notice of their own; see {CC0}.
Neither CGAL nor Debian says who made each mesh. Some are well-known scans: bunny00.off and armadillo.off go back to the
Stanford 3D Scanning Repository (https://graphics.stanford.edu/data/3Dscanrep/), which asks to be credited and
allows research, but no commercial use without its permission. Use the meshes for research, and do not pass them on.
""",
    ),
    "nilearn": Package(
        archive=Archive(
            name="nilearn-0.14.1-py3-none-any.whl",
            sha256="725206484e9fb3f6691f9c2d20204a068759d5072f12055324702ee0cb2bbe8a",
            size=11_509_444,
            urls=(
                "https://files.pythonhosted.org/packages/9e/4f/"
                "6d93620cf4c7f642a8fb85fef8b6e30a24764ef99774026550291dea6fdd/nilearn-0.14.1-py3-none-any.whl",
            ),
            by_hand="pip download --no-deps nilearn==0.14.1",
        ),
        inside="nilearn/datasets/data/fsaverage5/",
        notices=(
            "nilearn-0.14.1.dist-info/licenses/LICENSE",
            "nilearn/datasets/description/fsaverage5.rst",
        ),
        source="fsaverage5 of FreeSurfer (nilearn 0.14.1)",
        licence="nilearn: BSD 3-clause; fsaverage5: FreeSurfer's licence, see LICENCES.txt",
        notice="""\
nilearn is under the BSD 3-clause licence (nilearn/LICENSE). The surfaces in it are FreeSurfer's template fsaverage5;
nilearn's own description of them (fsaverage5.rst) says "License: unknown". FreeSurfer, which distributes the template,
has a licence of its own: https://surfer.nmr.mgh.harvard.edu/fswiki/FreeSurferSoftwareLicense. It asks to cite: Fischl,
Sereno, Tootell and Dale, "High-resolution intersubject averaging and a coordinate system for the cortical surface",
Human Brain Mapping 8, 1999.
""",
    ),
}


def fetch_packages(folder: Path, wanted: Mapping[str, Mapping[str, str]], say: Callable[[str], None]) -> None:
    """Put the wanted files of each package into ``folder/PACKAGE/``, with the terms in ``folder/LICENCES.txt``.

    Files that exist and are right are left as they are. An interrupted download is resumed; an archive that was put by
    hand into ``folder/downloads`` is used, and left there.

    Parameters
    ----------
    folder : Path
    wanted : for each package, the SHA-256 of each file
    say : is called with each line for the user

    Raises
    ------
    UsageError
        Where a package cannot be downloaded, or the folder cannot be written.
    BadInput
        For an archive, or a file in it, that differs from the published one.
    """
    try:
        for name, files in wanted.items():
            _fetch(folder, name, files, say)
        text = "\n".join(f"{name}/  {PACKAGES[name].source}\n\n{PACKAGES[name].notice}" for name in wanted)
        _write(folder / "LICENCES.txt", text.encode())
    except OSError as error:
        raise UsageError(
            f"{error.filename or folder}: {error.strerror or error}; choose another folder with dataset.path=FOLDER"
        ) from error
    say(f"{sum(map(len, wanted.values()))} files in {folder}\n\n{text.rstrip()}\n\n(also in {folder / 'LICENCES.txt'})")


def _fetch(folder: Path, name: str, files: Mapping[str, str], say: Callable[[str], None]) -> None:
    """Fetch one package, unless all its files exist and are right."""
    package, place = PACKAGES[name], folder / name
    missing = {file: sha256 for file, sha256 in files.items() if not _is_right(place / file, sha256)}
    if not missing:
        return
    archive = folder / DOWNLOADS / package.archive.name
    by_hand = archive.exists()
    fetch_archive(package.archive, archive.parent, say)
    for file, content in package.read(archive, missing):
        expected = missing.pop(file, None)
        if expected and hashlib.sha256(content).hexdigest() != expected:
            raise BadInput(f"{archive}: its {file} differs from the published one (expected SHA-256 {expected})")
        _write(place / file, content)
    if missing:
        raise BadInput(f"{archive}: lacks {', '.join(missing)}; expected {package.source}")
    if not by_hand:
        archive.unlink()
        with contextlib.suppress(OSError):  # the folder is not empty
            archive.parent.rmdir()


def _is_right(file: Path, sha256: str) -> bool:
    return file.is_file() and sha256_of(file) == sha256


def _write(file: Path, content: bytes) -> None:
    """Write a file atomically."""
    file.parent.mkdir(parents=True, exist_ok=True)
    temporary = file.with_name(f".{file.name}.{os.getpid()}")
    temporary.write_bytes(content)
    os.replace(temporary, file)
