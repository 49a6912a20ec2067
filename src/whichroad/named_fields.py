"""Records of fields by name: one that is written wrongly is refused with the closest names."""

import difflib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from functools import wraps
from typing import Any, TypeVar

from .errors import SettingError

Record = TypeVar("Record", bound=type)


def likely_names(name: str, known: Iterable[str]) -> str:
    """What to do about a name that is not known: the closest ones, or to remove it."""
    close = difflib.get_close_matches(name, list(known), n=3, cutoff=0.5)
    return f"did you mean {' or '.join(close)}?" if close else "remove it"


def by_name(cls: Record, instead: Mapping[str, str] | None = None) -> Record:
    """A record of fields by name, which refuses what is none of them, or of another kind.

    Args:
        cls: A data class.
        instead: What to do about names that are often tried; the closest fields else.
    """
    make: Callable[..., None] = vars(cls)["__init__"]

    @wraps(make)
    def checked(self: Any, *unnamed: Any, **given: Any) -> None:
        try:
            make(self, *unnamed, **given)
        except TypeError:
            raise _refusal(cls, unnamed, given, instead or {}) from None

    type.__setattr__(cls, "__init__", checked)
    return cls


def _refusal(
    cls: type[Any], unnamed: tuple[Any, ...], given: dict[str, Any], instead: Mapping[str, str]
) -> SettingError:
    known = [f.name for f in fields(cls)]
    for name in given:
        if name not in known:
            return SettingError(
                f"{cls.__name__}: {name} is no field of it; its fields by name were expected; "
                f"{instead.get(name) or likely_names(name, known)}"
            )
    seen = ", ".join([*map(repr, unnamed), *(f"{k}={v!r}" for k, v in given.items())])
    return SettingError(
        f"{cls.__name__}: {seen or 'nothing'} was given; its fields by name, each of its kind, "
        f"were expected; see help(whichroad.{cls.__name__})"
    )
