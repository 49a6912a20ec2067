"""What a library needs of the system that loads it: read from ELF, Mach-O and PE files.

python release/imports.py kernels.so kernels.dylib kernels.dll
"""

import struct
import sys
from dataclasses import dataclass, field
from pathlib import Path


@dataclass
class Needs:
    """What a library asks for."""

    kind: str  # "ELF x86_64"
    libraries: list[str] = field(default_factory=list)
    symbols: list[str] = field(default_factory=list)  # "exp@GLIBC_2.2.5"
    signed: bool = False  # by a code signature, if only an ad-hoc one


def needs_of(content: bytes) -> Needs:
    """What a library asks for.

    Raises:
        ValueError: It is of no format that is known here.
    """
    if content[:4] == b"\x7fELF":
        return _elf(content)
    if content[:4] == b"\xcf\xfa\xed\xfe":
        return _macho(content)
    if content[:2] == b"MZ":
        return _pe(content)
    raise ValueError("neither ELF nor Mach-O nor PE, of 64 bits and little-endian")


def _text(content: bytes, at: int) -> str:
    return content[at : content.index(b"\0", at)].decode()


def _elf(content: bytes) -> Needs:
    machine = {62: "x86_64", 183: "aarch64"}.get(struct.unpack_from("<H", content, 18)[0], "?")
    (start,) = struct.unpack_from("<Q", content, 40)
    size, count = struct.unpack_from("<HH", content, 58)
    sections = [struct.unpack_from("<IIQQQQIIQQ", content, start + size * i) for i in range(count)]
    needs = Needs(f"ELF {machine}")
    of = {one[1]: one for one in sections}  # by type: DYNSYM 11, DYNAMIC 6, versions
    names = sections[of[11][6]][4]
    for at in range(of[6][4], of[6][4] + of[6][5], 16):
        tag, value = struct.unpack_from("<QQ", content, at)
        if tag == 1:
            needs.libraries.append(_text(content, names + value))
    versions: dict[int, str] = {}
    if 0x6FFFFFFE in of:  # version needs
        at = of[0x6FFFFFFE][4]
        while True:
            _, parts, _, aux, ahead = struct.unpack_from("<HHIII", content, at)
            place = at + aux
            for _ in range(parts):
                _, _, number, name, step = struct.unpack_from("<IHHII", content, place)
                versions[number] = _text(content, names + name)
                place += step
            if not ahead:
                break
            at += ahead
    for i in range(1, of[11][5] // 24):
        name, info, _, section = struct.unpack_from("<IBBH", content, of[11][4] + 24 * i)
        if section == 0 and info >> 4 == 1:  # undefined, global
            symbol = _text(content, names + name)
            if 0x6FFFFFFF in of:
                (number,) = struct.unpack_from("<H", content, of[0x6FFFFFFF][4] + 2 * i)
                symbol += f"@{versions[number]}" if number in versions else ""
            needs.symbols.append(symbol)
    return needs


def _macho(content: bytes) -> Needs:
    cpu, _, _, commands = struct.unpack_from("<IIII", content, 4)
    needs, at = Needs(f"Mach-O {'arm64' if cpu == 0x0100000C else 'x86_64'}"), 32
    for _ in range(commands):
        command, size = struct.unpack_from("<II", content, at)
        if command == 0xC:  # LOAD_DYLIB
            needs.libraries.append(
                _text(content, at + struct.unpack_from("<I", content, at + 8)[0])
            )
        elif command == 0x1D:  # CODE_SIGNATURE
            needs.signed = True
        elif command == 0x2:  # SYMTAB
            first, count, strings, _ = struct.unpack_from("<IIII", content, at + 8)
            for i in range(count):
                name, kind, _, _, _ = struct.unpack_from("<IBBHQ", content, first + 16 * i)
                if kind & 0x0F == 0x01:  # undefined, external
                    needs.symbols.append(_text(content, strings + name).removeprefix("_"))
        at += size
    return needs


def _pe(content: bytes) -> Needs:
    (header,) = struct.unpack_from("<I", content, 60)
    sections, optional = struct.unpack_from("<H12xH", content, header + 6)
    places = [
        struct.unpack_from("<8xIIII", content, header + 24 + optional + 40 * i)
        for i in range(sections)
    ]

    def at(address: int) -> int:
        for size, begin, _, offset in places:
            if begin <= address < begin + size:
                return int(address - begin + offset)
        raise ValueError(f"no section holds the address {address}")

    needs = Needs("PE x86_64")
    (table,) = struct.unpack_from("<I", content, header + 24 + 112 + 8)
    place = at(table) if table else 0
    while place:
        names, _, _, library, thunks = struct.unpack_from("<IIIII", content, place)
        if not library:
            break
        needs.libraries.append(_text(content, at(library)))
        entry = at(names or thunks)
        while (value := struct.unpack_from("<Q", content, entry)[0]) != 0:
            if not value >> 63:
                needs.symbols.append(_text(content, at(value) + 2))
            entry += 8
        place += 20
    return needs


def main() -> None:
    """Print what libraries need."""
    for name in sys.argv[1:]:
        needs = needs_of(Path(name).read_bytes())
        signed = ", signed" if needs.signed else ""
        print(f"{name}: {needs.kind}{signed}, from {', '.join(needs.libraries)}:")
        print(f"  {' '.join(sorted(needs.symbols))}")


if __name__ == "__main__":
    main()
