"""`stlbench solve`: from an environment and a formula to a certified policy."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from stlbench.errors import UsageError
from stlbench.registry.choices import LOCAL


def solve(
    environment: Annotated[
        str,
        typer.Argument(metavar="ENVIRONMENT_OR_TASK", help="An id of Gymnasium; or a task, by its name or path."),
    ],
    formula: Annotated[
        str | None, typer.Argument(metavar="FORMULA", help="The formula to satisfy.", show_default="the task's own")
    ] = None,
    signals: Annotated[
        list[str] | None,
        typer.Option(
            "--signal",
            metavar="NAME=EXPRESSION",
            help="A signal over entries of observation (obs[0] is the first) or info. May be given several times.",
            show_default="each entry by its own name",
        ),
    ] = None,
    minutes: Annotated[float, typer.Option(metavar="M", help="How long it may take.")] = 10.0,
    into: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Folder of everything.",
            show_default="solved/ENVIRONMENT, with a number for each further formula",
        ),
    ] = None,
    confidence: Annotated[float, typer.Option(metavar="C", help="Confidence of the certificate.")] = 0.95,
    time: Annotated[
        Literal["steps", "seconds"] | None,
        typer.Option("--time", help="Unit of the formula's intervals.", show_default="steps, or as the task says"),
    ] = None,
    terminated: Annotated[
        Literal["hold", "violated", "interval"] | None,
        typer.Option(help="Meaning of an early end.", show_default="hold with F or U in the formula, else violated"),
    ] = None,
    start: Annotated[
        Path | None,
        typer.Option(
            "--from",
            metavar="SOLVED",
            help="Folder of an earlier solve on the same observations and actions: start from its policy.",
            show_default="fresh networks",
        ),
    ] = None,
    seed: Annotated[
        int, typer.Option(metavar="N", help="From 0 to 9: another number is another try, with other seeds.")
    ] = 0,
    executor: Annotated[str, typer.Option(metavar="NAME", help="Executor of the trainings.")] = LOCAL,
    jobs: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Trainings at a time.", show_default="2, or 1 on one core")
    ] = None,
) -> None:
    """Train a policy that satisfies a formula, and certify it.

    Reward methods that fit race on the track auto; the winner is trained again with fresh seeds. DIR has the policy,
    the task file, the certificate, a page and a film; solution.md says what came of it. After ctrl-C the best policy so
    far is in DIR with a certificate from few starts, and the same command goes on. The exit code is 0 whatever was
    learned, 2 for bad input or too little time, 130 after ctrl-C.

    \b
    Examples:
      stlbench solve Pendulum-v1 "G[100,200] abs(theta) <= 0.2" --signal "theta=atan2(y, x)" --minutes 10
      stlbench solve CartPole-v1 "G[0,200] abs(theta) <= 0.1"
      stlbench solve reach-stay --minutes 3
    """
    from stlbench.solver.run import solve as solved

    texts = dict[str, str]()
    for text in signals or ():
        name, expression = _signal(text)
        if name in texts:
            raise UsageError(f"--signal {name} is given twice: {texts[name]}, and {expression}")
        texts[name] = expression
    try:
        solution = solved(
            environment,
            formula,
            signals=texts,
            minutes=minutes,
            into=into,
            confidence=confidence,
            time=time,
            terminated=terminated,
            start=start,
            seed=seed,
            executor=executor,
            jobs=jobs,
            progress=True,
        )
    except KeyboardInterrupt:
        typer.echo("interrupted; run the same command again to continue", err=True)
        raise typer.Exit(130) from None
    typer.echo(solution.report())


def _signal(text: str) -> tuple[str, str]:
    name, equals, expression = text.partition("=")
    if not (equals and name.strip() and expression.strip()):
        raise UsageError(f"--signal '{text}': expected NAME=EXPRESSION, as in theta=atan2(y, x)")
    return name.strip(), expression.strip()
