# SPDX-License-Identifier: Apache-2.0
"""Nodes in one process exchange messages directly, and with other processes as usual."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import pytest
from std_msgs.msg import String

import bus_cases
from bt_agents_core.errors import BtAgentsError
from bt_agents_ros import qos
from bt_agents_ros.one_process import endpoints_ignored
from bt_agents_tools.launcher.supervisor import LOOPBACK_PROFILE
from graph import Ros

LIMIT_S = 60.0


@pytest.fixture(scope="module")
def pool() -> Iterator[ProcessPoolExecutor]:
    """A process in which endpoints ignore each other, from the first case on."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as made:
        yield made


@pytest.mark.parametrize(
    "case",
    [
        bus_cases.messages_are_copies_and_facts_are_latched,
        bus_cases.times_and_bytes_are_handed_over,
        bus_cases.actions_are_handed_over,
        bus_cases.a_callback_that_raises_is_survived_and_nothing_is_lost,
    ],
    ids=lambda case: case.__name__,
)
def test_case_passes_in_one_process(pool: ProcessPoolExecutor, case: Callable[[], None]) -> None:
    pool.submit(case).result(LIMIT_S)


def test_local_traffic_starves_neither_timers_nor_other_processes(
    ros: Ros, pool: ProcessPoolExecutor
) -> None:
    ending = pool.submit(bus_cases.nobody_starves)
    told = ros.collect(String, bus_cases.OUTSIDE, qos.FACT)
    ros.until(lambda: told, LIMIT_S)
    assert told[0].data == "ready"
    go = ros.node.create_publisher(String, f"{bus_cases.OUTSIDE}/go", qos.EVENTS)
    ros.until(lambda: go.get_subscription_count() > 0)
    go.publish(String())
    ros.until(ending.done, LIMIT_S)
    ending.result()


def test_nodes_without_property_communicate_once_over_middleware() -> None:
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as fresh:
        fresh.submit(bus_cases.where_the_middleware_matches_endpoints_there_is_no_bus).result(
            LIMIT_S
        )


def properties(file: Path) -> list[tuple[str | None, str | None]]:
    spaces = {"d": "http://www.eprosima.com"}
    found = ElementTree.parse(file).getroot().iterfind(".//d:property", spaces)
    return [
        (one.findtext("d:name", None, spaces), one.findtext("d:value", None, spaces))
        for one in found
    ]


def test_patched_profile_keeps_content_and_is_temporary(tmp_path: Path) -> None:
    ignored = ("fastdds.ignore_local_endpoints", "true")
    with endpoints_ignored(str(LOOPBACK_PROFILE)) as file:
        assert properties(file) == [ignored]
        assert "<address>127.0.0.1</address>" in file.read_text()
    assert not file.exists()
    with endpoints_ignored("") as file:
        assert properties(file) == [ignored]
    broken = tmp_path / "broken.xml"
    broken.write_text("<dds>")
    with (
        pytest.raises(BtAgentsError, match=r"broken\.xml', which cannot be read: no element"),
        endpoints_ignored(str(broken)),
    ):
        pass
