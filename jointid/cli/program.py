"""The program: help, version, the start of the app, and one clear message instead of a traceback."""

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from jointid.errors import JointIdError
from jointid.files.application import __version__, application_folder

INTERRUPTED = 130
"""Exit code after Ctrl-C, by the convention of shells."""

_WANTS_JSON = "jointid wants JSON"


_METAVARS = {
    "Path": "FILE",
    "path": "FILE",
    "str": "TEXT",
    "float": "NUMBER",
    "int": "N",
    "int range": "N",
}
"""Values of options in --help, by the type that Typer shows."""


_RENAMED = {"--kind": "--sines-as", "--robot": "--robot-model"}
"""New names of options by their old ones, which still work."""


class Command(TyperCommand):
    """A command whose help names values plainly, FILE instead of <list[Path]>."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments; an option may have its old name."""
        own = {name for each in self.params for name in each.opts}
        old = {name: new for name, new in _RENAMED.items() if new in own and name not in own}
        parts = (arg.partition("=") for arg in args)
        return super().parse_args(ctx, [old.get(name, name) + "".join(rest) for name, *rest in parts])

    def get_params(self, ctx: Any) -> list[Any]:
        """Arguments and options, with names for their values."""
        found: list[Any] = super().get_params(ctx)
        for each in found:
            if each.metavar is not None or not hasattr(each, "display_type"):  # of newer Typer
                continue
            kind = each.display_type(ctx).strip("<>")
            name = _METAVARS.get(kind.removeprefix("list[").rstrip("]"))
            if each.param_type_name == "argument":
                each.metavar = each.name.upper()
                each.display_type_rich = lambda ctx: ""
            elif name is not None:
                each.metavar = name + " …" * kind.startswith("list[")
        return found

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Pieces of the usage line; Typer puts required arguments in braces, which mean a choice."""
        return [re.sub(r"^{(.*)}", r"\1", piece) for piece in super().collect_usage_pieces(ctx)]

    def invoke(self, ctx: Any) -> Any:
        """Run the command; an error that is not in a file names options, not parameters of Python."""
        try:
            return super().invoke(ctx)
        except JointIdError as error:
            options = {p.name: p.opts[0] for p in self.params if "_" in (p.name or "") and p.opts}
            known = "|".join(map(re.escape, options))
            if error.file is not None or not known:
                raise
            text = re.sub(rf"\b(?:{known})\b", lambda found: options[found[0]], str(error))
            raise JointIdError(text) from error


class _Commands(TyperGroup):
    """The commands; an error is one message and an exit code, with --json as JSON too."""

    def make_context(self, info_name: str | None, args: list[str], *more: Any, **extra: Any) -> Any:
        as_json = "--json" in args
        with _reported(as_json):
            context = super().make_context(info_name, args, *more, **extra)
        context.meta[_WANTS_JSON] = as_json
        return context

    def invoke(self, ctx: Any) -> Any:
        with _reported(ctx.meta[_WANTS_JSON]):
            return super().invoke(ctx)


@contextmanager
def _reported(as_json: bool) -> Iterator[None]:
    """Turn errors into one message and an exit code."""
    try:
        yield
        return
    except JointIdError as error:
        message = str(error)
    except BrokenPipeError:  # the reader of the output has closed it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise typer.Exit from None
    except OSError as error:
        message = f"{error.filename or 'File'}: {error.strerror or error}. Check the path."
    except (typer.Exit, typer.Abort):
        raise
    except Exception as error:
        usage = getattr(error, "format_message", None)  # only usage errors have it
        if as_json and usage is not None:
            print_error(usage())
        if usage is not None or os.environ.get("JOINTID_DEBUG"):
            raise
        message = (
            f"Internal error, {type(error).__name__} ({error!s:.300}). This is a bug in jointid; "
            "set JOINTID_DEBUG=1 to see where."
        )
    if as_json:
        print_error(message)
    typer.echo(f"Error: {message}", err=True)
    raise typer.Exit(1)


def print_error(message: str) -> None:
    """Print an error as JSON, in ASCII."""
    plain = message.encode("utf-8", "backslashreplace").decode()  # a path can hold any bytes
    print(json.dumps({"error": plain}))


class _Program(typer.Typer):
    """The program; Ctrl-C before the start of a command leaves no traceback either."""

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        try:
            return super().__call__(*args, **kwargs)
        except KeyboardInterrupt:
            raise SystemExit(INTERRUPTED) from None


app = _Program(
    name="jointid",
    cls=_Commands,
    help="Identify stiffness K and damping D of elastic robot joints and simulate their effect on the "
    "path.\n\nValues are at the motor unless stated otherwise. Exit codes: 0 done; 1 the input or a "
    'value is unusable; 2 wrong usage; 130 interrupted. "The paper" is '
    "Identification of Joint Elasticity of Industrial Robots.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _show_version(wanted: bool) -> None:
    if wanted:
        print(f"jointid {__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


def start_app(
    port: Annotated[int, typer.Option(min=1, max=65535, help="TCP port of the server.")] = 8501,
    path: Annotated[
        Path | None, typer.Option(help="For developers: app.py to start in place of the installed one.")
    ] = None,
) -> None:
    """Start the app and print its address for the browser.

    The server drops stalled connections: those that transfer less than 20 kB of a request or response in
    20 s (environment variable JOINTID_PATIENCE_S). It ends a session a minute after its tab is closed.
    Ctrl-C stops the server.
    """
    script = (path or application_folder() / "app.py").resolve()
    if not script.is_file():
        remedy = "Give --path an existing app.py, or leave it out." if path else "Install jointid again."
        raise JointIdError(f"{script} does not exist. {remedy}")
    # Streamlit reads .streamlit/config.toml beside the script as well as in the current folder.
    command = [sys.executable, "-m", "jointid.ui.server", str(script), str(port)]
    try:
        with subprocess.Popen(command, cwd=script.parent) as server:
            signal.signal(signal.SIGTERM, lambda *_: server.terminate())
            code = server.wait()
    except KeyboardInterrupt:
        return
    if code and code != -signal.SIGTERM:
        raise JointIdError(f"The app ended with code {code}; see the message of the server above.")
