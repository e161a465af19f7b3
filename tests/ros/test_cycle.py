# SPDX-License-Identifier: Apache-2.0
"""One cycle from a reading to the next bid: it uses the files named in docs/architecture.md."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rclpy.parameter import Parameter
from std_msgs.msg import Bool, Empty, Float64

from bt_agents_interfaces.msg import SceneValue
from bt_agents_interfaces.srv import Analyze, GiveFeedback
from bt_agents_robot.robot import RobotNode
from bt_agents_ros import qos
from checkout import ROOT
from whole_system import System, write_agents

TREE = 'tree: {sequence: [{say: Hello.}, {wait: "0.1 s"}]}'
READINGS = {"present": True, "age": 85.0, "visits": 10.0, "valence": 0.0}


def named() -> list[str]:
    """Return the files that the page names, including those that the steps ask."""
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    way = page.partition("## The way of one cycle")[2].partition("\nNot named")[0]
    lines = re.findall(r"^(?:\d+\.|-) (.*)", way, re.MULTILINE)
    return [path for line in lines for path in re.findall(r"`([\w/]+\.py)`", line)]


@contextmanager
def entered() -> Iterator[set[str]]:
    """Collect the files of all called functions."""
    found: set[str] = set()
    sys.setprofile(lambda frame, _event, _argument: found.add(frame.f_code.co_filename))
    try:
        yield found
    finally:
        sys.setprofile(None)


def test_cycle_passes_every_file_named_on_page(ros: Any, tmp_path: Path) -> None:
    trees = write_agents(tmp_path, young=1.5, old=4.5)
    for file in (trees / "agents").iterdir():
        file.write_text(re.sub(r"^tree:\n.*$", TREE, file.read_text(), flags=re.MULTILINE))
    silent = Parameter("voice", value="off")
    robot = ros.add(RobotNode(parameter_overrides=[silent, Parameter("pace", value=10.0)]))
    system = System(ros, trees)
    # Recording each call is so slow that heartbeats are late.
    for node, lease in (
        (system.market, "host_lease"),
        (system.host, "market_lease"),
        (robot, "host_lease"),
    ):
        [done] = node.set_parameters([Parameter(lease, value=10.0)])
        assert done.successful, done.reason
    publishers = {
        name: ros.node.create_publisher(
            Bool if value is True else Float64, f"person/{name}", qos.EVENTS
        )
        for name, value in READINGS.items()
    }
    trigger = ros.node.create_publisher(Empty, "scene_layer/trigger", qos.EVENTS)
    everybody = (*publishers.values(), trigger)
    ros.until(lambda: all(one.get_subscription_count() for one in everybody))

    def is_sensed() -> bool:
        for name, value in READINGS.items():
            message = Bool(data=value) if value is True else Float64(data=value)
            publishers[name].publish(message)
        scene = system.analyze(announce=False, person=Analyze.Request.AS_MEASURED).scene
        measured = {one.origin == SceneValue.MEASURED for one in scene.values}
        return bool(scene.person) and measured == {True}

    def encounter(count: int) -> None:
        ros.until(is_sensed)
        trigger.publish(Empty())
        ros.until(lambda: len(system.ends) == count)

    with entered() as files:
        encounter(1)
        values = [5.0, 3.0, 3.0]
        assert ros.ask(GiveFeedback, "feedback/give", values=values, source="button").accepted
        encounter(2)

    before, after = (auction.ranking[0].vector[0] for auction in system.auctions)
    assert before == 4.5
    assert after > before
    assert [path for path in named() if str(ROOT / path) not in files] == []
