# SPDX-License-Identifier: Apache-2.0
"""Laws of the ledger under any sequence of feedback, repetition, undo, edit and reopening."""

from __future__ import annotations

import contextlib
import tempfile
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from bt_agents.errors import Refused
from feedback_node.ledger import Cause, Ledger

values = st.floats(-1e9, 1e9)
profiles = st.fixed_dictionaries({"age": values, "mood": values})
texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)


@given(profiles, texts, texts, st.dictionaries(texts, values, max_size=3))
def test_what_is_read_equals_what_was_written(profile, source, reason, target):
    with Ledger(":memory:") as ledger:
        ledger.enter({"a": {"age": 0.0, "mood": 0.0}})
        cause = Cause(source=source, reason=reason, feedback_id=source, target=target)
        row = ledger.append("a", profile, cause)
        assert ledger.history("a")[1] == row
        assert (dict(row.profile), row.cause) == (profile, cause)


@given(st.lists(profiles, min_size=1, max_size=8))
def test_as_many_undos_as_changes_restore_the_beginning(changes):
    with Ledger(":memory:") as ledger:
        first = ledger.enter({"a": {"age": 0.0, "mood": 0.0}})["a"]
        expected = [first.profile]
        for change in changes:
            expected.append(ledger.append("a", change, Cause()).profile)
        for profile in reversed(expected[:-1]):
            assert ledger.undo("a").profile == profile
        assert [r.revision for r in ledger.history("a")] == list(range(2 * len(changes) + 1))


class LedgerMachine(RuleBasedStateMachine):
    """A ledger on disk against a list in memory."""

    @initialize(profile=profiles)
    def enter(self, profile: dict[str, float]) -> None:
        self.folder = tempfile.TemporaryDirectory()
        self.path = Path(self.folder.name) / "ledger.sqlite"
        self.ledger = Ledger(self.path)
        self.authored = profile
        self.ledger.enter({"a": profile})
        self.rows = [profile]
        self.ids: dict[str, int] = {}

    @rule(profile=profiles, feedback_id=st.sampled_from("abcdefgh"))
    def learn(self, profile: dict[str, float], feedback_id: str) -> None:
        row = self.ledger.append("a", profile, Cause(feedback_id=feedback_id))
        if feedback_id not in self.ids:
            self.rows.append(profile)
            self.ids[feedback_id] = len(self.rows) - 1
        assert row.revision == self.ids[feedback_id]

    @rule()
    def undo(self) -> None:
        with contextlib.suppress(Refused):
            self.rows.append(dict(self.ledger.undo("a").profile))

    @rule(profile=profiles)
    def edit(self, profile: dict[str, float]) -> None:
        self.ledger.enter({"a": profile})
        if profile != self.authored:
            self.rows.append(profile)
            self.authored = profile

    @rule()
    def reopen(self) -> None:
        self.ledger.close()
        self.ledger = Ledger(self.path)

    @invariant()
    def every_revision_is_there(self) -> None:
        if hasattr(self, "ledger"):
            history = self.ledger.history("a")
            assert [dict(row.profile) for row in history] == self.rows
            assert [row.revision for row in history] == list(range(len(self.rows)))

    def teardown(self) -> None:
        if hasattr(self, "ledger"):
            self.ledger.close()
            self.folder.cleanup()


LedgerMachine.TestCase.settings = settings(max_examples=15, stateful_step_count=15, deadline=None)
TestLedger = LedgerMachine.TestCase
