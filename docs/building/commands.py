"""The command-line reference, from the commands themselves: what each does, its arguments, its options with defaults."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer


def applications() -> dict[str, Any]:
    """The two applications as command groups."""
    from lpvid.cli.app import app as lpvid_app
    from quartercar.cli.app import app as quartercar_app

    return {"lpvid": typer.main.get_command(lpvid_app), "quartercar": typer.main.get_command(quartercar_app)}


def describe(command: Any, title: str) -> str:
    """One page: help, usage, arguments and options of a command, as Markdown."""
    context = typer.Context(command, info_name=title)
    arguments = [p for p in command.params if p.param_type_name == "argument"]
    options = [p for p in command.params if p.param_type_name == "option" and not getattr(p, "hidden", False)]
    usage = " ".join([title, *command.collect_usage_pieces(context)])
    lines = [f"# {title}", "", _prose(command.help or ""), "", "```text", usage, "```", ""]
    for heading, params in (("Arguments", arguments), ("Options", options)):
        if params:
            lines += [f"## {heading}", ""]
            for param in params:
                lines += [_term(param, context), f": {_meaning(param, context)}", ""]
    return "\n".join(lines)


def _term(param: Any, context: Any) -> str:
    if param.param_type_name == "argument":
        return f"`{param.make_metavar(context)}`"
    names = ", ".join(f"`{name}`" for name in (*param.opts, *param.secondary_opts))
    return names if param.is_flag else f"{names} `{param.make_metavar(context)}`"


def _meaning(param: Any, context: Any) -> str:
    text = " ".join((getattr(param, "help", None) or "").split())
    notes = []
    default = param.get_default(context, call=False)
    if getattr(param, "required", False):
        notes.append("required")
    elif default not in (None, False, (), []) and not callable(default):
        shown = ", ".join(map(str, default)) if isinstance(default, (list, tuple)) else str(getattr(default, "value", default))
        notes.append(f"default `{shown}`")
    if getattr(param, "multiple", False):
        notes.append("may be repeated")
    return _prose(text) + (f" ({'; '.join(notes)})" if notes else "") if text or notes else "–"


def _prose(text: str) -> str:
    """Help text as Markdown: angle brackets, stars and dollars of formulas stay what they are."""
    paragraphs = [" ".join(p.split()) for p in text.replace("\b", "").replace("\f", "").split("\n\n")]
    whole = "\n\n".join(paragraphs)
    pieces = whole.split("`")
    for k in range(0, len(pieces), 2):
        for mark in "<*$":
            pieces[k] = pieces[k].replace(mark, "\\" + mark)
    return "`".join(pieces)


def write_commands(folder: Path) -> None:
    """Write a page for every command of both applications and their index."""
    folder.mkdir(parents=True, exist_ok=True)
    index = ["# Command line", "", "Generated from the commands themselves; `COMMAND --help` prints the same.", "",
             "Exit codes: 0 done; 2 the input is at fault, one line says what, nothing is written; 3 a numerical outcome "
             "short of what was asked, with the result written.", ""]
    for name, group in applications().items():
        rows = []
        for command, found in group.commands.items():
            page = f"{name}-{command}"
            _write_changed(folder / f"{page}.md", describe(found, f"{name} {command}"))
            rows.append(page)
        index += [f"## {name}", "", _prose((group.help or "").split("\n\n")[0]), "", "```{toctree}", ":maxdepth: 1", "", *rows,
                  "```", ""]
    _write_changed(folder / "index.md", "\n".join(index))


def _write_changed(path: Path, text: str) -> None:
    if not path.exists() or path.read_text(encoding="utf8") != text:
        path.write_text(text, encoding="utf8")
