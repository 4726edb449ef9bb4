"""What the registry knows of a planner before it is made."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from hlsd.planners.base import Planner
from hlsd.planners.options import Taker
from hlsd.planners.spelling import Options


@dataclass(frozen=True, slots=True)
class PlannerEntry:
    """A planner that exists.

    Attributes:
        name: As on the command line and in result rows.
        summary: One line for lists.
        build: Makes the planner; takes the policy file, None where it needs none, and
            options by their names.
        needs_policy: Whether it drives from a trained policy.
        policy_of: The planner whose policies it drives from; empty for its own.
        taker: Says which options there are; None reads it off ``build``: what that
            takes besides the policy file.
    """

    name: str
    summary: str
    build: Callable[..., Planner]
    needs_policy: bool = False
    policy_of: str = ""
    taker: Callable[[], Taker] | None = None

    @property
    def trained_as(self) -> str:
        """The planner that its policies are trained for."""
        return self.policy_of or self.name

    def typed(self, options: Options) -> dict[str, object]:
        """Options as `build` takes them.

        Raises:
            HlsdError: One does not exist, or is of another type.
        """
        if not options:
            return {}
        if self.taker is None:
            taker = replace(Taker.of(self.build, skip=1), name=self.name)
        else:
            taker = self.taker()
        return taker.typed(self.name, options)
