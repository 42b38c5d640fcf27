"""Help, errors and configuration files of every command, in one place.

A command is a function with annotated options; what is common to all of them is added here: panels by option, examples
under the help, one line for a wrong command line, and a TOML file in place of a long one.
"""

from __future__ import annotations

import re
import shutil
import sys
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

PANELS: dict[str, tuple[str, ...]] = {
    "Data": ("data", "files", "plan", "input", "output", "schedule", "role", "flip",
             "sample_rate", "chunk", "held_out", "hold_out", "training", "beside"),
    "Model": ("structure", "na", "nb", "nk", "order", "past", "innovation", "on", "trial", "odd", "states", "side",
              "forgetting", "degree", "basis", "segments", "shape", "schedule_filter", "schedule_lag", "no_constant",
              "affine", "affine_terms", "lagged", "passive", "balanced", "form", "refit_form", "model", "models",
              "parameters", "baseline", "catalogue", "thorough"),
    "Noise": ("nc", "nd", "refit"),
    "Selection": ("auto", "budget", "ridge", "fdr"),
    "Stability": ("rate", "range", "largest_range", "largest_rate", "gain", "draws"),
    "Plant and control": ("car", "damper", "plant", "design", "controller", "measurements", "road", "tune", "bound",
                          "bound_seeds", "seeds", "preview", "road_ahead", "certificate"),
    "Characterisation": ("speeds", "rebound", "tolerance", "nominal", "specimen", "delay"),
    "Export": ("to", "name", "precision", "clamp", "at", "limit", "anti_windup", "format"),
    "Output": ("out", "json", "horizon", "plan_experiment", "list_models", "schema"),
    "Run": ("do", "fleet", "scheduler", "workers", "time_limit", "retries", "config",
             "template", "seed", "help", "version", "install_completion", "show_completion"),
}
"""Panels of the help, in their order, with the options that belong to each; any other stands in a panel of its own."""
OTHER = "Options"
KINDS = {"int": "N", "int range": "N", "float": "X", "float range": "X", "str": "TEXT", "path": "FILE",
         "list[str]": "NAME…", "list[path]": "FILE…", "list[float]": "X…", "list[int]": "N…"}
"""What stands for a value whose option gives no better name."""
WIDEST, NARROWEST, COLUMN = 110, 40, 26
"""Width of the help at most and at least, and of its first column, in characters."""


class Group(TyperGroup):
    """The commands of an application."""

    def main(self, *args: Any, standalone_mode: bool = True, **more: Any) -> Any:
        """Run; a wrong command line ends with one line and exit code 2.

        Parameters
        ----------
        *args : object
            As for click's `main`: the command line, without the program's name.
        standalone_mode : bool
            Whether the process ends with the exit code; if not, errors are left to the caller.
        **more : object
            As for click's `main`.

        Returns
        -------
        object
            What the command returned, without `standalone_mode`; else nothing comes back.
        """
        return _run(super().main, args, standalone_mode, more)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Usage, what it is for, its commands, its options.

        Parameters
        ----------
        ctx : click.Context
            Of this group.
        formatter : click.HelpFormatter
            Receives the text, already in lines for the width of the terminal.
        """
        width = _width()
        parts = [f"Usage: {ctx.command_path} COMMAND [OPTIONS]", *_paragraphs(self.help, width)]
        rows = [(name, self.commands[name].get_short_help_str(200)) for name in self.list_commands(ctx)]
        parts += ["Commands:\n" + _columns(rows, width), *_panels(self, ctx, width)]
        formatter.write("\n\n".join([*parts, f"{ctx.command_path} COMMAND -h shows the options of one command, with "
                                     "examples."]) + "\n")


class Command(TyperCommand):
    """A command with panels, examples and a configuration file.

    Examples come in its `epilog`, one a line: `comment | command line`.

    Parameters
    ----------
    name : str or None
        As it is typed.
    **settings : object
        As for `typer.core.TyperCommand`.
    """

    def __init__(self, name: str | None, **settings: Any) -> None:
        super().__init__(name, **settings)
        if not {p.name for p in self.params} & {"config", "template"}:
            self.params += _options(_file_options)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """As in click, whose parser leaves out of some errors the command that they belong to.

        Parameters
        ----------
        ctx : click.Context
            Of this command.
        args : list of str
            The command line behind the name.

        Returns
        -------
        list of str
            Of it what is left.
        """
        try:
            return super().parse_args(ctx, args)
        except Exception as error:
            if getattr(error, "ctx", ctx) is None:
                error.ctx = ctx  # type: ignore[attr-defined]
            raise

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Usage, what it does, examples, panels of options.

        Parameters
        ----------
        ctx : click.Context
            Of this command.
        formatter : click.HelpFormatter
            Receives the text, already in lines for the width of the terminal.
        """
        width = _width()
        arguments = [p for p in self.params if p.param_type_name == "argument"]
        names = [str(p.metavar).removesuffix("…") + ("…" if p.nargs == -1 else "") for p in arguments]
        names = [n if p.required else f"[{n}]" for n, p in zip(names, arguments, strict=True)]
        parts = [" ".join(["Usage:", ctx.command_path, *names, "[OPTIONS]"]), *_paragraphs(self.help, width)]
        if self.epilog:
            parts.append("Examples:\n" + _examples(self.epilog, width))
        formatter.write("\n\n".join([*parts, *_panels(self, ctx, width)]) + "\n")


def panel_of(option: str) -> str:
    """Panel of the help that an option stands in.

    Parameters
    ----------
    option : str
        Name of the parameter in Python, with underscores.

    Returns
    -------
    str
        A key of `PANELS`, or `OTHER`.
    """
    return next((panel for panel, names in PANELS.items() if option in names), OTHER)


def examples_of(epilog: str | None) -> list[tuple[str, str]]:
    """(comment, command line) of the examples in an epilog.

    Parameters
    ----------
    epilog : str or None
        Lines of ``comment | command line``; any other line is passed over.

    Returns
    -------
    list of (str, str)
        In the order of the lines.
    """
    pairs = [line.partition("|") for line in (epilog or "").splitlines() if "|" in line]
    return [(comment.strip(), line.strip()) for comment, _, line in pairs]


def written(examples: Iterable[tuple[str, str]]) -> str:
    """An epilog of (comment, command line) pairs.

    Parameters
    ----------
    examples : iterable of (str, str)
        Comments without a bar.

    Returns
    -------
    str
        One line per example, as `examples_of` reads it.
    """
    return "\n".join(f"{comment} | {line}" for comment, line in examples)


# -- text --------------------------------------------------------------------------------------------------------------
def _width() -> int:
    """Columns of the terminal, within reason."""
    return max(NARROWEST, min(WIDEST, shutil.get_terminal_size((100, 24)).columns))


def _filled(text: str, width: int, indent: str = "", first: str | None = None) -> str:
    """Text in lines; a word is never broken."""
    return textwrap.fill(" ".join(text.split()), width, initial_indent=indent if first is None else first,
                         subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


def _paragraphs(text: str | None, width: int) -> list[str]:
    return [_filled(part, width) for part in textwrap.dedent(text or "").strip().split("\n\n") if part]


def _columns(rows: Sequence[tuple[str, str]], width: int) -> str:
    """Names and explanations side by side; a long name has its line to itself."""
    edge = min(COLUMN, 4 + max((len(name) for name, _ in rows), default=0))
    lines = []
    for name, text in rows:
        head = f"  {name}"
        if len(head) + 2 > edge:
            lines += [head, *([_filled(text, width, " " * edge)] if text else [])]
        else:
            lines.append(_filled(text, width, " " * edge, head.ljust(edge)) if text else head)
    return "\n".join(lines)


def _panels(command: Any, ctx: Any, width: int) -> list[str]:
    rows: dict[str, list[tuple[str, str]]] = {}
    for param in command.get_params(ctx):
        record = None if getattr(param, "hidden", False) else param.get_help_record(ctx)
        if record is not None:
            rows.setdefault(panel_of(param.name), []).append((_plain_type(record[0]), record[1].replace("  [", " [")))
    return [f"{panel}:\n{_columns(rows[panel], width)}" for panel in (*PANELS, OTHER) if panel in rows]


def _plain_type(name: str) -> str:
    """`--na <int range>` as `--na N`."""
    return re.sub(r"<([^<>|]+)>", lambda m: KINDS.get(m[1], m[1].upper()), name)


def _examples(epilog: str, width: int) -> str:
    lines = []
    for comment, line in examples_of(epilog):
        lines += [_filled(comment, width, "  # "), _filled(line, width - 2, "      ", "  ").replace("\n", " \\\n")]
    return "\n".join(lines)


# -- running -----------------------------------------------------------------------------------------------------------
def _run(main: Any, args: tuple[Any, ...], standalone: bool, more: Mapping[str, Any]) -> Any:
    if not standalone:
        return main(*args, standalone_mode=False, **more)
    try:
        code = main(*args, standalone_mode=False, **more)
    except Exception as error:
        line = _one_line(error)
        if line is None:
            raise
        if line:
            typer.echo(line, err=True)
        sys.exit(getattr(error, "exit_code", 1))
    sys.exit(code if isinstance(code, int) else 0)


def _one_line(error: Any) -> str | None:
    """A wrong command line in one line; None where the error is of another kind, empty where the help was printed."""
    if not hasattr(error, "format_message"):
        return None
    if type(error).__name__ == "NoArgsIsHelpError":
        typer.echo(error.format_message())
        return ""
    ctx = getattr(error, "ctx", None)
    message = " ".join(error.format_message().split()).rstrip(".")
    message = re.sub(r"^Invalid value for '(.+?)': Input should be a valid (\w+).*$", r"\1 takes one \2", message)
    message = message.replace(". Did you mean", ": did you mean")
    mend = "" if ctx is None else f"'{ctx.command_path} -h' lists the {'options' if ctx.parent else 'commands'}"
    lower = message if message.startswith(("-", "'")) else message[:1].lower() + message[1:]
    return f"error: {lower}{' ' if lower.endswith('?') else '; '}{mend}" if mend else f"error: {lower}"


# -- a file in place of a long command line ----------------------------------------------------------------------------
def _load(ctx: Any, value: Path | None) -> Path | None:
    """Values of the options from a TOML file; an option given on the command line takes precedence."""
    if value is not None:
        from lpvid.errors import InputError

        try:
            ctx.default_map = {**(ctx.default_map or {}), **read_options(value, ctx.command)}
        except InputError as error:
            typer.echo(f"error: {' '.join(str(error).split())}", err=True)
            raise typer.Exit(error.exit_code) from None
    return value


def _show(ctx: Any, value: bool) -> None:
    if value:
        typer.echo(template_of(ctx.command, ctx.command_path), nl=False)
        raise typer.Exit


def _file_options(
    config: Annotated[Path | None, typer.Option("--config", metavar="FILE", help="TOML file with these options, by "
                                                "their names without the dashes; the command line takes precedence.",
                                                is_eager=True, expose_value=False, callback=_load,
                                                show_default=False)] = None,
    template: Annotated[bool, typer.Option("--template", help="Print such a file, with every option explained, and "
                                           "stop.", is_eager=True, expose_value=False, callback=_show)] = False,
) -> None:
    """Options that every command without a configuration of its own gets."""


def _options(function: Any) -> list[Any]:
    app = typer.Typer(add_completion=False)
    app.command()(function)
    return [p for p in typer.main.get_command(app).params if p.name != "help"]


def _keys(command: Any) -> dict[str, Any]:
    """Parameters that a file may set, by their key."""
    return {max(p.opts, key=len).lstrip("-").replace("_", "-"): p for p in command.params
            if p.name not in ("config", "template", "help")}


def read_options(path: Path, command: Any) -> dict[str, Any]:
    """Values by parameter from a TOML file.

    Parameters
    ----------
    path : Path
        TOML file with keys by the options' names without dashes; underscores count as hyphens.
    command : click.Command
        Whose options the file may set.

    Returns
    -------
    dict of str to object
        By the parameter's name in Python: text, lists of text, or true and false, as from the command line.

    Raises
    ------
    InputError
        A file that cannot be read, TOML that does not parse, an unknown key, a table where a value is expected.
    """
    from lpvid import _checks
    from lpvid.tables import read_toml

    found = read_toml(path)
    keys, values = _keys(command), {}
    for key, value in found.items():
        known = key.replace("_", "-")
        _checks.known_name(known, list(keys), "key", "Take it out; --template prints them all.", where=path.name)
        values[keys[known].name] = _value(path, key, keys[known], value)
    return values


def _value(path: Path, key: str, param: Any, value: Any) -> Any:
    """A value as the command line would give it."""
    from lpvid.errors import InputError

    many = param.nargs == -1 or getattr(param, "multiple", False)
    flag = bool(getattr(param, "is_flag", False))
    listed = value if isinstance(value, list) else [value]
    if any(isinstance(v, dict | list) for v in listed) or (isinstance(value, list) and not many):
        raise InputError(f"{path.name}: '{key}' is one value", got=f"{value!r}", mend="a text, a number or true/false")
    if flag != isinstance(listed[0], bool) or (flag and many):
        raise InputError(f"{path.name}: '{key}' is {'true or false' if flag else 'not a switch'}", got=f"{value!r}",
                         mend="true or false, without quotes" if flag else "a text or a number")
    return value if flag else [str(v) for v in listed] if many else str(value)


def template_of(command: Any, path: str) -> str:
    """A TOML file with every option of a command, commented out, with what it means.

    Parameters
    ----------
    command : click.Command
        Whose options are listed, panel by panel.
    path : str
        How the command is called, "lpvid identify" for instance.

    Returns
    -------
    str
        Text of the file.
    """
    lines = [f"# Options of {path}; run with: {path} --config THIS_FILE. A line without # counts.",
             "# Paths are relative to the folder that the command runs in.", ""]
    panel = None
    ctx = command.context_class(command, info_name=path)
    for key, param in sorted(_keys(command).items(), key=lambda kp: [*PANELS, OTHER].index(panel_of(kp[1].name))):
        if panel_of(param.name) != panel:
            panel = panel_of(param.name)
            lines += [f"# -- {panel} --"]
        name, text = param.get_help_record(ctx) or ("", "")
        lines += [_filled(text.replace("  [", " [") or key, WIDEST, "# "), f"# {key} = {_sample(param, name)}", ""]
    return "\n".join(lines)


def _sample(param: Any, name: str) -> str:
    """What a value looks like."""
    if getattr(param, "is_flag", False):
        return "true"
    if param.nargs == -1 or getattr(param, "multiple", False):
        return '["…"]'
    default = getattr(param.default, "value", param.default)
    if isinstance(default, int | float):
        return f"{default}"
    if default is not None:
        return f'"{default}"'
    return "1" if re.search(r"<(int|float)|[^\w]N$|X$", name) else '"…"'
