"""Owns `softclose completion`."""

from __future__ import annotations

import click


@click.command(
    epilog="\b\nExamples:\n"
    '  eval "$(softclose completion bash)"   # put it into ~/.bashrc for all shells\n'
    '  eval "$(softclose completion zsh)"    # ~/.zshrc\n'
    "  softclose completion fish > ~/.config/fish/completions/softclose.fish"
)
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
@click.pass_context
def completion(ctx: click.Context, shell: str) -> None:
    """Print the script that completes commands and options in SHELL."""
    from click.shell_completion import get_completion_class

    found = get_completion_class(shell)
    assert found is not None
    script = found(ctx.find_root().command, {}, "softclose", "_SOFTCLOSE_COMPLETE")
    if shell == "bash":
        # `source` would ask the bash on the PATH for its version, and fail where there is none.
        click.echo(script.source_template % script.source_vars())
        return
    click.echo(script.source())
