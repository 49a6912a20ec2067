"""Files and folders of many trips, and what else comes in batches, as Arrow reads them."""

from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

from ..errors import ReadError, first_line

if TYPE_CHECKING:
    import pyarrow.dataset as ds

_FILES = {".parquet": "parquet", ".geoparquet": "parquet", ".pq": "parquet", ".arrow": "ipc",
          ".feather": "ipc", ".ipc": "ipc"}  # fmt: skip


def is_dataset(path: Path) -> bool:
    """Whether this is a folder, or a file that is read as a stream of trips."""
    return path.is_dir() or path.suffix.lower() in _FILES


def dataset_of(path: Path) -> "ds.Dataset":
    """A Parquet or Arrow file, or a folder of Parquet files.

    Of a folder whose parts bear values (`trip_id=v1/part.parquet`) these are columns of text.

    Raises:
        ReadError: It cannot be read as such.
    """
    import pyarrow as pa
    import pyarrow.dataset as ds

    kind = "parquet" if path.is_dir() else _FILES.get(path.suffix.lower())
    if kind is None:
        raise ReadError(
            f"{path}: a file of this kind is not read as a stream of trips; .parquet or .arrow "
            "was expected; read_drive takes the others"
        )
    try:
        data = ds.dataset(path, format=kind)
        names = dict.fromkeys(name for file in data.files for name in _keys(Path(file), path))
        told = [name for name in names if name not in data.schema.names]
        if not told:
            return data
        parts = pa.schema([(name, pa.string()) for name in told])
        return ds.dataset(path, format=kind, partitioning=ds.partitioning(parts, flavor="hive"))
    except (pa.ArrowException, OSError) as error:
        raise ReadError(f"{path}: cannot be read as {kind} ({first_line(error)})") from None


def is_partitioned(path: Path) -> bool:
    """Whether folders within a folder bear values."""
    return path.is_dir() and any(part.is_dir() and "=" in part.name for part in path.iterdir())


def _keys(file: Path, folder: Path) -> list[str]:
    """The names of the values that the folders of a file bear, below one folder."""
    if not file.is_relative_to(folder):
        return []
    parents = file.relative_to(folder).parts[:-1]
    return [unquote(part.partition("=")[0]) for part in parents if "=" in part]


def in_batches(source: Any) -> Any:
    """Anything with a stream of Arrow as a reader of batches; other things as they are."""
    import pyarrow as pa

    if is_scanner(source):
        return source.to_reader()
    if hasattr(source, "__arrow_c_stream__"):
        return pa.RecordBatchReader.from_stream(source)
    return source


def is_scanner(source: Any) -> bool:
    """Whether this is a scanner of a dataset."""
    return hasattr(source, "to_reader") and hasattr(source, "projected_schema")
