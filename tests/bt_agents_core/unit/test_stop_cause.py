# SPDX-License-Identifier: Apache-2.0
"""Stop causes as values of ``cancel.by``."""

from __future__ import annotations

import pytest

from bt_agents_core.stop_cause import STOPPERS, StopCause, StoppedBy, stopper


@pytest.mark.parametrize(
    ("cause", "by", "word"),
    [
        (StopCause.BY_MARKET, StoppedBy.OPERATOR, "operator"),
        (StopCause.BY_MARKET, StoppedBy.MOOD_RULE, "mood rule"),
        (StopCause.BY_MARKET, StoppedBy.OTHER_SCENE, "other scene"),
        (StopCause.BY_MARKET, StoppedBy.NOT_SAID, "market"),
        (StopCause.MARKET_LOST, StoppedBy.NOT_SAID, "market"),
        (StopCause.BY_HOST, StoppedBy.NOT_SAID, "host"),
    ],
)
def test_each_stop_cause_has_word_usable_in_files(
    cause: StopCause, by: StoppedBy, word: str
) -> None:
    assert stopper(cause, by) == word
    assert word in STOPPERS


@pytest.mark.parametrize("number", [-1, 4, 255])
def test_unknown_stopper_number_means_not_said(number: int) -> None:
    assert StoppedBy.of(number) is StoppedBy.NOT_SAID
