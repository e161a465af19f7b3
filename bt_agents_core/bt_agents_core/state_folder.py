# SPDX-License-Identifier: Apache-2.0
"""State folder of one trees folder: everything that was learned, tuned and ordered for it.

The id in the file :data:`ID_FILE` identifies a trees folder even after a move; the state folder
notes its last path. Together they distinguish a copy from the original.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.private_files import make_private_file, make_private_folder, tighten
from bt_agents_core.trees_folder import is_installed, is_trees

ID_FILE = ".bt-agents-id"
"""File of a trees folder with its id."""

STUDIO_ADDRESSES = "studio.json"
"""File of a state folder with the addresses of the studio of the running system, by role."""

FLEET_SETTINGS = "fleet.json"
"""File of a state folder with the fleet that its robot has joined."""

_OWNER_FILE = "trees-folder"
"""File of a state folder with the path of its trees folder."""

_ID = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_-]{0,79}")
_LONGEST_PATH = 4096
_HASH_DIGITS = 10


@dataclass(frozen=True, kw_only=True)
class StateFolder:
    """State folder of a trees folder; it may not exist yet.

    Attributes:
        path: Its path.
        trees: The trees folder.
        note: Remark for people, such as that a folder is a copy or was moved.
        is_new: Whether nothing was stored for the trees folder before.
    """

    path: Path
    trees: Path
    note: str = ""
    is_new: bool = False

    @property
    def ledger(self) -> Path:
        """File of the learned profiles."""
        return self.path / "ledger.sqlite"

    @property
    def tunings(self) -> Path:
        """File of the tunings."""
        return self.path / "tunings.json"

    @property
    def open_goals(self) -> Path:
        """File of the host's open goals at action servers."""
        return self.path / "open-goals"

    @property
    def orders(self) -> Path:
        """File of pins, vetoes and run counts."""
        return self.path / "orders.json"

    @property
    def scenes(self) -> Path:
        """File of the scenes without an end."""
        return self.path / "scenes.json"

    @property
    def memory(self) -> Path:
        """File of what agents remember about persons and places."""
        return self.path / "people.json"

    @property
    def journal(self) -> Path:
        """Folder of the journal."""
        return self.path / "journal"


def state_home(environment: Mapping[str, str] = os.environ) -> Path:
    """Return the folder of all logs and state folders of a user, by the XDG rules.

    Raises:
        BtAgentsError: Neither the environment nor the system names a home of the user.
    """
    if base := environment.get("XDG_STATE_HOME"):
        return Path(base) / "bt-agents"
    try:
        return Path.home() / ".local" / "state" / "bt-agents"
    except RuntimeError:
        raise BtAgentsError(
            "no place for logs and learned profiles: neither HOME nor XDG_STATE_HOME is set; set "
            "XDG_STATE_HOME to a folder that can be written"
        ) from None


def find_state(trees: Path, explicit: str = "", home: Path | None = None) -> StateFolder:
    """Return the state folder of a trees folder; write nothing.

    Args:
        trees: The trees folder.
        explicit: The state folder, if the user named one.
        home: Folder of state folders that the user did not name; defaults to :func:`state_home`.

    Raises:
        BtAgentsError: It belongs to another trees folder that still exists, a file about it
            cannot be read, or there is no home.
    """
    trees = trees.resolve()
    if explicit:
        return _named_state(trees, Path(explicit).expanduser().resolve())
    home = (home or state_home()) / "trees"
    known = _id_of(trees)
    if known:
        found = _state(trees, home / known)
        owner = _owner_of(found.path)
        if owner is None or _is_same(owner, trees):
            return found
        if _id_if_readable(owner) != known:
            return replace(found, note=_moved(owner))
        return replace(
            next(_free_states(trees, home)),
            note=f"this trees folder is a copy of {owner}: what was learned, tuned and ordered "
            "there stays there, and this one begins anew; 'bt-agents profile export' there and "
            "'profile import' here take along what was learned",
        )
    return next(_free_states(trees, home))


def claim_state(trees: Path, explicit: str = "", home: Path | None = None) -> StateFolder:
    """Make the state folder of a trees folder, and record which folder it belongs to.

    Only its owner can read its content. A folder that the user named, and that already held other
    files, keeps its permissions.

    Raises:
        BtAgentsError: As in :func:`find_state`, or it cannot be written.
    """
    found = find_state(trees, explicit, home)
    try:
        home = None if explicit else home or state_home()
        is_ours = not found.is_new or not found.path.exists() or not any(found.path.iterdir())
        make_private_folder(found.path, within=home or (found.path if is_ours else None))
        owner = found.path / _OWNER_FILE
        make_private_file(owner)
        for file in (found.ledger, found.tunings, found.orders, found.memory):
            tighten(file)
        if _owner_of(found.path) != found.trees:
            owner.write_text(f"{found.trees}\n", encoding="utf-8", errors="surrogateescape")
    except OSError as error:
        raise BtAgentsError(
            f"no place for learning: {found.path} ({error.strerror}); name another folder "
            "with --state, or set XDG_STATE_HOME to a folder that can be written"
        ) from None
    if not explicit and not is_installed(found.trees) and _id_of(found.trees) != found.path.name:
        # Without the file, as in a read-only folder, its path identifies it.
        with suppress(OSError):
            (found.trees / ID_FILE).write_text(f"{found.path.name}\n", encoding="utf-8")
    return found


def _named_state(trees: Path, place: Path) -> StateFolder:
    owner = _owner_of(place)
    found = _state(trees, place)
    if owner is None or _is_same(owner, trees):
        return found
    if is_trees(owner):
        raise BtAgentsError(
            f"{place} holds the state of the trees folder {owner}; name another folder with "
            f"--state, or remove '{place / _OWNER_FILE}' to give it to {trees}"
        )
    return replace(found, note=_moved(owner))


def _state(trees: Path, place: Path) -> StateFolder:
    return StateFolder(path=place, trees=trees, is_new=_owner_of(place) is None)


def _moved(owner: Path) -> str:
    return f"the trees folder was {owner} before; what was learned there goes on here"


def _free_states(trees: Path, home: Path) -> Iterator[StateFolder]:
    """Yield the possible state folders of a trees folder by its path, the usual one first."""
    name = trees.parent.name if trees.name == "trees" else trees.name
    plain = re.sub(r"[^A-Za-z0-9_]+", "-", name).strip("-")[:40] or "trees"
    digest = hashlib.sha256(os.fsencode(trees)).hexdigest()[:_HASH_DIGITS]
    for number in count(1):
        place = home / (f"{plain}-{digest}" + (f"-{number}" if number > 1 else ""))
        owner = _owner_of(place)
        if owner is None or _is_same(owner, trees):
            yield _state(trees, place)


def _id_of(trees: Path) -> str:
    """Return the id of a trees folder, empty when it has none."""
    file = trees / ID_FILE
    text = _read(file)
    if text and not _ID.fullmatch(text):
        raise BtAgentsError(
            f"{file}: expected a line of letters, digits, '_' and '-', found {text[:40]!r}; "
            "remove the file, then the folder begins anew"
        )
    return text or ""


def _id_if_readable(trees: Path) -> str:
    try:
        return _id_of(trees) if is_trees(trees) else ""
    except BtAgentsError:
        return ""


def _owner_of(place: Path) -> Path | None:
    """Return the trees folder that a state folder belongs to; None if there is none yet."""
    text = _read(place / _OWNER_FILE)
    return Path(text) if text else None


def _is_same(one: Path, other: Path) -> bool:
    try:
        return one == other or one.samefile(other)
    except (OSError, ValueError):
        return False


def _read(file: Path) -> str | None:
    try:
        with file.open(encoding="utf-8", errors="surrogateescape") as opened:
            return opened.read(_LONGEST_PATH + 1).strip()
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise BtAgentsError(
            f"{file} cannot be read: {error.strerror}; fix its permissions"
        ) from None
