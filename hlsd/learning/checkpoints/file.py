"""A converted checkpoint: float32 tensors by name in an ``.npz``, and their origin.

Format 1 has ``format``, ``kind``, ``provenance`` (JSON) and an array ``t:NAME`` for
each tensor, under the name that its network gives it. It holds numbers and text alone.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from hlsd.core.errors import HlsdError
from hlsd.core.files import write_new
from hlsd.core.npy import Expected
from hlsd.core.npz import ArrayFile, arrays_bytes
from hlsd.core.reading import read_bytes
from hlsd.core.text import one_line
from hlsd.core.types import Float32Array

KINDS: Mapping[str, str] = MappingProxyType(
    {
        "td3": "the BARN Challenge's TD3 baseline",
        "sac": "the BARN Challenge's SAC baseline",
        "lics": "LiCS, a transformer",
        "drlvo": "DRL-VO, a residual network",
    }
)
"""Whose networks are known, by the planner that drives them."""
MOST_BYTES = 256 * 2**20
"""Bytes of a file, and of all that it unpacks to."""
_FORMAT = 1
_TENSOR = "t:"
_HEAD = {
    "format": Expected("iu", 0),
    "kind": Expected("U", 0),
    "provenance": Expected("U", 0),
}


@dataclass(frozen=True, slots=True, eq=False)
class Checkpoint:
    """A network's numbers.

    Attributes:
        kind: Which network, one of `KINDS`.
        tensors: By name, float32, all finite.
        provenance: What it was converted from, as JSON.

    Raises:
        HlsdError: An unknown kind, or a tensor that is not float32 and finite.
    """

    kind: str
    tensors: Mapping[str, Float32Array]
    provenance: str = "{}"

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise HlsdError(
                f"checkpoints of kind {one_line(self.kind, 60)!r} are not known: known "
                f"are {', '.join(KINDS)}"
            )
        for name, tensor in self.tensors.items():
            if tensor.dtype != np.float32 or not np.isfinite(tensor).all():
                raise HlsdError(
                    f"tensor {one_line(name, 60)!r} is not float32, or not finite"
                )

    def take(self, name: str, *shape: int) -> Float32Array:
        """A tensor of a known shape, -1 for any size.

        Raises:
            HlsdError: It is missing or of another shape; says which network wants it.
        """
        tensor = self.tensors.get(name)
        wanted = "x".join("n" if size < 0 else str(size) for size in shape)
        if tensor is None:
            raise HlsdError(
                f"{KINDS[self.kind]} has a tensor {name!r} ({wanted}), and this "
                "checkpoint has none"
            )
        fits = len(shape) == tensor.ndim and all(
            size in (-1, own) for size, own in zip(shape, tensor.shape, strict=True)
        )
        if not fits:
            own = "x".join(map(str, tensor.shape))
            raise HlsdError(
                f"tensor {name!r} of this checkpoint is {own}, and that of "
                f"{KINDS[self.kind]} is {wanted}"
            )
        return tensor

    def said(self) -> dict[str, object]:
        """What the provenance says; nothing where it is none."""
        try:
            held = json.loads(self.provenance)
        except ValueError:
            return {}
        return held if isinstance(held, dict) else {}

    def as_bytes(self) -> bytes:
        """What `save` writes; the same checkpoint gives the same bytes."""
        arrays: dict[str, np.ndarray[tuple[int, ...], np.dtype[np.generic]]] = {
            "format": np.array(_FORMAT, dtype=np.int64),
            "kind": np.array(self.kind),
            "provenance": np.array(self.provenance),
        }
        for name, tensor in self.tensors.items():
            arrays[_TENSOR + name] = np.ascontiguousarray(tensor)
        return arrays_bytes(arrays)

    def save(self, path: Path) -> None:
        """Write it.

        Raises:
            HlsdError: The file exists, or cannot be written.
        """
        write_new(path, self.as_bytes())

    @staticmethod
    def load(path: Path, kind: str) -> "Checkpoint":
        """Read a converted checkpoint.

        Args:
            path: The file.
            kind: Which network is wanted.

        Raises:
            HlsdError: The file is missing, is none, or holds another network; says
                which command makes one.
        """
        remedy = f"`hlsd convert-checkpoint {kind} FILE --out x.npz` makes one"
        data = read_bytes(path, "converted checkpoint", MOST_BYTES, remedy)
        file = ArrayFile(data, path, "converted checkpoint", remedy, MOST_BYTES)
        head = file.read(_HEAD)
        if (version := int(head["format"].item())) != _FORMAT:
            raise file.error(f"its format is {version}, known is {_FORMAT}")
        held = str(head["kind"].item())
        if held != kind:
            raise file.error(f"it holds a network of {one_line(held, 60)!r}")
        names = [name for name in file.names if name.startswith(_TENSOR)]
        tensors = file.read(dict.fromkeys(names, Expected("f", None, 32)))
        try:
            return Checkpoint(
                kind,
                {
                    name.removeprefix(_TENSOR): tensors[name].astype(np.float32)
                    for name in names
                },
                str(head["provenance"].item()),
            )
        except HlsdError as error:
            raise file.error(str(error)) from error
