# SPDX-License-Identifier: Apache-2.0
"""Laws of the ledger under any sequence of feedback, repetition, undo, edit and reopening."""

from __future__ import annotations

import contextlib
import tempfile
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from bt_agents_core.errors import Refused
from feedback_node.ledger import Ledger, LedgerEntry
from feedback_node.ledger.file import inspect
from feedback_node.ledger.rows import LAYER, RevisionCause
from feedback_node.management.management import ManagementAction
from ledger_fixture import ManagedLedger

values = st.floats(-1e9, 1e9)
profiles = st.fixed_dictionaries({"age": values, "mood": values})
texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)


@given(profiles, texts, texts, st.dictionaries(texts, values, max_size=3))
def test_read_revision_equals_written_revision(profile, source, reason, target):
    with Ledger(":memory:") as ledger:
        ledger.enter({"a": {"age": 0.0, "mood": 0.0}})
        cause = RevisionCause(source=source, reason=reason, feedback_id=source, target=target)
        row = ledger.append("a", profile, cause)
        assert ledger.history("a")[1] == row
        assert (dict(row.profile), row.cause) == (profile, cause)


@given(st.lists(profiles, min_size=1, max_size=8))
def test_undoing_all_changes_restores_first_profile(changes):
    with Ledger(":memory:") as ledger:
        first = ledger.enter({"a": {"age": 0.0, "mood": 0.0}})["a"]
        expected = [first.profile]
        for change in changes:
            expected.append(ledger.append("a", change, RevisionCause()).profile)
        for profile in reversed(expected[:-1]):
            assert ledger.undo("a").profile == profile
        assert [r.revision for r in ledger.history("a")] == list(range(2 * len(changes) + 1))


class LedgerMachine(RuleBasedStateMachine):
    """A ledger on disk, with layers, against lists in memory."""

    layers = st.sampled_from(["", "", "person/anna", "place/lobby"])

    @initialize(profile=profiles)
    def enter(self, profile: dict[str, float]) -> None:
        self.folder = tempfile.TemporaryDirectory()
        self.path = Path(self.folder.name) / "ledger.sqlite"
        self.ledger = Ledger(self.path)
        self.authored = profile
        self.ledger.enter({"a": profile})
        self.rows = {"": [profile]}
        self.ids: dict[str, tuple[str, int] | None] = {}

    @rule(layer=layers, profile=profiles, feedback_id=st.sampled_from("abcdefghijkl"))
    def learn(self, layer: str, profile: dict[str, float], feedback_id: str) -> None:
        entries = []
        new = feedback_id not in self.ids
        if layer not in self.rows:
            begins = self.rows[""][-1]
            entries = [
                LedgerEntry(
                    agent="a", layer=layer, profile=begins, cause=RevisionCause(cause=LAYER)
                )
            ]
            if new:
                self.rows[layer] = [begins]
        cause = RevisionCause(feedback_id=feedback_id)
        entries.append(LedgerEntry(agent="a", layer=layer, profile=profile, cause=cause))
        row = self.ledger.record(entries)[-1]
        if new:
            self.rows[layer].append(profile)
            self.ids[feedback_id] = (layer, len(self.rows[layer]) - 1)
        if self.ids[feedback_id] is None:
            assert not row.profile
        else:
            assert (row.layer, row.revision) == self.ids[feedback_id]

    @rule(layer=layers)
    def undo(self, layer: str) -> None:
        with contextlib.suppress(Refused):
            profile = dict(self.ledger.undo("a", layer).profile)
            self.rows[layer].append(profile)

    @rule(layer=layers)
    def reset(self, layer: str) -> None:
        with contextlib.suppress(Refused):
            self.ledger.reset("a", layer)
            self.rows[layer].append(self.authored)

    @rule(profile=profiles)
    def edit(self, profile: dict[str, float]) -> None:
        self.ledger.enter({"a": profile})
        edited = {name for name in profile if profile[name] != self.authored[name]}
        if edited:
            for layer, rows in self.rows.items():
                kept = profile if not layer else rows[-1]
                rows.append({n: profile[n] if n in edited else kept[n] for n in profile})
            self.authored = profile

    @rule(layer=st.sampled_from(["person/anna", "place/lobby"]))
    def forget(self, layer: str) -> None:
        with contextlib.suppress(Refused):
            assert self.ledger.forget([("a", layer)]) == ""
            del self.rows[layer]
            for one, where in self.ids.items():
                if where is not None and where[0] == layer:
                    self.ids[one] = None
            content = b"".join(part.read_bytes() for part in self.path.parent.iterdir())
            assert layer.encode() not in content

    @rule()
    def reopen(self) -> None:
        self.ledger.close()
        self.ledger = Ledger(self.path)

    @invariant()
    def every_revision_is_there(self) -> None:
        if hasattr(self, "ledger"):
            assert {row.layer for row in self.ledger.layers("a")} == self.rows.keys() - {""}
            for layer, rows in self.rows.items():
                history = self.ledger.history("a", layer)
                assert [dict(row.profile) for row in history] == rows
                assert [row.revision for row in history] == list(range(len(rows)))

    @invariant()
    def every_row_is_what_was_written(self) -> None:
        if hasattr(self, "ledger"):
            assert not inspect(str(self.path)).problems

    def teardown(self) -> None:
        if hasattr(self, "ledger"):
            self.ledger.close()
            self.folder.cleanup()


LedgerMachine.TestCase.settings = settings(max_examples=15, stateful_step_count=20, deadline=None)
TestLedger = LedgerMachine.TestCase


@given(
    st.dictionaries(
        st.tuples(st.sampled_from(["guide", "express"]), st.sampled_from(["", "person/anna"])),
        st.tuples(st.floats(1, 5), st.floats(1, 5)),
        min_size=1,
    )
)
@settings(max_examples=20, deadline=None)
def test_export_and_import_reproduce_the_profiles(learned):
    desks = [ManagedLedger(), ManagedLedger()]
    for (agent, layer), values in learned.items():
        named = dict(zip(("age", "mood"), values, strict=True))
        here = desks[0].ledger
        if layer and here.current(agent, layer) is None:
            here.append(agent, named, RevisionCause(cause=LAYER), layer=layer)
        desks[0].profiles.on_recorded([here.append(agent, named, RevisionCause(), layer=layer)])
    document = desks[0].execute(ManagementAction.EXPORT).document
    for _ in range(2):
        desks[1].execute(ManagementAction.IMPORT, document=document)
        assert desks[1].current_profiles() == desks[0].current_profiles()
