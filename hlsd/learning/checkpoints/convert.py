"""Files that others publish -> a converted checkpoint; nothing in them is run.

PyTorch's files are pickles, and a pickle may call any function when it is loaded. Two
readers take the numbers out without that:

- ``torch.load(weights_only=True)``, for files of ``torch.save``: PyTorch's own reader,
  which knows tensors and containers alone;
- for a ``pickle.dump`` of a state dict, which is how the Challenge's baselines are
  stored and which ``torch.load`` does not read: Python's unpickler with a list of the
  four names that a dictionary of tensors needs. The storage within, which is a file of
  ``torch.save`` again, goes to the first reader.

A file that asks for anything else is refused, and the message has the name.

Source: "Restricting Globals" of Python's documentation of pickle; Daffan/ros_jackal
(MIT), ``rl_algos/base_rl_algo.py``, ``save``; damanikjosh/the-barn-challenge (MIT),
``lics/scripts/run.py``.
"""

import hashlib
import io
import json
import pickle
import re
import urllib.error
import urllib.request
import zipfile
from collections import OrderedDict
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from hlsd.core.errors import HlsdError
from hlsd.core.reading import read_bytes, shown
from hlsd.core.text import one_line
from hlsd.core.types import Float32Array
from hlsd.learning.checkpoints.file import MOST_BYTES, Checkpoint
from hlsd.learning.checkpoints.networks import network_of

EXTRA = "pip install 'hlsd[checkpoints]'"
_ADDRESS = re.compile(r"https?://\S+")
_SECONDS = 60.0
_SB3_POLICY = "policy.pth"
"""The one part of a Stable-Baselines3 archive that is read; its others are pickles."""


def convert(kind: str, source: str, sha256: str | None = None) -> Checkpoint:
    """The checkpoint in a file that a project publishes.

    The network is built from it, so that what fits no network is refused here.

    Args:
        kind: Which network: td3, sac, lics or drlvo.
        source: The file, or its address, ``https://...``.
        sha256: What its digest must be; an address needs it.

    Raises:
        HlsdError: PyTorch is missing; the file is missing, has another digest, would
            run code, or holds another network.
    """
    data = _fetched(source, sha256)
    found = hashlib.sha256(data).hexdigest()
    if sha256 is not None and found != sha256.strip().lower():
        raise HlsdError(
            f"{one_line(source, 200)} has SHA-256 {found}, not {one_line(sha256, 80)}: "
            "it is another file than the one that you pinned"
        )
    name = source.rstrip("/").rpartition("/")[2]
    held = {"source": name, "source_sha256": found}
    checkpoint = Checkpoint(
        kind, _tensors(data, source), json.dumps(held, sort_keys=True)
    )
    network_of(checkpoint)
    return checkpoint


def _fetched(source: str, sha256: str | None) -> bytes:
    """The bytes of a file or of an address."""
    if not _ADDRESS.fullmatch(source):
        return read_bytes(Path(source).expanduser(), "checkpoint", MOST_BYTES)
    if sha256 is None:
        raise HlsdError(
            f"{one_line(source, 200)} is an address: pin its content by `sha256`",
            argument="sha256",
        )
    try:
        with urllib.request.urlopen(source, timeout=_SECONDS) as answer:
            data: bytes = answer.read(MOST_BYTES + 1)
    except (urllib.error.URLError, OSError, ValueError) as error:
        raise HlsdError(
            f"cannot download {one_line(source, 200)}: {one_line(error, 200)}"
        ) from error
    if len(data) > MOST_BYTES:
        raise HlsdError(
            f"{one_line(source, 200)} is larger than {MOST_BYTES} bytes, which no "
            "checkpoint here is"
        )
    return data


def _tensors(data: bytes, source: str) -> dict[str, Float32Array]:
    """The tensors of a state dict, by name."""
    torch = _torch()
    where = shown(Path(source)) if not _ADDRESS.fullmatch(source) else source
    # torch.save writes an archive, before 1.6 a pickle that begins with its number.
    data = _policy_within(data, where)
    if data.startswith(b"PK") or _LEGACY in data[:16]:
        state = _by_torch(torch, data, where)
    else:
        state = _by_pickle(torch, data, where)
    if not isinstance(state, Mapping) or not state:
        raise HlsdError(
            f"{where} holds no dictionary of tensors: it is not a state dict"
        )
    found = {}
    for name, value in state.items():
        if not isinstance(name, str) or not isinstance(value, torch.Tensor):
            raise HlsdError(
                f"{where} holds {one_line(name, 60)!r}, which is not a tensor: give "
                "the state dict alone"
            )
        if 4 * value.numel() > MOST_BYTES:  # of few numbers, repeated
            raise HlsdError(
                f"{where} holds {one_line(name, 60)!r} of {value.numel()} numbers, "
                f"more than {MOST_BYTES // 4}, which no network here has"
            )
        if value.is_floating_point():
            found[name] = np.array(value.detach().float().numpy(), np.float32)
    return found


def _policy_within(data: bytes, where: str) -> bytes:
    """The state dict in an archive of Stable-Baselines3; of others, all of it."""
    if not data.startswith(b"PK"):
        return data
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            names = [member.filename for member in archive.infolist()]
            if names.count(_SB3_POLICY) != 1:
                return data
            if archive.getinfo(_SB3_POLICY).file_size > MOST_BYTES:
                raise HlsdError(f"{where} unpacks to more than {MOST_BYTES} bytes")
            return archive.read(_SB3_POLICY)
    except (zipfile.BadZipFile, OSError, RuntimeError, ValueError, EOFError) as error:
        raise HlsdError(
            f"{where} is a damaged archive ({one_line(error, 120)})"
        ) from error


def _by_torch(torch: ModuleType, data: bytes, where: str) -> object:
    try:
        loaded: object = torch.load(
            io.BytesIO(data), map_location="cpu", weights_only=True
        )
    except Exception as error:  # a damaged archive may raise anything
        asked = re.search(r"GLOBAL (\S+) (?:was not|whose)", str(error))
        if asked:
            raise _runs_code(where, asked[1]) from error
        said = (str(error).splitlines() or [type(error).__name__])[0]
        raise HlsdError(
            f"{where} cannot be read as weights alone ({one_line(said, 150)}): give a "
            "state dict that torch.save wrote"
        ) from error
    return loaded


def _by_pickle(torch: ModuleType, data: bytes, where: str) -> object:
    try:
        return _Tensors(torch, data, where).load()
    except HlsdError:
        raise
    except Exception as error:  # bytes that are no pickle may raise anything
        raise HlsdError(
            f"{where} is not a pickle of a state dict, or it is truncated or damaged "
            f"({one_line(error, 120)})"
        ) from error


class _Tensors(pickle.Unpickler):
    """Reads a pickle that needs no more than tensors do; refuses any other."""

    def __init__(self, torch: ModuleType, data: bytes, where: str) -> None:
        super().__init__(io.BytesIO(data))
        self._where = where

        def storage(held: bytes) -> object:
            return _by_torch(torch, held, where)

        self._known: dict[tuple[str, str], Any] = {
            ("collections", "OrderedDict"): OrderedDict,
            ("torch.storage", "_load_from_bytes"): storage,
            ("torch._utils", "_rebuild_tensor_v2"): torch._utils._rebuild_tensor_v2,
            ("torch._utils", "_rebuild_parameter"): torch._utils._rebuild_parameter,
        }

    def find_class(self, module: str, name: str) -> Any:
        """What a name in the pickle stands for."""
        if (module, name) not in self._known:
            raise _runs_code(self._where, f"{module}.{name}")
        return self._known[module, name]


def _runs_code(where: str, name: str) -> HlsdError:
    return HlsdError(
        f"{where} calls {one_line(name, 100)} when it is loaded, which is not a "
        "tensor: hlsd runs nothing of a checkpoint; give a file that holds the state "
        "dict alone"
    )


def _torch() -> ModuleType:
    try:
        import torch
        import torch._utils
    except ImportError as error:
        raise HlsdError(
            f"converting a checkpoint needs the package torch, which is not here: "
            f"{EXTRA}"
        ) from error
    module: ModuleType = torch
    return module


_LEGACY = bytes.fromhex("6cfc9c46f9206aa850")
"""The number 0x1950a86a20f9469cfc6c, in a pickle's order of bytes."""
