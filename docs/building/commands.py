"""The command-line reference, from the commands themselves: what each does, its arguments and its options."""

from __future__ import annotations

import re
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
    arguments = [p for p in command.params if p.param_type_name == "argument"]
    options = [p for p in command.params if p.param_type_name == "option" and not p.hidden]
    usage = " ".join([title, *(["[OPTIONS]"] if options else []), *map(_argument, arguments)])
    lines = [f"# {title}", "", _prose(command.help or ""), "", "```text", usage, "```", ""]
    for heading, params, term in (("Arguments", arguments, _argument), ("Options", options, _option)):
        if params:
            lines += [f"## {heading}", ""]
            for param in params:
                lines += [f"`{term(param)}`", f": {_meaning(param)}", ""]
    return "\n".join(lines)


def _argument(param: Any) -> str:
    name = (param.metavar or param.name.upper()) + ("…" if param.nargs == -1 else "")
    return name if param.required else f"[{name}]"


def _option(param: Any) -> str:
    names = ", ".join((*param.opts, *param.secondary_opts))
    return names if param.is_flag else f"{names} {param.metavar or param.name.upper()}"


def _meaning(param: Any) -> str:
    notes = ["required"] if param.required else []
    default = getattr(param.default, "value", param.default)
    if not param.required and default not in (None, False, (), []) and not callable(default):
        shown = ", ".join(map(str, default)) if isinstance(default, (list, tuple)) else str(default)
        notes.append(f"default `{shown}`")
    if param.multiple:
        notes.append("may be repeated")
    whole = " ".join([_prose(param.help or ""), *([f"({'; '.join(notes)})"] if notes else [])])
    return whole.strip() or "–"


def _prose(text: str) -> str:
    """Help text as Markdown: angle brackets, stars and dollars of formulas stay what they are."""
    paragraphs = [" ".join(p.split()) for p in text.replace("\b", "").replace("\f", "").split("\n\n")]
    whole = "\n\n".join(paragraphs)
    pieces = whole.split("`")
    for k in range(0, len(pieces), 2):
        for mark in "<*$":
            pieces[k] = pieces[k].replace(mark, "\\" + mark)
        pieces[k] = re.sub(r"(?<![\w-])(--[a-z][\w-]*)", r"`\1`", pieces[k])
    return "`".join(pieces)


def write_commands(folder: Path) -> None:
    """Write a page for every command of both applications and their index."""
    folder.mkdir(parents=True, exist_ok=True)
    index = [
        "# Command line",
        "",
        "Generated from the commands themselves; `COMMAND --help` prints the same.",
        "",
        "Exit codes: 0 done; 2 the input is at fault, one line names it, nothing is written; 3 a numerical outcome "
        "short of the request, with the result written.",
        "",
    ]
    for name, group in applications().items():
        rows = []
        for command, found in group.commands.items():
            page = f"{name}-{command}"
            _write_changed(folder / f"{page}.md", describe(found, f"{name} {command}"))
            rows.append(page)
        index += [
            f"## {name}",
            "",
            _prose((group.help or "").split("\n\n")[0]),
            "",
            "```{toctree}",
            ":maxdepth: 1",
            "",
            *rows,
            "```",
            "",
        ]
    _write_changed(folder / "index.md", "\n".join(index))


def _write_changed(path: Path, text: str) -> None:
    if not path.exists() or path.read_text(encoding="utf8") != text:
        path.write_text(text, encoding="utf8")
