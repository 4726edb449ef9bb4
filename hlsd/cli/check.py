"""A planner against the contract: ``hlsd check``."""

from typing import Annotated

import typer

from hlsd.cli.completion import complete_planners
from hlsd.cli.options import PlannerArgOption, PolicyOption, chosen
from hlsd.cli.output import JsonOption, answer, show_lines


def check(
    planner: Annotated[
        str,
        typer.Argument(
            help="Planner, as for `hlsd bench --planner`.",
            autocompletion=complete_planners,
        ),
    ],
    planner_arg: PlannerArgOption = None,
    policy: PolicyOption = None,
    as_json: JsonOption = False,
) -> None:
    """Check that a planner keeps the contract; say what to mend where it does not.

    It drives through imagined places for some seconds; nothing is simulated. Exit code
    0 if every rule holds, 1 if one is broken.
    """
    from hlsd.run.checking import RULES, check_driver

    (held,), policies = chosen([planner], planner_arg, policy)
    findings = check_driver(held.with_policy(policies.get(held.name)))
    broken = sum(1 for finding in findings if finding.broken)
    untried = len(RULES) - len(findings)
    if as_json:
        rules = [
            {
                "rule": finding.rule.text,
                "broken": finding.broken,
                "remedy": finding.rule.remedy if finding.broken else "",
            }
            for finding in findings
        ]
        data = {"planner": held.name, "kept": not broken, "rules": rules}
        answer(True, {**data, "untried": untried})
        raise typer.Exit(1 if broken else 0)
    for finding in findings:
        word = "BROKEN" if finding.broken else "ok"
        show_lines([f"{word:<6}  {finding.rule.text}"], 8)
        if finding.broken:
            why = f"        {finding.broken}"
            show_lines([why, f"        to mend: {finding.rule.remedy}"], 8)
    if broken:
        more = f", {untried} not tried" if untried else ""
        typer.echo(f"{held.name} breaks {broken} of {len(RULES)} rules{more}")
        raise typer.Exit(1)
    typer.echo(f"{held.name} keeps the contract: hlsd bench drives it")
