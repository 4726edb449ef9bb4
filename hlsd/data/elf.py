"""Shared libraries as bytes: what of an ELF file is needed to read constants in it.

Nothing is loaded or run. It needs pyelftools, of the extra ``dynabarn``.
"""

import io
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from hlsd.core.text import one_line

_MOST_SECTIONS = 1000
_MOST_SYMBOLS = 100_000


class Library(NamedTuple):
    """What is needed of an ELF file.

    Attributes:
        segments: Address and bytes of what is loaded from the file.
        functions: Name, address and size of functions that it defines.
        slots: Name of the symbol that each address of the offset table leads to.
    """

    segments: tuple[tuple[int, bytes], ...]
    functions: tuple[tuple[str, int, int], ...]
    slots: Mapping[int, str]

    def bytes_at(self, address: int, count: int) -> bytes:
        """Up to ``count`` bytes at an address; fewer where the segment ends."""
        for start, held in self.segments:
            if start <= address < start + len(held):
                return held[address - start : address - start + count]
        return b""


def open_library(data: bytes) -> Library:
    """Read an ELF file.

    Raises:
        ValueError: It is damaged, or not for x86-64.
    """
    from elftools.elf.elffile import ELFFile

    if data[:6] != b"\x7fELF\x02\x01":
        raise ValueError(
            "it is not an ELF file of 64 bits, least significant byte first"
        )
    try:
        elf: Any = ELFFile(io.BytesIO(data))
        header = elf.header
        machine = str(header["e_machine"])
        _check_tables(header, len(data))
        if machine != "EM_X86_64":
            raise ValueError(f"it is for {one_line(machine, 40)}, not for x86-64")
        segments = tuple(
            (each["p_vaddr"], data[each["p_offset"] :][: each["p_filesz"]])
            for each in elf.iter_segments()
            if each["p_type"] == "PT_LOAD"
        )
        functions: dict[tuple[str, int], int] = {}
        slots: dict[int, str] = {}
        for section in _sections(elf, len(data)):
            if section["sh_type"] in ("SHT_DYNSYM", "SHT_SYMTAB"):
                for symbol in section.iter_symbols():
                    known = symbol["st_info"]["type"] == "STT_FUNC"
                    if known and symbol["st_shndx"] != "SHN_UNDEF":
                        where = (symbol.name, symbol["st_value"])
                        functions[where] = symbol["st_size"]
            elif section["sh_type"] == "SHT_RELA":
                symbols = elf.get_section(section["sh_link"])
                if symbols["sh_type"] != "SHT_DYNSYM":
                    continue
                for relocation in section.iter_relocations():
                    number = relocation["r_info_sym"]
                    if number:
                        name = symbols.get_symbol(number).name
                        slots[relocation["r_offset"]] = name
    except ValueError:
        raise
    except Exception as error:  # whatever pyelftools trips over in a damaged file
        raise ValueError(f"the ELF file is damaged ({type(error).__name__})") from error
    held = tuple((name, at, size) for (name, at), size in functions.items())
    return Library(segments, held, slots)


def _check_tables(header: Any, size: int) -> None:
    """Raise `ValueError` where tables of an ELF file are not in it."""
    for start, count, each in (
        ("e_shoff", "e_shnum", "e_shentsize"),
        ("e_phoff", "e_phnum", "e_phentsize"),
    ):
        if not 0 < header[count] <= _MOST_SECTIONS:
            raise ValueError(f"it has {header[count]} sections or segments")
        if header[start] + header[count] * header[each] > size:
            raise ValueError("it ends before its table of sections or segments")


def _sections(elf: Any, size: int) -> Iterator[Any]:
    """Sections with tables of symbols and relocations, all in the file."""
    for section in elf.iter_sections():
        if section["sh_type"] not in ("SHT_DYNSYM", "SHT_SYMTAB", "SHT_RELA"):
            continue
        if (
            section["sh_offset"] + section["sh_size"] > size
            or not section["sh_entsize"]
        ):
            raise ValueError("it ends before its table of symbols")
        if section["sh_size"] // section["sh_entsize"] > _MOST_SYMBOLS:
            raise ValueError(f"it has more than {_MOST_SYMBOLS} symbols")
        yield section
