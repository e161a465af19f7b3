# SPDX-License-Identifier: Apache-2.0
"""Cards of hosts, current profiles, and profiles that a host does not have yet."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from bt_agents_core.errors import Refused
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.scene import SceneSpace
from bt_agents_language.files.mood_rule_reader import restore_mood_rule
from feedback_node.learning.cards import AgentEntry, LearningEntry, read_card
from feedback_node.learning.profiles import MOST_HOSTS, Delivery, ProfileChange, Profiles
from feedback_node.ledger import Ledger
from learning_cards import card, entry
from scene_spaces import AGE_AND_MOOD as SPACE

NAN = math.nan
GUIDE = entry(profile=(4.0, 3.0))
EXPRESS = entry("express", (2.0, 3.0))


def profiles(*agents: AgentEntry, ledger: Ledger | None = None) -> Profiles:
    known = Profiles(SPACE, ledger or Ledger(":memory:"))
    known.register_card(card(*agents))
    return known


def teach(known: Profiles, agent: str = "guide", feedback_id: str = "f1") -> ProfileChange:
    return known.apply(
        agent,
        FeedbackKind.DIRECT,
        (5.0, NAN),
        feedback_id=feedback_id,
        source="t",
        reason="",
        run=None,
    )


@pytest.mark.parametrize(
    ("bad", "code"),
    [
        (replace(GUIDE, name=""), "BAD_NAME"),
        (replace(GUIDE, name="express"), "BAD_NAME"),
        (replace(GUIDE, profile=(4.0,)), "WRONG_LENGTH"),
        (replace(GUIDE, profile=(4.0, NAN)), "NOT_FINITE"),
        (replace(GUIDE, profile=(4.0, 7.0)), "OUT_OF_RANGE"),
        (replace(GUIDE, learning_rate=1.5), "OUT_OF_RANGE"),
    ],
)
def test_invalid_card_entry_does_not_affect_other_entries(bad, code):
    agents, problems = read_card(card(EXPRESS, bad), SPACE)
    assert [agent.name for agent in agents] == ["express"]
    [problem] = problems
    assert problem.startswith(f"{code}: card of /agents: agent '{bad.name}'")


def test_unreadable_rule_is_reported_with_every_card():
    good = restore_mood_rule(SPACE, when="mood.change >= 1", hold_s=1.0, give=1)
    bad = Refused("BAD_RULE", "rule 'moood > 1': there is no name 'moood' here")
    guide = card(entry(rules=(good,), invalid_rules=(bad,)))
    (agent,), problems = read_card(guide, SPACE)
    assert agent.entry.rules == (good,)
    assert problems == (
        "BAD_RULE: card of /agents: agent 'guide': rule 'moood > 1': there is no name 'moood' "
        "here; the rule is skipped",
    )
    assert read_card(guide, SPACE, {"guide": agent})[1] == problems


@pytest.mark.parametrize("parameters", [(), ("age",), ("mood", "age"), ("age", "stress")])
def test_card_with_other_parameters_is_rejected(parameters):
    with pytest.raises(Refused, match="OTHER_PARAMETERS"):
        read_card(replace(card(GUIDE), parameters=parameters), SPACE)


@pytest.mark.parametrize("host", ["", "agents"])
def test_card_without_full_host_name_is_rejected(host):
    with pytest.raises(Refused, match="BAD_NAME"):
        read_card(card(GUIDE, host=host), SPACE)


# --- learning rules of cards ------------------------------------------------------------

PLAIN = LearningEntry(update="plain", window=5, rates=(NAN, NAN))


@pytest.mark.parametrize(
    "learning",
    [
        replace(PLAIN, update="medium"),
        replace(PLAIN, rates=(0.1,)),
        replace(PLAIN, rates=(0.1, 1.1)),
        replace(PLAIN, width=(-1.0, NAN)),
        replace(PLAIN, update="median", window=0),
        replace(PLAIN, update="median", window=1000),
        replace(PLAIN, anneal=-1.0),
        replace(PLAIN, drift=(4.5, NAN)),
        replace(PLAIN, retreat=(5.5, NAN)),
        replace(PLAIN, sources=("button",)),
        replace(PLAIN, sources=("button",), weights=(NAN,)),
        replace(PLAIN, sources=("button",), weights=(1e9,)),
        replace(PLAIN, layers=("persons",)),
        replace(PLAIN, general=1.5),
    ],
)
def test_invalid_learning_entry_does_not_affect_other_agents(learning):
    agents, problems = read_card(card(entry("bad", learning=learning), entry("good")), SPACE)
    assert [agent.name for agent in agents] == ["good"]
    [problem] = problems
    assert problem.startswith("BAD_LEARNING: card of /agents: agent 'bad'")


def test_unchanged_agent_of_card_is_not_parsed_again():
    rule = restore_mood_rule(SPACE, when="mood.change > 1", hold_s=1.0, give=1)
    guide = entry(learning=replace(PLAIN, rates=(math.nan, math.nan)), rules=(rule,))

    def read(one, known=(), host="/agents"):
        (agent,), problems = read_card(
            card(one, host=host), SPACE, {one.name: one for one in known}
        )
        assert problems == ()
        return agent

    first = read(guide)
    again = replace(PLAIN, rates=(float("nan"), float("nan")))
    later = read(replace(guide, revision=7, learning=again), [first])
    assert (later.entry.revision, later.entry.rules) == (7, first.entry.rules)
    assert later.learning is first.learning
    others = (
        replace(guide, rules=(replace(rule, hold_s=2.0),)),
        replace(guide, learning=replace(PLAIN, anneal=0.5)),
        replace(guide, learning_rate=0.3),
        replace(guide, profile=(3.0, 4.0)),
    )
    for other in others:
        assert read(other, [first]) == read(other)
        assert read(other, [first]).learning is not first.learning
    assert read(guide, [first], host="/other").host == "/other"


# --- current profiles ---------------------------------------------------------------------


def test_new_agent_has_no_pending_delivery():
    known = Profiles(SPACE, Ledger(":memory:"))
    assert known.register_card(card(GUIDE)) == ((), ())
    assert known.table() == (("guide", "", 0, (4.0, 3.0)),)


def test_feedback_moves_profile_by_rate_of_card():
    known = profiles(GUIDE, EXPRESS)
    change = teach(known)
    assert (change.before, change.after) == ((4.0, 3.0), (4.5, 3.0))
    assert change.target == pytest.approx((5.0, NAN), nan_ok=True)
    assert change.revision.cause.rate == 0.5
    assert known.delivery("guide") == Delivery(
        host="/agents", agent="guide", values=(4.5, 3.0), revision=1
    )
    assert known.table() == (("express", "", 0, (2.0, 3.0)), ("guide", "", 1, (4.5, 3.0)))


def test_restarted_host_receives_learned_profile():
    known = profiles(GUIDE, EXPRESS)
    teach(known)
    deliveries, _ = known.register_card(card(GUIDE, EXPRESS))
    assert deliveries == (known.delivery("guide"),)
    assert known.register_card(card(replace(GUIDE, revision=1), EXPRESS)) == ((), ())


def test_returning_agent_gets_its_learned_profile_back():
    known = profiles(GUIDE, EXPRESS)
    teach(known)
    known.register_card(card(EXPRESS))
    with pytest.raises(Refused, match="known are: express"):
        teach(known, feedback_id="f2")
    deliveries, _ = known.register_card(card(GUIDE, EXPRESS))
    assert [one.values for one in deliveries] == [(4.5, 3.0)]


def test_empty_instance_takes_no_agents_from_another_instance():
    known = profiles(GUIDE, EXPRESS)
    assert known.register_card(card(instance="i2")) == ((), ())
    assert known.table() == (("express", "", 0, (2.0, 3.0)), ("guide", "", 0, (4.0, 3.0)))
    known.register_card(card())
    assert known.table() == ()


def test_instance_with_agents_replaces_previous_instance():
    known = profiles(GUIDE, EXPRESS)
    known.register_card(card(GUIDE, instance="i2"))
    assert [name for name, *_ in known.table()] == ["guide"]
    known.register_card(card(instance="i1"))
    assert [name for name, *_ in known.table()] == ["guide"]
    known.register_card(card(instance="i2"))
    assert known.table() == ()


def test_hosts_are_bounded_and_empty_host_makes_room():
    known = Profiles(SPACE, Ledger(":memory:"))
    for number in range(MOST_HOSTS):
        known.register_card(card(replace(GUIDE, name=f"a{number}"), host=f"/h{number}"))
    with pytest.raises(Refused, match="TOO_MANY_HOSTS: card of /more: 100 hosts are there"):
        known.register_card(card(GUIDE, host="/more"))
    known.register_card(card(host="/h7"))
    known.register_card(card(GUIDE, host="/more"))
    assert len(known.hosts) == MOST_HOSTS


def test_forged_hosts_evict_only_each_other():
    known = Profiles(SPACE, Ledger(":memory:"), is_there=lambda host: host == "/slow")
    # One is present, one has not come yet, and one is gone.
    for name in ("slow", "new", "gone"):
        known.register_card(card(replace(GUIDE, name=name), host=f"/{name}"))
    for number in range(2 * MOST_HOSTS):
        forged = replace(GUIDE, name=f"a{number}")
        known.register_card(card(forged, host=f"/h{number}"))
    kept = {"/slow", "/new", "/gone", *(f"/h{number}" for number in range(MOST_HOSTS - 4))}
    assert known.hosts == {*kept, f"/h{2 * MOST_HOSTS - 1}"}
    known.register_card(card(GUIDE, host="/more"))
    assert known.hosts == {*kept, "/more"}


def test_agent_at_second_host_is_reported_and_moves():
    known = profiles(GUIDE)
    _, problems = known.register_card(card(GUIDE, host="/others"))
    assert [problem.split(":")[0] for problem in problems] == ["TWO_HOSTS"]
    assert known.delivery("guide").host == "/others"


@pytest.mark.parametrize(
    ("held", "problem"),
    [({"revision": 12}, "STALE_LEDGER"), ({"current": (5.0, 5.0)}, "OTHER_PROFILE")],
)
def test_host_with_differing_profile_is_listed_until_corrected(held, problem):
    known = profiles(GUIDE)
    assert known.differing == ()
    deliveries, problems = known.register_card(card(replace(GUIDE, **held)))
    assert deliveries == (known.delivery("guide"),)
    assert [problem.split(":")[0] for problem in problems] == [problem]
    assert known.differing == ("guide",)

    mended = replace(GUIDE, current=known.profile("guide"))
    assert known.register_card(card(mended)) == ((), ())
    assert known.differing == ()


def test_agent_with_undelivered_profile_is_listed_until_confirmed():
    known = profiles(GUIDE)
    known.not_delivered("nobody")
    known.not_delivered("guide")
    assert known.differing == ("guide",)
    known.register_card(card(replace(GUIDE, current=known.profile("guide"))))
    assert known.differing == ()
    known.not_delivered("guide")
    known.register_card(card())
    assert known.differing == ()


def test_narrowed_range_clamps_learned_profile():
    ledger = Ledger(":memory:")
    teach(profiles(GUIDE, ledger=ledger))
    narrow = SceneSpace(
        parameters=tuple(replace(parameter, maximum=4.2) for parameter in SPACE.parameters)
    )
    restarted = Profiles(narrow, ledger)
    assert [one.values for one in restarted.register_card(card(GUIDE))[0]] == [(4.2, 3.0)]


def test_failed_ledger_write_leaves_profile_unchanged():
    ledger = Ledger(":memory:")
    known = profiles(GUIDE, ledger=ledger)
    ledger._database.execute("PRAGMA query_only = ON")
    with pytest.raises(Refused, match="LEDGER_FAILED"):
        teach(known)
    assert known.table() == (("guide", "", 0, (4.0, 3.0)),)
