"""A planner against the contract: ``hlsd check``."""

from typing import Annotated

import typer

from hlsd.cli.options import PlannerArgOption, PolicyOption, chosen


def check(
    planner: Annotated[
        str,
        typer.Argument(help="Planner, as for `hlsd bench --planner`."),
    ],
    planner_arg: PlannerArgOption = None,
    policy: PolicyOption = None,
) -> None:
    """Check that a planner keeps the contract; say what to mend where it does not.

    It drives through imagined places for some seconds; nothing is simulated. Exit code
    0 if every rule holds, 1 if one is broken.
    """
    from hlsd.run.checking import RULES, check_driver

    (held,), policies = chosen([planner], planner_arg, policy)
    findings = check_driver(held.with_policy(policies.get(held.name)))
    for finding in findings:
        typer.echo(f"{'BROKEN' if finding.broken else 'ok':<6}  {finding.rule.text}")
        if finding.broken:
            typer.echo(f"        {finding.broken}\n        to mend: ", nl=False)
            typer.echo(finding.rule.remedy)
    broken = sum(1 for finding in findings if finding.broken)
    if broken:
        untried = len(RULES) - len(findings)
        more = f", {untried} not tried" if untried else ""
        typer.echo(f"{held.name} breaks {broken} of {len(RULES)} rules{more}")
        raise typer.Exit(1)
    typer.echo(f"{held.name} keeps the contract: hlsd bench drives it")
