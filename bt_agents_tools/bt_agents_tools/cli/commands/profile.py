# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents profile`: inspects and changes learned profiles."""

from __future__ import annotations

import json
import re
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.field_types import FieldType
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.state_folder import StateFolder
from bt_agents_core.text import format_known
from bt_agents_language.expression.quantities import QuantityError, quantity
from bt_agents_language.files.scene_reader import read_scene
from bt_agents_tools.cli.commands.tune import author_option
from bt_agents_tools.cli.connection import FIND_LIMIT_S, NoSystemError, accepted, connect
from bt_agents_tools.cli.formatting import KINDS, counted, moment_text
from bt_agents_tools.cli.table import Column, TableForm, print_json, print_table, table_options
from bt_agents_tools.cli.trees_choice import kept_state, state_option

if TYPE_CHECKING:
    from bt_agents_tools.client.observer import Observer

_DAY_S = 86_400.0
_MAX_PROBLEMS = 20

_layer = click.option(
    "--layer", default="", help="Of a person or a place: person/anna; default: everybody's."
)
_reason = click.option("--reason", default="", help="Why, in words.")


class _ProfileGroup(click.Group):
    """Group whose first argument may be an agent or an option of `show` instead of a command."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        is_option = bool(args) and args[0].startswith("-")
        shows = is_option and args[0] not in self.get_help_option_names(ctx)
        return super().parse_args(ctx, ["show", *args] if shows else args)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        return super().resolve_command(ctx, args if args[0] in self.commands else ["show", *args])


@click.group(cls=_ProfileGroup, invoke_without_command=True)
@click.pass_context
def profile(ctx: click.Context) -> None:
    """Show what the agents have learned, or change it.

    For example: bt-agents profile, or bt-agents profile attentive_guide.
    """
    if ctx.invoked_subcommand is None:
        ctx.invoke(show, agent="")


@profile.command()
@click.argument("agent", required=False, default="")
@table_options
@state_option
def show(agent: str, form: TableForm, state: str) -> None:
    """Show the profiles of an AGENT, or of all: for everybody, persons and places.

    Without a running system they are read from the ledger, as with --state.
    """
    action = "EXPORT" if agent else "HISTORY"
    profiles = json.loads(_document(action, state, agent=agent))["profiles"]
    if not profiles:
        click.echo("no agent is known to the feedback node yet", err=True)
    names = list(dict.fromkeys(name for one in profiles for name in one["values"]))
    columns = (
        Column(key="agent"),
        Column(key="layer", title="for", text=lambda layer: layer or "everybody"),
        *(Column(key=name, text=format_known, right=True) for name in names),
        Column(key="revision", right=True),
        Column(key="feedbacks", right=True),
        Column(key="changed", text=moment_text),
        Column(key="seem_wrong", title="seem wrong", text="{:.0%}".format, right=True),
    )
    rows = []
    for one in profiles:
        values = [one["values"].get(name) for name in names]
        counts = (one["revision"], one["changes"], one["stamp"], one["false_rate"])
        rows.append((one["agent"], one["layer"], *values, *counts))
    print_table(columns, rows, form)


@profile.command()
@click.argument("agent")
@_layer
@table_options
@state_option
def history(agent: str, layer: str, form: TableForm, state: str) -> None:
    """List the revisions of an AGENT's profile, the oldest first, and why there is each.

    Without a running system they are read from the ledger, as with --state.
    """
    document = json.loads(_document("HISTORY", state, agent=agent, layer=layer))
    if form is TableForm.JSON:
        print_json(document)
        return
    columns = (
        Column(key="revision", right=True),
        Column(key="when", text=moment_text),
        Column(key="what"),
        Column(key="from"),
        Column(key="change"),
        Column(key="why"),
    )
    before: Mapping[str, float] = {}
    rows = []
    for one in document["revisions"]:
        change = _changes(before, one["values"])
        source, reason = one.get("source", ""), one.get("reason", "")
        rows.append((one["revision"], one["stamp"], _cause(one), source, change, reason))
        before = one["values"]
    print_table(columns, rows, form)


@profile.command()
@click.argument("agent")
@_layer
@author_option
@_reason
def undo(agent: str, layer: str, author: str, reason: str) -> None:
    """Bring back the profile that an AGENT had before the last change.

    Again and again it goes further back. It is a new revision; nothing is lost.
    """
    _manage_and_print("UNDO", agent=agent, layer=layer, author=author, reason=reason)


@profile.command()
@click.argument("agent")
@_layer
@author_option
@_reason
def reset(agent: str, layer: str, author: str, reason: str) -> None:
    """Bring back the profile of an AGENT's file, as a new revision."""
    _manage_and_print("RESET", agent=agent, layer=layer, author=author, reason=reason)


@profile.command()
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path))
@click.option("--layer", default="", help="Of one person or place only, such as person/anna.")
@state_option
def export(file: Path, layer: str, state: str) -> None:
    """Write the learned profiles into a FILE, as JSON.

    Without a running system it is read from the ledger, as with --state.
    """
    document = _document("EXPORT", state, agent="", layer=layer)
    try:
        with file.open("x", encoding="utf-8") as opened:
            opened.write(document + "\n")
    except OSError as error:
        raise BtAgentsError(f"{file}: {error.strerror}; choose another name") from None
    profiles = counted(len(json.loads(document)["profiles"]), "profile")
    click.echo(f"{profiles} written to {file}")


@profile.command("import")
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@author_option
@_reason
def import_(file: Path, author: str, reason: str) -> None:
    """Take in profiles from a FILE that was exported, as new revisions.

    The same file is taken in once; all of it, or nothing.
    """
    try:
        document = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise BtAgentsError(f"{file}: it cannot be read: {error}") from None
    _manage_and_print("IMPORT", document=document, author=author, reason=reason)


@profile.command()
@click.option("--older", required=True, help="Unchanged for this long, such as 90d.")
@click.option("--kind", type=click.Choice(["person", "place"]), help="Persons or places only.")
@click.option("--yes", is_flag=True, help="Do not ask.")
@author_option
def expire(older: str, kind: str | None, yes: bool, author: str) -> None:
    """Forget the profiles for persons and places that have not changed for long.

    It cannot be undone, so it shows which they are and asks first.
    """
    age = _age(older)
    observer = connect()
    if not yes:
        known = json.loads(_manage(observer, "HISTORY").document)["profiles"]
        old = [
            one
            for one in known
            if one["layer"]
            and one["layer"].startswith(kind or "")
            and one["stamp"] < time.time() - age
        ]
        if not old:
            click.echo("nothing to forget")
            return
        columns = (
            Column(key="agent"),
            Column(key="layer", title="for"),
            Column(key="changed", text=moment_text),
        )
        print_table(columns, [(one["agent"], one["layer"], one["stamp"]) for one in old])
        click.confirm(f"forget {counted(len(old), 'profile')}, for ever?", abort=True)
    answer = _manage(observer, "EXPIRE", layer=kind or "", older_s=age, author=author)
    click.echo(answer.message)


@profile.command()
@click.argument("file", required=False, type=click.Path(path_type=Path))
@state_option
def check(file: Path | None, state: str) -> None:
    """Check a ledger FILE, or the trees folder's: every revision, and that none is missing.

    A feedback node may have it open. The exit code is 1 when something is wrong.
    """
    from feedback_node.ledger.file import inspect, repair_of_cut_off

    file = file or _with_ledger(state).ledger
    report = inspect(str(file))
    good = f"{report.good} revisions are as they were written"
    if report.forgotten:
        good += f", {report.forgotten} of them without their content, which was forgotten"
    click.echo(f"{file}: {good}")
    if report.problems:
        for problem in report.problems[:_MAX_PROBLEMS]:
            click.echo(f"{RefusalCode.LEDGER_CORRUPT}: {problem}", err=True)
        if (more := len(report.problems) - _MAX_PROBLEMS) > 0:
            click.echo(f"and {counted(more, 'problem')} more", err=True)
        advice = f"'bt-agents profile recover {file} NEW' copies the good ones into a new file"
        click.echo(advice, err=True)
    elif report.lost:
        click.echo(
            f"{RefusalCode.LEDGER_CUT_OFF}: {report.lost}\n{repair_of_cut_off(str(file))}",
            err=True,
        )
    if report.problems or report.lost:
        sys.exit(1)


@profile.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.argument("new", type=click.Path(path_type=Path))
def recover(file: Path, new: Path) -> None:
    """Copy the good revisions of a damaged ledger FILE into a NEW one.

    Of each profile those are the first ones, up to the one before the first that is damaged or
    missing. FILE is not changed. Move it away, with its -wal, -shm and .lock, and put NEW in its
    place; or give the feedback node NEW as its parameter 'ledger'.
    """
    from feedback_node.ledger import file as ledger_file

    count = ledger_file.recover(str(file), str(new))
    click.echo(f"{count} revisions copied to {new}")


def _document(action: str, state: str, **fields: str) -> str:
    """Return a document of the running system, or of the ledger if none runs."""
    if not state:
        try:
            return str(_manage(connect(), action, **fields).document)
        except NoSystemError as error:
            click.echo(f"{error}; this is from the ledger", err=True)
    from feedback_node.management.profile_documents import read_profiles

    kept = _with_ledger(state)
    space = read_scene(kept.trees / "scene.yaml").space.profiles
    return read_profiles(kept.ledger, space, **fields, revisions=action == "HISTORY").text


def _with_ledger(state: str) -> StateFolder:
    """Return the state folder of the trees folder here, which must have a ledger."""
    kept = kept_state(state)
    if not kept.ledger.is_file():
        raise BtAgentsError(
            f"nothing was learned in {kept.trees} yet: there is no {kept.ledger}; 'bt-agents up' "
            "makes it"
        )
    return kept


def _manage(observer: Observer, action: str, **fields: Any) -> Any:
    answer = observer.ask("feedback/manage", find_s=FIND_LIMIT_S, action=action, **fields)
    return accepted(answer, "the feedback node")


def _manage_and_print(action: str, **fields: Any) -> None:
    click.echo(_manage(connect(), action, **fields).message)


def _age(text: str) -> float:
    """Return an age [s], or refuse it with ``BAD_AGE``."""
    option = f"--older {text}"
    if text.strip().startswith("-"):
        raise Refused(
            RefusalCode.BAD_AGE, f"{option}: expected more than 0, for example 90d or 12 h"
        )
    if re.fullmatch(r"[\d.]+", text.strip()):
        raise Refused(
            RefusalCode.BAD_AGE, f"{option}: a number without a unit; write 90d, 2w or 12 h"
        )
    if days := re.fullmatch(r"(\d+(?:\.\d+)?)\s*(d|days?|w|weeks?)", text.strip()):
        return float(days[1]) * _DAY_S * (7 if days[2].startswith("w") else 1)
    try:
        return quantity(text, FieldType.DURATION)
    except QuantityError as error:
        raise Refused(RefusalCode.BAD_AGE, f"{option}: {error}; for example 90d or 12 h") from None


def _cause(one: Mapping[str, Any]) -> str:
    if one["cause"] != "feedback":
        return str(one["cause"])
    return KINDS[int(one.get("kind", 0))].lower()


def _changes(before: Mapping[str, float], after: Mapping[str, float]) -> str:
    changes = []
    for name, value in after.items():
        if before.get(name) != value:
            was = f"{format_known(before[name])} → " if name in before else ""
            changes.append(f"{name} {was}{format_known(value)}")
    return ", ".join(changes) or "no value has changed"
