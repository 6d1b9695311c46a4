"""`fairlead COMMAND ...`: finds the command, and turns a user's mistake into one line."""

from __future__ import annotations

import importlib
import sys

from fairlead import __version__
from fairlead.core.errors import FairleadError, UnknownNameError

COMMANDS = {
    "doctor": "what this machine has; what is missing and how to get it",
    "collect": "record trajectories in a simulated world",
    "data": "look at a dataset: info, verify",
    "scenes": "draw random scenes from a seed, or keep solved ones",
    "train": "train one model: dynamics, distilled, full-dynamics, trust or recovery",
    "pack": "make trained models ready to travel: smaller, with a card",
    "reproduce": "the whole line: collect, train, try every method, report",
    "demo": "both scenarios with the models that come with Fairlead: a page and videos",
    "movie": "both scenarios as a movie of one to two minutes",
    "plan": "plan and execute one scene, with a trace and a video",
    "evaluate": "try methods on many scenes",
    "methods": "the table of methods: their names, and what each does",
    "planners": "the table of planners: their names, and what each does",
    "report": "tables, figures and one self-contained page",
}
"""Each is a module of this package with a type `Command`, imported when it is called: help stays fast."""


def usage() -> str:
    """The commands, one a line."""
    rows = "\n".join(f"  {name:<10} {sentence}" for name, sentence in COMMANDS.items())
    return f"usage: fairlead COMMAND [options]    (fairlead COMMAND --help says more)\n\n{rows}\n"


def run(arguments: list[str]) -> None:
    """Parse and run one command."""
    name, *rest = arguments or ["--help"]
    if name in ("-h", "--help"):
        print(usage(), end="")
        return
    if name == "--version":
        print(f"fairlead {__version__}")
        return
    if name not in COMMANDS:
        raise UnknownNameError("command", name, COMMANDS)
    _refuse_repeated(rest)
    import tyro

    module = importlib.import_module(f"fairlead.cli.{name}")
    command = tyro.cli(
        module.Command,
        args=rest,
        prog=f"fairlead {name}",
        description=f"{COMMANDS[name].capitalize()}.",
        config=(tyro.conf.FlagCreatePairsOff, tyro.conf.OmitArgPrefixes),
    )
    command.run()


def _refuse_repeated(arguments: list[str]) -> None:
    """Of an option that is given twice the parser would silently take the last."""
    options = [argument.partition("=")[0].replace("_", "-") for argument in arguments if argument.startswith("--")]
    for option in options:
        if options.count(option) > 1:
            raise FairleadError(f"{option} is given {options.count(option)} times; once is allowed (a list has commas)")


def main() -> None:
    """Entry point. Exit codes: 0 done, 2 a mistake in what was given, 130 interrupted."""
    try:
        run(sys.argv[1:])
    except FairleadError as error:
        _fail(" ".join(str(error).split()), 2)
    except OSError as error:
        _fail(f"{error.filename or 'system'}: {error.strerror or error}", 2)
    except KeyboardInterrupt:
        _fail("interrupted", 130)


def _fail(message: str, code: int) -> None:
    print(f"fairlead: {message}", file=sys.stderr)
    sys.exit(code)


if __name__ == "__main__":
    main()
