"""MapLibre GL for the page: npm's package, fetched by npm when a wheel is built.

Nothing of it is kept in the sources.  What npm brings is compared with the digest below and kept
in the user's cache, where a checkout finds it: `python release/maplibre_gl.py` puts it there.
"""

import base64
import hashlib
import io
import shutil
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

VERSION = "5.24.1"
SHA512 = "HyiYBwtsbk3L1n1EPLJHWqdoyMiF80n7tEYXFZyu2m1TjvaNx6KMLiFeDdmszt1/mq2zvsR1TJuX/NMu5BonXQ=="
FILES = {
    "maplibre-gl.js": "package/dist/maplibre-gl.js",
    "maplibre-gl.css": "package/dist/maplibre-gl.css",
    "LICENSE.txt": "package/LICENSE.txt",
}
SECONDS = 30.0  # that npm may take; builds without a connection wait as long


def unpacked(archive: bytes) -> dict[str, bytes]:
    """The files of npm's archive that the page needs.

    Raises:
        ValueError: It is not the archive that was expected.
    """
    digest = base64.b64encode(hashlib.sha512(archive).digest()).decode()
    if digest != SHA512:
        raise ValueError(f"maplibre-gl {VERSION}: the digest is sha512-{digest}, not that expected")
    with tarfile.open(fileobj=io.BytesIO(archive)) as tar:
        found = {}
        for name, place in FILES.items():
            file = tar.extractfile(place)
            if file is None:
                raise ValueError(f"maplibre-gl {VERSION}: {place} is not a file")
            found[name] = file.read()
    return found


def fetched() -> bytes:
    """The archive, by npm.

    Raises:
        OSError: There is no npm, or it brought nothing.
    """
    npm = shutil.which("npm")
    if npm is None:
        raise OSError("npm was not found")
    with tempfile.TemporaryDirectory() as folder:
        try:
            done = subprocess.run(
                [npm, "pack", "--silent", "--fetch-retries=0", f"maplibre-gl@{VERSION}"],
                cwd=folder, capture_output=True, text=True, timeout=SECONDS, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise OSError(f"npm came to no end within {SECONDS:.0f} s") from None
        archives = list(Path(folder).glob("*.tgz"))
        if done.returncode or not archives:
            reason = (done.stderr.strip().splitlines() or ["no archive came"])[-1]
            raise OSError(f"npm pack: {reason}")
        return archives[0].read_bytes()


def bring(folder: Path) -> Path:
    """The folder of the files, fetched unless they are there.

    Args:
        folder: Of all versions.

    Raises:
        OSError: They cannot be had, or written.
        ValueError: What came is not what was expected.
    """
    place = folder / f"maplibre-gl-{VERSION}"
    if not all((place / name).is_file() for name in FILES):
        files = unpacked(fetched())
        place.mkdir(parents=True, exist_ok=True)
        for name, content in files.items():
            part = place / f"{name}.part"
            part.write_bytes(content)
            part.replace(place / name)
    return place


def main() -> None:
    """Put MapLibre where a checkout finds it."""
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "src"))
    from whichroad.page.static_files import kept_folder

    folder = kept_folder()
    if folder is None:
        raise SystemExit("no folder for it can be written; set WHICHROAD_CACHE_DIR")
    try:
        print(bring(folder))
    except (OSError, ValueError) as error:
        raise SystemExit(f"{error}; the extra maplibre brings it too") from None


if __name__ == "__main__":
    main()
