# SPDX-License-Identifier: Apache-2.0
"""Strategies of other packages: found, checked, and checked again in every round."""

from __future__ import annotations

import math
import os
import re
import sys
import textwrap
from collections.abc import Mapping
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest

from market_harness import SPACE, MarketHarness, scene
from marketplace_node.explanation.explanation import explanation
from marketplace_node.explanation.reason import reason_of
from marketplace_node.round import auction, ranking
from marketplace_node.round.decision import Ranked
from marketplace_node.round.ranking import decide
from marketplace_node.strategies import STRATEGIES, Option, Score, StrategySpec, manhattan
from marketplace_node.strategies.plugins import GROUP, read_plugins
from programs import HANG_S, ROOT, output_of
from ranked_rounds import bids, decided, terms

PAGE = (ROOT / "docs" / "market.md").read_text(encoding="utf-8")
CODE, ENTRY = re.search(r"```python\n(.+?)```.*?```toml\n(.+?)```", PAGE, re.DOTALL).groups()
BROKEN = """
broken = "their_strategies:nothing"
manhattan = "their_strategies:SPEC"
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """Return a folder with the package of the page, and broken ones, as pip leaves it."""
    (tmp_path / "their_strategies.py").write_text(CODE)
    info = tmp_path / "their_strategies-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    named = ENTRY.replace('[project.entry-points."bt_agents.strategies"]', f"[{GROUP}]")
    (info / "entry_points.txt").write_text((named + BROKEN).replace('"', ""))
    return tmp_path


def test_documented_strategy_ranks_despite_broken_plugins(package: Path) -> None:
    script = """
        from market_harness import SPACE, scene
        from marketplace_node.round.ranking import decide
        from marketplace_node.strategies import STRATEGIES, add_installed
        from ranked_rounds import bids, terms

        for problem in add_installed():
            print(problem)
        of = terms(scene("s", 5.0, 1.0, 3.0), strategy="nearest_age", options={"tolerance": 0.5})
        found = decide(SPACE, of, bids({"ann": (4.0, 4.0, 4.0), "bob": (2.0, 1.0, 3.0)}))
        print([(bid.agent, bid.score) for bid in found.bids], found.fallback or "-")
    """
    path = os.pathsep.join([str(package), str(ROOT / "tests" / "harness")])
    command = [sys.executable, "-c", textwrap.dedent(script)]
    assert output_of(command, HANG_S, PYTHONPATH=path).splitlines() == [
        "strategy 'broken' of theirs (their_strategies:nothing) cannot be loaded: "
        "AttributeError: module 'their_strategies' has no attribute 'nothing'",
        "strategy 'manhattan' of theirs (their_strategies:SPEC): there is a strategy of this name "
        "already",
        "[('ann', 0.5), ('bob', 2.5)] -",
    ]


SPEC = StrategySpec(name="own", description="As manhattan.", score=manhattan)
OPTION = Option(name="c", default=1.0, minimum=0.0, maximum=1.0, description="of a test")
BAD_OPTION = "name and description as texts, and whose default lies between minimum and maximum"


class Loaded(EntryPoint):
    """An entry point whose value is its loaded object, or the error of loading it."""

    def load(self) -> Any:
        if isinstance(self.value, BaseException):
            raise self.value
        return self.value


def spec(**changes: Any) -> StrategySpec:
    return replace(SPEC, **({"name": "x"} | changes))


def with_option(**changes: Any) -> StrategySpec:
    return spec(options=(replace(OPTION, **changes),))


@pytest.mark.parametrize(
    ("name", "unfit", "words"),
    [
        ("Own", SPEC, "cannot be the name of a strategy"),
        ("x", SystemExit("no licence\nbye"), "cannot be loaded: SystemExit: no licence bye"),
        ("x", manhattan, "is a function, expected a marketplace_node.strategies.StrategySpec"),
        ("x", SPEC, "calls itself 'own'; both names must be the same"),
        ("x", spec(options=(OPTION,) * 2), "two options have the same name"),
        ("x", with_option(default=5.0), BAD_OPTION),
        ("x", with_option(minimum="a"), BAD_OPTION),
        ("x", with_option(default=None), BAD_OPTION),
        ("x", with_option(name=3), BAD_OPTION),
        ("x", with_option(description=None), BAD_OPTION),
        ("x", spec(score=None), "'score' is not a function"),
        ("x", spec(description=None), "'description' is not a text"),
    ],
)
def test_invalid_strategy_is_reported_with_explanation(name: str, unfit: Any, words: str) -> None:
    own: Any = SPEC
    specs, problems = read_plugins([Loaded(name, unfit, GROUP), Loaded("own", own, GROUP)])

    assert (list(specs), len(problems)) == (["own"], 1)
    assert words in problems[0]


def test_printing_package_leaves_standard_output_alone(capsys: pytest.CaptureFixture[str]) -> None:
    class Chatty(EntryPoint):
        def load(self) -> Any:
            print("Hello from this package")
            return SPEC

    specs, _ = read_plugins([Chatty("own", "theirs:SPEC", GROUP)])

    assert list(specs) == ["own"]
    assert capsys.readouterr() == ("", "Hello from this package\n")


def not_finite(given: Any, options: Mapping[str, float], random: Any) -> list[Score]:
    return [one._replace(score=math.nan) for one in manhattan(given, options, random)]


def too_short(given: Any, options: Mapping[str, float], random: Any) -> list[Score]:
    return manhattan(given, options, random)[:-1]


def without_parts(given: Any, options: Mapping[str, float], random: Any) -> list[Score]:
    return [one._replace(contributions=(1.0,)) for one in manhattan(given, options, random)]


def no_scores(given: Any, options: Mapping[str, float], random: Any) -> Any:
    return [sum(bid.profile) for bid in given.bids]


def raising(given: Any, options: Mapping[str, float], random: Any) -> list[Score]:
    raise KeyError("temperature")


def leaving(given: Any, options: Mapping[str, float], random: Any) -> list[Score]:
    sys.exit("broken\nstrategy")


def meddling(given: Any, options: Mapping[str, float], random: Any) -> list[Score]:
    given.bids[0].profile[0] = 3.0
    return manhattan(given, options, random)


def ranked_by(score: Any, patch: pytest.MonkeyPatch, **changes: Any) -> Ranked:
    spec = StrategySpec(name="theirs", description="Of somebody else.", score=score)
    patch.setattr(ranking, "STRATEGIES", {**STRATEGIES, "theirs": spec})
    of = terms(scene("s", 3.0, 3.0, 3.0), **changes)
    return decide(SPACE, of, bids({"ann": (4.0, 4.0, 4.0), "bob": (3.0, 3.0, 3.5)}))


BAD = {
    not_finite: "strategy theirs: the score of ann is not finite",
    too_short: "strategy theirs: it returns 1 scores for 2 bids",
    without_parts: "strategy theirs: ann has 1 contributions, expected 3",
    no_scores: "strategy theirs raised TypeError: cannot unpack non-iterable float object",
    raising: "strategy theirs raised KeyError: 'temperature'",
    leaving: "strategy theirs raised SystemExit: broken strategy",
    meddling: "strategy theirs raised TypeError: 'tuple' object does not support item assignment",
}


@pytest.mark.parametrize("score", BAD)
def test_failing_strategy_is_named_and_manhattan_ranks(
    score: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = ranked_by(score, monkeypatch, strategy="theirs")
    assert found.fallback == BAD[score]
    assert (found.by, [bid.agent for bid in found.bids]) == ("manhattan", ["bob", "ann"])

    watched = ranked_by(score, monkeypatch, shadow="theirs")
    assert (watched.shadow_winner, watched.fallback, watched.by) == ("", "", "manhattan")
    assert watched.shadow_failure == BAD[score]


def test_sum_shows_what_a_strategy_adds(monkeypatch: pytest.MonkeyPatch) -> None:
    def tolerant(given: Any, options: Mapping[str, float], random: Any) -> list[Score]:
        return [Score.of([0.0, -0.5, 1.0]) for _ in given.bids]

    spec = replace(SPEC, name="theirs", score=tolerant)
    monkeypatch.setattr(ranking, "STRATEGIES", {**STRATEGIES, "theirs": spec})
    decision = decided(
        terms(scene("s", 3.0, 3.0, 3.0), strategy="theirs"), bids({"ann": (4.0, 3.5, 4.0)})
    )

    assert reason_of(decision).startswith("ann 0.5 = 0 + −0.5 + |4−3|")
    assert (
        "ann is 0.5 away: mood adds 1 (profile 4, scene 3), familiarity adds −0.5 (profile 3.5, "
        "scene 3), age adds nothing."
    ) in explanation(decision, SPACE)


def test_explanation_mentions_failing_shadow(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = replace(SPEC, name="theirs", score=raising)
    monkeypatch.setattr(ranking, "STRATEGIES", {**STRATEGIES, "theirs": spec})
    decision = decided(terms(shadow="theirs"), bids({"ann": (4.0, 4.0, 4.0)}))

    assert explanation(decision, SPACE).splitlines()[-1] == (
        "The shadow strategy fails: strategy theirs raised KeyError: 'temperature'."
    )


def test_round_with_failing_ranking_ends_without_award(
    market: MarketHarness, monkeypatch: pytest.MonkeyPatch
) -> None:
    def breaks(*_: Any, **__: Any) -> Ranked:
        raise RuntimeError("out of order")

    monkeypatch.setattr(auction, "decide", breaks)
    market.award()

    assert market.ends == [("s1", "NO_BIDS")]
    assert "the bids could not be ranked: RuntimeError: out of order" in market.auction.reason
