"""Limits of a planner's parameters, which may come from a user."""

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from hlsd.core.errors import HlsdError

_USUAL = (0.0, 1e6)


def require_within(config: Any, limits: Mapping[str, tuple[float, float]]) -> None:
    """Check the numbers of a data class.

    Args:
        config: It; booleans and None pass.
        limits: Least and most by field; of others, 0 and a million.

    Raises:
        HlsdError: One is beyond its limits, or not finite.
    """
    for field in fields(config):
        value = getattr(config, field.name)
        if value is None or isinstance(value, bool):
            continue
        least, most = limits.get(field.name, _USUAL)
        if not (math.isfinite(value) and least <= value <= most):
            raise HlsdError(
                f"{type(config).__name__} {field.name} is {value:g}: it must be "
                f"between {least:g} and {most:g}"
            )
