"""A wheel with more in it than setuptools puts there: kernels, and what the page needs."""

import base64
import hashlib
import sysconfig
import zipfile
from pathlib import Path

from . import cache

_FOLDER = "whichroad/native"
TAGS = {  # of libraries that are linked for old systems
    "linux-x86_64": "manylinux_2_17_x86_64.manylinux2014_x86_64",
    "linux-aarch64": "manylinux_2_17_aarch64.manylinux2014_aarch64",
    "macos-arm64": "macosx_11_0_arm64",
    "windows-x86_64": "win_amd64",
}


def own_tag() -> str:
    """The tag of what was built for this machine alone."""
    return sysconfig.get_platform().replace("-", "_").replace(".", "_")


def with_library(pure: Path, library: Path, platform: str, folder: Path) -> Path:
    """A wheel of a platform: the pure one, a library, and what says so.

    Args:
        pure: The wheel without a library, of any platform and Python 3.
        library: The library of kernels; its name tells the kind of processor, as in the cache.
        platform: The wheel's platform tag; more than one with dots between.
        folder: Where the new wheel goes.

    Returns:
        Its path.
    """
    name, version, *_ = pure.stem.split("-")
    kind = "-".join(filter(None, ["kernels", cache.processor_of(library)]))
    return _rewritten(
        pure,
        folder / f"{name}-{version}-py3-none-{platform}.whl",
        {f"{_FOLDER}/{kind}{library.suffix}": (library.read_bytes(), 0o755)},
        platform,
    )


def with_files(wheel: Path, files: dict[str, bytes]) -> None:
    """Add files to a wheel.

    Args:
        wheel: It is replaced.
        files: Places in it, and contents.
    """
    whole = wheel.with_suffix(".part")
    _rewritten(wheel, whole, {place: (content, 0o644) for place, content in files.items()})
    whole.replace(wheel)


def _rewritten(
    pure: Path, target: Path, more: dict[str, tuple[bytes, int]], platform: str | None = None
) -> Path:
    """A wheel with more files (contents and modes), and of a platform where one is given."""
    name, version, *_ = pure.stem.split("-")
    about = f"{name}-{version}.dist-info"
    rows = []
    with zipfile.ZipFile(pure) as old, zipfile.ZipFile(target, "w") as new:

        def add(path: str, content: bytes, mode: int = 0o644) -> None:
            entry = zipfile.ZipInfo(path)  # of 1980: the same files give the same wheel
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, mode << 16
            new.writestr(entry, content)
            digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=")
            rows.append(f"{path},sha256={digest.decode()},{len(content)}")

        for item in old.infolist():
            content = old.read(item)
            if item.filename == f"{about}/WHEEL" and platform is not None:
                content = _tagged(content.decode(), platform).encode()
            if item.filename != f"{about}/RECORD" and not item.is_dir():
                add(item.filename, content, item.external_attr >> 16 or 0o644)
        for place, (content, mode) in more.items():
            add(place, content, mode)
        rows.append(f"{about}/RECORD,,")
        record = zipfile.ZipInfo(f"{about}/RECORD")
        record.compress_type, record.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
        new.writestr(record, "\n".join(rows) + "\n")
    return target


def _tagged(text: str, platform: str) -> str:
    """The file WHEEL of a wheel that holds machine code for a platform."""
    lines = [line for line in text.splitlines() if not line.startswith(("Tag:", "Root-Is-Pure"))]
    lines = [line for line in lines if line.strip()]
    tags = [f"Tag: py3-none-{one}" for one in platform.split(".")]
    return "\n".join([*lines, "Root-Is-Purelib: false", *tags]) + "\n"
