# SPDX-License-Identifier: Apache-2.0
"""Open goals: goals that a host has sent and that have not ended, so that others can end them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.ros_names import LONGEST_NAME, is_full_name
from bt_agents_core.text import printable_line

MOST_OPEN_GOALS = 100
"""Maximum number of open goals that a host reports; of more, the latest ones."""

TAKEOVER_S = 3.0
"""Time that the cancelled goals of a departed host have to end [s]."""

_LONGEST_PATH = 200
_ID_BYTES = 16
_SHOWN = 5


@dataclass(frozen=True, kw_only=True)
class OpenGoal:
    """A goal of an action that has been sent and has no confirmed end.

    Attributes:
        path: Tree node that sent it, for people; one line, shortened if it is too long.
        action: Fully qualified name of the action.
        goal_id: Its id, 16 bytes.

    Raises:
        Refused: ``BAD_GOAL``. An id of zeros would mean every goal of a server.
    """

    path: str
    action: str
    goal_id: bytes

    def __post_init__(self) -> None:
        """Check the name and the id, which may come from outside."""
        object.__setattr__(self, "path", printable_line(self.path[:_LONGEST_PATH]))
        if not is_full_name(self.action):
            found = printable_line(self.action[:LONGEST_NAME])
            raise Refused(
                RefusalCode.BAD_GOAL,
                f"the action of a goal is '{found}', expected a fully qualified name of at most "
                f"{LONGEST_NAME} characters such as /drive",
            )
        if len(self.goal_id) != _ID_BYTES or not any(self.goal_id):
            raise Refused(
                RefusalCode.BAD_GOAL,
                f"the id of a goal of {self.action} is '{self.goal_id[:_ID_BYTES].hex()}', "
                f"expected {_ID_BYTES} bytes that are not all zero",
            )

    def __str__(self) -> str:
        return f"{self.action} ({self.path})" if self.path else self.action


def name_goals(goals: Iterable[OpenGoal]) -> str:
    """Format goals for people; only the first ones of many."""
    names = [str(goal) for goal in goals]
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more
