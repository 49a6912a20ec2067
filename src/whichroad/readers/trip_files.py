"""Files and folders of many trips, and what else comes in batches, as Arrow reads them."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import ReadError, first_line
from .checks import listed
from .mixed_files import MixedFiles, Own, keys_of, layout_of, whole_of, with_trip

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.dataset as ds

_FILES = {".parquet": "parquet", ".geoparquet": "parquet", ".pq": "parquet", ".arrow": "ipc",
          ".feather": "ipc", ".ipc": "ipc"}  # fmt: skip
_OTHERS = (".csv", ".csv.gz", ".tsv", ".arrow", ".feather", ".ipc")  # may hold trips, too
_NONE: Own = {}
_MOST_NAMED = 10  # files in an error


def is_dataset(path: Path) -> bool:
    """Whether this is a folder, or a file that is read as a stream of trips."""
    return path.is_dir() or path.suffix.lower() in _FILES


def dataset_of(
    path: Path, skipped: list[str] | None = None, *, own: Own = _NONE, trip: str = "drive_id"
) -> "ds.Dataset | MixedFiles":
    """A Parquet or Arrow file, or the Parquet files of a folder with all of their columns.

    Of a folder whose parts bear values (`trip_id=v1/part.parquet`) these are columns of text.

    Args:
        path: The file or folder.
        skipped: Where to say which files of a folder were left out; None: one that cannot be
            read is an error.
        own: Own names of columns.
        trip: The column that names trips; "drive_id": the usual ones.

    Raises:
        ReadError: It cannot be read as such.
    """
    import pyarrow as pa
    import pyarrow.dataset as ds

    kind = "parquet" if path.is_dir() else _FILES.get(path.suffix.lower())
    if kind is None:
        text = path.name.lower().endswith((".csv", ".csv.gz", ".tsv", ".txt"))
        how = (
            "read it by pandas.read_csv and give the table, or match it by `whichroad fleet`"
            if text else "read_drive and match take the others, where each file is a drive"
        )  # fmt: skip
        raise ReadError(
            f"{path}: a file of this kind is not read as a stream of trips; .parquet or .arrow "
            f"was expected; {how}"
        )
    try:
        if not path.is_dir():
            return ds.dataset(path, format=kind)
        schemas = _readable(_parquet_files(path, skipped), skipped)
        if are_mixed(schemas, own, trip):
            return MixedFiles(schemas, kind, own, trip, below=path)
        schema = joined_schema(schemas.values())
        names = dict.fromkeys(name for file in schemas for name in keys_of(file, path))
        parts = [pa.field(name, pa.string()) for name in names if name not in schema.names]
        for part in parts:
            schema = schema.append(part)
        return ds.dataset(
            [str(file) for file in schemas], schema, format=kind, partition_base_dir=str(path),
            partitioning=ds.partitioning(pa.schema(parts), flavor="hive") if parts else None,
        )  # fmt: skip
    except (pa.ArrowException, OSError) as error:
        raise ReadError(f"{path}: cannot be read as {kind} ({first_line(error)})") from None


def _parquet_files(folder: Path, skipped: list[str] | None) -> list[Path]:
    """The Parquet files of a folder; hidden ones (`_SUCCESS`) are left out, and other kinds.

    Raises:
        ReadError: There is none, or tables of trips of other kinds are among them.
    """
    from pyarrow import fs

    found = fs.LocalFileSystem().get_file_info(fs.FileSelector(str(folder), recursive=True))
    paths = sorted(Path(one.path) for one in found if one.is_file)
    seen = [p for p in paths if not any(n[0] in "._" for n in p.relative_to(folder).parts)]
    files = [path for path in seen if _FILES.get(path.suffix.lower()) == "parquet"]
    if not files:
        raise ReadError(f"{folder}: no .parquet file is in it; at least one was expected")
    tables = [path.name for path in seen if path.name.lower().endswith(_OTHERS)]
    if tables:
        raise ReadError(
            f"{folder}: {listed(tables, _MOST_NAMED)} in it may hold trips, too; Parquet files "
            "alone were expected; `whichroad fleet` reads all kinds together"
        )
    others = [path.name for path in seen if path not in set(files)]
    if skipped is not None and others:
        skipped.append(f"{listed(others, _MOST_NAMED)}: no .parquet file")
    return files


def are_mixed(schemas: "Mapping[Path, pa.Schema]", own: Own, trip: str) -> bool:
    """Whether files write times or places in several ways, or name columns differently.

    Raises:
        ReadError: They cannot be read together.
    """
    own = with_trip(own, trip)
    different: dict[tuple[str, ...], tuple[Path, pa.Schema]] = {}
    for path, one in schemas.items():
        key = (str(one.remove_metadata()), str(one.metadata or ""))
        different.setdefault(key, (path, one))
    layouts = [layout_of(one, own, str(path)) for path, one in different.values()]
    return whole_of(layouts, own) is not None


def _readable(files: Sequence[Path], skipped: list[str] | None) -> "dict[Path, pa.Schema]":
    """Those of the Parquet files that can be read, and their columns."""
    schemas, unread = schemas_of(files, "parquet")
    if unread and (skipped is None or not schemas):
        raise ReadError(unreadable(unread))
    if skipped is not None:
        skipped += [f"{path.name}: cannot be read ({why})" for path, why in unread]
    return schemas


def schemas_of(
    files: Iterable[Path], kind: str
) -> "tuple[dict[Path, pa.Schema], list[tuple[Path, str]]]":
    """The columns of each file, and the files that cannot be read, with the reason."""
    import pyarrow as pa

    schemas, unread = {}, []
    for path in files:
        try:
            schemas[path] = _schema_of(path, kind)
        except (pa.ArrowException, OSError) as error:
            unread.append((path, first_line(error)))
    return schemas, unread


def _schema_of(path: Path, kind: str) -> "pa.Schema":
    if kind == "parquet":
        import pyarrow.parquet as pq

        return pq.read_schema(path)
    import pyarrow.dataset as ds  # it brings pandas, which takes long

    return ds.dataset(path, format=kind).schema


def unreadable(unread: Sequence[tuple[Path, str]]) -> str:
    """The message of an error: which files cannot be read, and why."""
    named = ", ".join(f"{path}: cannot be read ({why})" for path, why in unread[:_MOST_NAMED])
    more = f", and {len(unread) - _MOST_NAMED:,} more" if len(unread) > _MOST_NAMED else ""
    number = f"{len(unread):,} files: " if len(unread) > 1 else ""
    return f"{number}{named}{more}; sound files were expected; write them again or take them away"


def joined_schema(schemas: "Iterable[pa.Schema]") -> "pa.Schema":
    """All columns, those of the first table first; each has a type that holds all of its own."""
    import pyarrow as pa

    first, *others = schemas
    fields = {field.name: field for field in first}
    for schema in others:
        if schema.equals(first):
            continue
        for field in schema:
            known = fields.setdefault(field.name, field)
            if known.type != field.type:
                both = [pa.schema([known.remove_metadata()]), pa.schema([field.remove_metadata()])]
                try:
                    wide = pa.unify_schemas(both, promote_options="permissive")
                except pa.ArrowException:  # reading will tell whether the first's type will do
                    continue
                fields[field.name] = known.with_type(wide.field(0).type)
    return pa.schema(list(fields.values()), first.metadata)


def batches_in(data: "ds.Dataset", columns: list[str], rows: int) -> "Iterator[pa.RecordBatch]":
    """Record batches of up to so many rows.

    Raises:
        ReadError: A file cannot be read to its end.
    """
    import pyarrow as pa

    try:
        yield from data.to_batches(
            columns=columns, batch_size=rows, batch_readahead=1, fragment_readahead=1
        )
    except (pa.ArrowException, OSError) as error:
        where = next((f.path for f in data.get_fragments() if not _is_sound(f, data, columns)), "")
        raise ReadError(
            f"{where or 'table'}: cannot be read to its end ({first_line(error)}); sound files "
            "with columns of one kind were expected; write it again"
        ) from None


def _is_sound(fragment: Any, data: "ds.Dataset", columns: list[str]) -> bool:
    """Whether a file of a dataset can be read, or cannot be named."""
    import pyarrow as pa

    try:
        for _ in fragment.to_batches(schema=data.schema, columns=columns):
            pass
    except (pa.ArrowException, OSError):
        return not hasattr(fragment, "path")
    return True


def is_partitioned(path: Path) -> bool:
    """Whether folders within a folder bear values."""
    return path.is_dir() and any(part.is_dir() and "=" in part.name for part in path.iterdir())


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
