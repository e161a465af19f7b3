# SPDX-License-Identifier: Apache-2.0
"""Experiments through the real ROS graph: market, host, feedback node and scene layer."""

from __future__ import annotations

import json
import math
import os
import tempfile
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.scene import SceneSpace, Vector
from bt_agents_lab.results import ResultRow, row_of_feedback, rows_of_auction
from bt_agents_language.files.folder_reader import Trees
from bt_agents_language.model.experiment import ExperimentSpec, FeedbackRecord
from bt_agents_ros.signals import Interrupt
from bt_agents_tools.cli.formatting import progress_bar
from bt_agents_tools.launcher import components
from bt_agents_tools.launcher.domain_lock import reserve_domain
from bt_agents_tools.launcher.log_files import new_log_folder
from bt_agents_tools.launcher.supervisor import Component, Supervisor, set_discovery
from marketplace_node.settings import Settings

_STALL_S = 30.0
_POLL_S = 0.2


def through_ros(
    folder: Trees, spec: ExperimentSpec, settings: Settings, on_result: Callable[[ResultRow], None]
) -> list[FeedbackRecord]:
    """Play a whole experiment and return its rounds.

    Only the strategy, its options and the tie rule of the settings count. The rows of the table of
    results are passed on at the end.

    Raises:
        BtAgentsError: A part did not start, died or stalled.
        KeyboardInterrupt: It was interrupted, and all parts have ended.
    """
    if "ROS_DOMAIN_ID" not in os.environ:
        os.environ["ROS_DOMAIN_ID"] = str(reserve_domain())
    set_discovery(os.environ)
    path, space = folder.folder, folder.scene.space
    with tempfile.TemporaryDirectory(prefix="bt-agents-experiment-") as scratch:
        script = Path(scratch) / "script.yaml"
        script.write_text(_script(spec, space), encoding="utf-8")
        prepared = Path(scratch) / "experiment.yaml"
        prepared.write_text(prepared_experiment(spec, space), encoding="utf-8")
        market = components.market(path, strategy=settings.strategy)
        ranking: dict[str, str | float] = {"tie_break": settings.tie_break, **settings.options}
        supervisor = Supervisor(new_log_folder())
        interrupt = Interrupt()
        try:
            supervisor.start(
                replace(market, parameters={**market.parameters, **ranking}),
                components.host(path),
                components.feedback(path, ledger=":memory:", simulated=prepared),
            )
            scenes = components.scene_layer(path, script, agents=len(folder.agents))
            records = _record(supervisor, scenes, len(folder.agents), spec, interrupt, on_result)
        finally:
            if interrupt:
                supervisor.kill()
            supervisor.stop()
            interrupt.release()
        if interrupt:
            raise KeyboardInterrupt
        return records


def _record(
    supervisor: Supervisor,
    scenes: Component,
    agents: int,
    spec: ExperimentSpec,
    interrupt: Interrupt,
    on_result: Callable[[ResultRow], None],
) -> list[FeedbackRecord]:
    from bt_agents_tools.client.observer import Observer

    with closing(Observer()) as observer:
        auctions = observer.received("bt_agents/auctions")
        feedbacks = observer.received("bt_agents/feedback")

        def is_complete() -> bool:
            """Return whether the last round is there, with its decision, which may come later."""
            enough = len(feedbacks) >= spec.rounds
            return enough and any(one.round == feedbacks[-1].round for one in reversed(auctions))

        observer.spin_until(
            lambda: bool(interrupt or supervisor.failure()) or observer.ready(agents), _STALL_S
        )
        if not interrupt and not observer.ready(agents):
            raise BtAgentsError(
                supervisor.failure()
                or f"not ready after {_STALL_S:g} s; the logs are in "
                f"{supervisor.log('agents').parent}"
            )
        supervisor.start(scenes)
        with progress_bar() as progress:
            task = progress.add_task(spec.title, total=spec.rounds)
            last_change = time.monotonic()
            while not is_complete() and not interrupt:
                before = len(feedbacks)
                observer.spin_until(is_complete, _POLL_S)
                progress.update(task, completed=len(feedbacks))
                if len(feedbacks) > before:
                    last_change = time.monotonic()
                if supervisor.failure():
                    raise BtAgentsError(supervisor.failure())
                if time.monotonic() - last_change > _STALL_S:
                    raise BtAgentsError(
                        f"no round for {_STALL_S:g} s after {before} of {spec.rounds}; the logs "
                        f"are in {supervisor.log('agents').parent}"
                    )
    for auction in auctions:
        for row in rows_of_auction(auction):
            on_result(row)
    for index, feedback in enumerate(feedbacks):
        on_result(row_of_feedback(feedback, spec.feedback.is_wrong(index)))
    scenes_by_round = {one.round: tuple(v.value for v in one.scene.values) for one in auctions}
    return [
        FeedbackRecord(
            round=one.round,
            scene=scenes_by_round.get(one.round, ()),
            winner=one.agent,
            before=tuple(one.before),
            after=tuple(one.after),
        )
        for one in feedbacks
    ]


def _script(spec: ExperimentSpec, space: SceneSpace) -> str:
    visits = [
        {"label": f"scene {number}", "scene": dict(zip(space.names, vector, strict=True))}
        for number, vector in enumerate(spec.order(), start=1)
    ]
    # JSON is also YAML.
    return json.dumps({"format": 1, "title": "an experiment", "visits": visits}, indent=1)


def prepared_experiment(spec: ExperimentSpec, space: SceneSpace) -> str:
    """Return the experiment as a file with the requested seed."""

    def named(vector: Vector) -> dict[str, float]:
        pairs = zip(space.names, vector, strict=False)
        return {name: value for name, value in pairs if not math.isnan(value)}

    feedback: dict[str, Any] = {
        "each": {agent: named(vector) for agent, vector in spec.feedback.each.items()},
        "sequences": {
            agent: [named(vector) for vector in rows]
            for agent, rows in spec.feedback.sequences.items()
        },
        "sequence": [named(vector) for vector in spec.feedback.sequence],
        "repeat": spec.feedback.repeat,
    }
    if (errors := spec.feedback.errors) is not None:
        when = {"every": errors.every} if errors.every else {"share": errors.share}
        value = {} if errors.value is None else {"value": named(errors.value)}
        feedback["errors"] = {**when, **value}
    document = {
        "format": 1,
        "rounds": spec.rounds,
        "seed": spec.seed,
        "scenes": [named(vector) for vector in spec.scenes],
        "feedback": feedback,
    }
    return json.dumps(document, indent=1)
