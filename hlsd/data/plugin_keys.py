"""Key frames of a Gazebo plug-in, read out of the compiled library.

DynaBARN's obstacles are moved by model plug-ins (shared libraries, x86-64, compiled
without optimisation) that build an animation in ``Load``: a ``PoseAnimation`` of a
length, and for each key ``CreateKeyFrame(t)``, ``Translation(Vector3d(x, y, 0))`` and
``Rotation(Quaterniond(0, 0, 0))``, all of constants. Source: aninair1905/DynaBARN,
``create_plugin_polynomial.py``, read as facts.

Nothing of the library is loaded or run. Its instructions are read one after the other
while constants are followed through registers and stack: System V's calling convention
says where arguments are. Whatever is not a constant is unknown, and an unknown key
frame is refused. It needs the extra ``dynabarn`` (capstone and pyelftools).
"""

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from hlsd.core.errors import HlsdError
from hlsd.core.reading import read_bytes, shown
from hlsd.core.text import one_line
from hlsd.data.elf import Library, open_library
from hlsd.data.tracks import Track
from hlsd.data.x86 import bits, double, mask, signed, whole

REMEDY = "pip install 'hlsd[dynabarn]'"
MOST_KEYS = 10_000
"""Of one plug-in."""


def read_plugin(file: Path) -> Track:
    """The track that a mover's plug-in gives its obstacle.

    Args:
        file: The shared library.

    Raises:
        HlsdError: The extra ``dynabarn`` is not installed, the file is missing or
            damaged, or it holds other than one animation of constant key frames that
            repeats when its last key is reached.
    """
    try:
        import capstone
        import elftools  # noqa: F401 - said here rather than amid reading
    except ImportError as error:
        raise HlsdError(
            f"reading DynaBARN's plug-ins needs capstone and pyelftools: {REMEDY}"
        ) from error
    data = read_bytes(file, _KIND, _MOST_BYTES)
    try:
        library = open_library(data)
        animation = _animation(library)
        return _track(animation)
    except (ValueError, capstone.CsError) as error:
        raise HlsdError(f"{shown(file)} is not a {_KIND}: {one_line(error)}") from error


_KIND = "plug-in of constant key frames"
_MOST_BYTES = 16 * 2**20
_MOST_CODE = 2**20
"""Bytes of one function."""

_LOAD = re.compile(r"_ZN[\w.]*4LoadE[\w.]*")
_ANIMATION = re.compile(r"_ZN[\w.]*13PoseAnimationC[12]E[\w.]*db")
_KEY = re.compile(r"_ZN[\w.]*13PoseAnimation14CreateKeyFrameEd")
_TRANSLATION = re.compile(r"_ZN[\w.]*12PoseKeyFrame11TranslationERKN[\w.]*")
_THREE = r"(?P<by>RKd\w*_\w*_|ddd)"
_VECTOR = re.compile(rf"_ZN[\w.]*7Vector3Id?E(?:C[12]|3Set)E{_THREE}")
_TURN = re.compile(rf"_ZN[\w.]*10QuaternionIdEC[12]E{_THREE}")


class _Place(NamedTuple):
    """An address on the function's stack, from where the stack pointer was at first."""

    offset: int


class _Key(NamedTuple):
    """What ``CreateKeyFrame`` returned: number of the key."""

    number: int


_Value = int | _Place | _Key | None
"""What a register or eight bytes hold; None is unknown. A double is its bits."""


@dataclass(slots=True)
class _Animation:
    """What is known of an animation; None where it is not a constant.

    Attributes:
        lengths_s: Length of each ``PoseAnimation`` that is made [s].
        repeats: Whether each repeats.
        times_s: Time of each key [s].
        places: x, y, z of each key that has been given one [m].
        turns: Roll, pitch and yaw of every rotation [rad].
        covered: Addresses of the calls that make keys.
    """

    lengths_s: list[float | None] = field(default_factory=list)
    repeats: list[bool] = field(default_factory=list)
    times_s: list[float | None] = field(default_factory=list)
    places: dict[int, tuple[float | None, ...]] = field(default_factory=dict)
    turns: list[tuple[float | None, ...]] = field(default_factory=list)
    covered: list[int] = field(default_factory=list)


def _animation(library: Library) -> _Animation:
    """The animation that the one ``Load`` of a library makes.

    Raises:
        ValueError: There are none or several.
    """
    found = []
    walked = set()
    for name, address, size in library.functions:
        if _LOAD.fullmatch(name) is None or address in walked:
            continue
        walked.add(address)
        if not 0 < size <= _MOST_CODE:
            raise ValueError(f"{one_line(name, 80)} has {size} bytes")
        animation = _Walk(library).over(address, size)
        if animation.times_s:
            found.append(animation)
    if len(found) != 1:
        raise ValueError(
            f"{len(found) or 'none'} of its functions Load makes key frames by "
            "gazebo::common::PoseAnimation::CreateKeyFrame, where one is wanted"
        )
    return found[0]


def _track(animation: _Animation) -> Track:
    """An animation as a track.

    Raises:
        ValueError: Something is not a constant, or does not go with a track.
    """
    rows = []
    for number, time in enumerate(animation.times_s):
        place = animation.places.get(number)
        for what, value in zip("txyz", (time, *(place or (None,) * 3)), strict=True):
            if value is None:
                raise ValueError(
                    f"{what} of key {number} is not a constant: wanted is a plug-in "
                    "compiled without optimisation"
                )
        assert time is not None
        assert place is not None
        x, y, z = (float(value or 0.0) for value in place)
        if z != 0.0:
            raise ValueError(f"key {number} lifts the obstacle to z = {z} m, not 0")
        rows.append((time, x, y))
    if any(turn[0] != 0.0 or turn[1] != 0.0 for turn in animation.turns):
        raise ValueError(
            "a key tilts the obstacle, or by an angle that is not a constant"
        )
    if len(animation.lengths_s) != 1:
        raise ValueError(f"it makes {len(animation.lengths_s)} animations, not one")
    length, last = animation.lengths_s[0], rows[-1][0]
    if length != last:
        raise ValueError(
            f"its animation lasts {length} s and its last key is at {last} s: wanted "
            "is the same"
        )
    if not animation.repeats[0]:
        raise ValueError("its animation does not repeat")
    return Track([(t, x + 0.0, y + 0.0) for t, x, y in rows])  # type: ignore[arg-type]


class _Walk:
    """Goes over the instructions of a function and keeps what it knows."""

    def __init__(self, library: Library) -> None:
        import capstone
        from capstone import x86

        self._library = library
        self._x86 = x86
        self._reader = capstone.Cs(capstone.CS_ARCH_X86, capstone.CS_MODE_64)
        self._reader.detail = True
        self._registers: dict[str, _Value] = {"rsp": _Place(0)}
        self._stack: dict[int, tuple[_Value, int]] = {}
        self._vectors: dict[int, tuple[_Value, ...]] = {}
        self._made = _Animation()
        self._names: dict[int, str] = {}

    def over(self, address: int, size: int) -> _Animation:
        """What the function at an address makes.

        Raises:
            ValueError: Its code is damaged, or it makes keys in a loop or not always.
        """
        code = self._library.bytes_at(address, size)
        jumps = []
        end = address
        for instruction in self._reader.disasm(code, address):
            end = instruction.address + instruction.size
            to = self._step(instruction)
            if to is not None:
                jumps.append((instruction.address, to))
        if end != address + size:
            raise ValueError("its code is damaged")
        for source, target in jumps:
            low, high = min(source, target), max(source, target)
            if any(low <= call < high for call in self._made.covered):
                raise ValueError("it makes key frames in a loop, or not always")
        return self._made

    def _step(self, instruction: Any) -> int | None:
        """Follow one instruction; where it jumps to, if it does."""
        name = instruction.mnemonic
        operands = instruction.operands
        groups = instruction.groups
        if self._x86.X86_GRP_CALL in groups:
            self._call(instruction)
            return None
        if self._x86.X86_GRP_JUMP in groups:
            known = operands and operands[0].type == self._x86.X86_OP_IMM
            return int(operands[0].imm) if known else None
        if name == "push":
            self._move_stack(-8)
            self._store(self._registers.get("rsp"), 8, self._get(instruction, 0))
        elif name == "pop":
            value = self._load(self._registers.get("rsp"), 8)
            self._put(instruction, 0, value)
            self._move_stack(8)
        elif name == "lea":
            self._put(instruction, 0, self._address(instruction, operands[1]))
        elif name in _MOVES:
            self._put(instruction, 0, self._get(instruction, 1))
        elif name in _CLEARS and self._is_same(instruction):
            self._put(instruction, 0, 0)
        elif name in ("add", "sub", "and") and self._is_stack_pointer(instruction):
            by = operands[1].imm if operands[1].type == self._x86.X86_OP_IMM else None
            here = self._registers.get("rsp")
            if by is None or name == "and" or not isinstance(here, _Place):
                self._registers["rsp"] = None
            else:
                self._move_stack(by if name == "add" else -by)
        elif name in ("cvtsi2sd", "vcvtsi2sd"):
            held = self._get(instruction, len(operands) - 1)
            width = operands[-1].size
            value = None
            if isinstance(held, int):
                value = bits(float(signed(held, width)))
            self._put(instruction, 0, value)
        else:
            self._forget(instruction)
        return None

    def _call(self, instruction: Any) -> None:
        operand = instruction.operands[0]
        name = ""
        if operand.type == self._x86.X86_OP_IMM:
            name = self._name(int(operand.imm))
        elif operand.type == self._x86.X86_OP_MEM:
            slot = self._address(instruction, operand)
            name = self._library.slots.get(slot, "") if isinstance(slot, int) else ""
        returned: _Value = None
        made = self._made
        first = double(self._registers.get("xmm0"))
        if _ANIMATION.fullmatch(name):
            made.lengths_s.append(first)
            made.repeats.append(self._registers.get("rdx") == 1)
        elif _KEY.fullmatch(name):
            if len(made.times_s) == MOST_KEYS:
                raise ValueError(f"it has more than {MOST_KEYS} key frames")
            returned = _Key(len(made.times_s))
            made.times_s.append(first)
            made.covered.append(instruction.address)
        elif _TRANSLATION.fullmatch(name):
            key = self._registers.get("rdi")
            if not isinstance(key, _Key):
                raise ValueError("it moves a key that CreateKeyFrame did not make")
            place = self._registers.get("rsi")
            made.places[key.number] = self._three(place)
            made.covered.append(instruction.address)
        elif (vector := _VECTOR.fullmatch(name)) is not None:
            at = self._registers.get("rdi")
            if isinstance(at, _Place):
                self._vectors[at.offset] = self._arguments(vector["by"])
        elif (turn := _TURN.fullmatch(name)) is not None:
            made.turns.append(tuple(map(double, self._arguments(turn["by"]))))
        for register in _LOST:
            self._registers.pop(register, None)
        self._registers["rax"] = returned

    def _arguments(self, by: str) -> tuple[_Value, ...]:
        """Bits of the three numbers that a constructor gets."""
        if by == "ddd":
            return tuple(self._registers.get(f"xmm{n}") for n in range(3))
        places = (self._registers.get(name) for name in ("rsi", "rdx", "rcx"))
        return tuple(self._load(place, 8) for place in places)

    def _three(self, place: _Value) -> tuple[float | None, ...]:
        """The numbers of a vector at a place: as it was made, else as it lies there."""
        if not isinstance(place, _Place):
            return (None, None, None)
        made = self._vectors.get(place.offset)
        if made is None:
            offsets = (0, 8, 16)
            made = tuple(self._load(_Place(place.offset + o), 8) for o in offsets)
        return tuple(map(double, made))

    def _name(self, address: int) -> str:
        """Symbol that a call to an address reaches, through a stub of .plt or not."""
        if address not in self._names:
            self._names[address] = self._resolved(address)
        return self._names[address]

    def _resolved(self, address: int) -> str:
        code = self._library.bytes_at(address, 32)
        for number, instruction in enumerate(self._reader.disasm(code, address)):
            if number > 2:
                break
            if self._x86.X86_GRP_JUMP in instruction.groups:
                operand = instruction.operands[0]
                if operand.type == self._x86.X86_OP_MEM:
                    slot = self._address(instruction, operand)
                    if isinstance(slot, int) and slot in self._library.slots:
                        return self._library.slots[slot]
                break
        names = (name for name, at, _ in self._library.functions if at == address)
        return next(names, "")

    def _address(self, instruction: Any, operand: Any) -> _Value:
        """What an operand in memory stands for."""
        memory = operand.mem
        if memory.index or memory.segment:
            return None
        if not memory.base:
            return int(memory.disp)
        base = instruction.reg_name(memory.base)
        if base == "rip":
            return int(instruction.address + instruction.size + memory.disp)
        held = self._registers.get(base)
        if isinstance(held, _Place):
            return _Place(held.offset + memory.disp)
        return held + memory.disp if isinstance(held, int) else None

    def _get(self, instruction: Any, number: int) -> _Value:
        operand = instruction.operands[number]
        if operand.type == self._x86.X86_OP_IMM:
            return int(operand.imm) & mask(operand.size)
        if operand.type == self._x86.X86_OP_MEM:
            at = self._address(instruction, operand)
            return self._load(at, min(operand.size, 8))
        name, size = whole(instruction.reg_name(operand.reg))
        value = self._registers.get(name)
        return value & mask(size) if isinstance(value, int) else value

    def _put(self, instruction: Any, number: int, value: _Value) -> None:
        operand = instruction.operands[number]
        if operand.type == self._x86.X86_OP_MEM:
            at = self._address(instruction, operand)
            self._store(at, operand.size, value)
            return
        name, size = whole(instruction.reg_name(operand.reg))
        if size < 4 or (size == 4 and not isinstance(value, int)):
            value = None
        self._registers[name] = value

    def _load(self, at: _Value, size: int) -> _Value:
        if isinstance(at, _Place):
            value, width = self._stack.get(at.offset, (None, 8))
            if size == width:
                return value
            if size < width and isinstance(value, int):
                return value & mask(size)
            return None
        if isinstance(at, int):
            held = self._library.bytes_at(at, size)
            return int.from_bytes(held, "little") if len(held) == size else None
        return None

    def _store(self, at: _Value, size: int, value: _Value) -> None:
        if not isinstance(at, _Place):
            return
        for offset in range(at.offset - 7, at.offset + size):
            if offset + self._stack.get(offset, (None, 8))[1] > at.offset:
                self._stack.pop(offset, None)
            self._vectors.pop(offset, None)
        if size <= 8 and (size == 8 or isinstance(value, int)):
            self._stack[at.offset] = (value, size)

    def _move_stack(self, by: int) -> None:
        here = self._registers.get("rsp")
        if isinstance(here, _Place):
            self._registers["rsp"] = _Place(here.offset + by)

    def _is_same(self, instruction: Any) -> bool:
        """Whether the last two operands are one register."""
        first, second = instruction.operands[-2:]
        register = self._x86.X86_OP_REG
        return bool(first.type == second.type == register and first.reg == second.reg)

    def _is_stack_pointer(self, instruction: Any) -> bool:
        operand = instruction.operands[0]
        if operand.type != self._x86.X86_OP_REG:
            return False
        return bool(instruction.reg_name(operand.reg) == "rsp")

    def _forget(self, instruction: Any) -> None:
        """What an instruction of another kind writes is unknown from here on."""
        for register in instruction.regs_access()[1]:
            self._registers.pop(whole(instruction.reg_name(register))[0], None)
        for operand in instruction.operands[:1]:
            if operand.type == self._x86.X86_OP_MEM:
                at = self._address(instruction, operand)
                self._store(at, max(operand.size, 1), None)


_MOVES = (
    *("mov", "movabs", "movq", "movsd", "movapd", "movaps", "movups", "movupd"),
    *("movdqa", "movdqu", "vmovq", "vmovsd", "vmovapd", "vmovaps"),
)
_CLEARS = ("xor", "pxor", "xorps", "xorpd", "vpxor", "vxorps", "vxorpd")
_LOST = (
    *("rax", "rcx", "rdx", "rsi", "rdi", "r8", "r9", "r10", "r11"),
    *(f"xmm{number}" for number in range(16)),
)
"""Registers that a call may change (System V ABI, AMD64, figure 3.4)."""
