"""`gcs completion SHELL`: the script with which a shell completes commands and options."""

import argparse
from typing import Final

from gcs.cli.output import print_json

SHELLS: Final = ("bash", "zsh", "fish")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("shell", choices=SHELLS)
    parser.epilog = (
        "bash: gcs completion bash > ~/.local/share/bash-completion/completions/gcs;"
        " zsh: gcs completion zsh > _gcs, in a folder of $fpath;"
        " fish: gcs completion fish > ~/.config/fish/completions/gcs.fish"
    )


def run(arguments: argparse.Namespace) -> int:
    """Print the script; with `--json` a JSON object that contains it. Returns: 0."""
    import shtab  # noqa: PLC0415 (only this command needs it)

    from gcs.cli.main import whole_parser  # noqa: PLC0415 (it imports this module's table)

    script = shtab.complete(whole_parser(), shell=arguments.shell)
    if arguments.json:
        print_json({"shell": arguments.shell, "script": script})
    else:
        print(script)
    return 0
