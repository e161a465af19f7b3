# SPDX-License-Identifier: Apache-2.0
"""The studio's own operations: answers, messages, dry runs, strategies, kept values, links."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from bt_agents_core.errors import BtAgentsError, Refusal, Refused, RefusedElsewhere
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_studio.access import is_loopback
from bt_agents_studio.projection.conversion import parameter_value
from bt_agents_studio.projection.market import round_record
from bt_agents_studio.records import (
    DryRunRecord,
    KeepRecord,
    MarketRecord,
    ParameterRecord,
    PersonLinkRecord,
    SceneMapRecord,
    StrategiesRecord,
    StrategyOptionRecord,
)
from bt_agents_studio.scene_map import ASKED, computed_map, is_computed, map_record, places
from bt_agents_studio.studio import Studio
from bt_agents_tools.client.file_edits import FileEdit, compare_tests, digest_of, edits_of
from bt_agents_tools.client.strategies import (
    Strategies,
    changed_parameters,
    parameter_names,
    strategies_of,
)
from bt_agents_tools.client.write_back import ParameterState

if TYPE_CHECKING:
    from bt_agents_studio.node import StudioNode

LIMIT_S = 60.0
"""Longest time of one operation, including tests of agents [s]."""

_PREVIEW_S = 5.0
_STRATEGY_S = 5.0

TunedHosts = Mapping[str, tuple[Path, Sequence[ParameterState]]]
"""Host → its trees folder, and its parameters and profile values."""


class OwnOperations:
    """The studio's own operations, done by modules of the command line.

    Args:
        studio: Studio with the scene parameters.
        node: Calls services and publishes messages.
        person_address: Address of the page Person, including the token.
    """

    def __init__(self, studio: Studio, node: StudioNode, person_address: str) -> None:
        self._studio = studio
        self._node = node
        self._person_address = person_address
        # One at a time, so that two pages never write the same file together.
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="own")
        self._done: Mapping[str, Callable[..., Awaitable[Mapping[str, object]]]] = {
            "answer": self._answer,
            "dry_run": self._dry_run,
            "keep": self._keep,
            "person_link": self._person_link,
            "publish": self._publish,
            "strategy": self._strategy,
        }

    async def do(self, name: str, fields: Mapping[str, Any]) -> Mapping[str, object]:
        """Do an operation; return its answer, which may have a ``record``."""
        try:
            async with asyncio.timeout(LIMIT_S):
                return await self._done[name](**fields)
        except Refusal as refused:
            code, reason = refused.code, refused.reason
        except BtAgentsError as error:
            code, reason = "", str(error)
        except TimeoutError:
            code, reason = RefusalCode.NO_ANSWER, f"it took longer than {LIMIT_S:g} s"
        return {"accepted": False, "code": code, "message": reason}

    def close(self) -> None:
        """Start no more operations."""
        self._worker.shutdown(wait=False, cancel_futures=True)

    async def _answer(self, text: str = "") -> Mapping[str, object]:
        return _accepted(await asyncio.wrap_future(self._node.answer(text)))

    async def _publish(self, topic: str = "", values: Sequence[str] = ()) -> Mapping[str, object]:
        return _accepted(await asyncio.wrap_future(self._node.publish(topic, values)))

    async def _person_link(self) -> Mapping[str, object]:
        record = PersonLinkRecord(
            address=self._person_address,
            is_local=is_loopback(urlsplit(self._person_address).hostname or ""),
        )
        return _accepted("", record)

    async def _dry_run(
        self,
        names: Sequence[str] = (),
        values: Sequence[float] = (),
        across: str = "",
        up: str = "",
    ) -> Mapping[str, object]:
        given = dict(zip(names, values, strict=False))
        sides = {one.name: one for one in self._studio.parameters}
        shown = (across, up) if across or up else ()
        for name in (*given, *shown):
            if name not in sides:
                raise Refused(
                    RefusalCode.UNKNOWN_PARAMETER,
                    f"no scene parameter '{name[:40]}'; there are {', '.join(sides)}",
                )
        scene = {name: given.get(name, math.nan) for name in sides}
        if any(math.isnan(scene[name]) for name in shown):
            raise Refused(
                RefusalCode.BAD_FIELD,
                f"'{across}' and '{up}' are the sides of the map, and need a value",
            )
        auction = await self._preview(scene)
        found = await self._map(auction, scene, sides[across], sides[up]) if shown else None
        record = DryRunRecord(round=round_record(auction), map=found)
        return _accepted(auction.reason, record)

    async def _map(
        self,
        auction: Any,
        scene: Mapping[str, float],
        across: ParameterRecord,
        up: ParameterRecord,
    ) -> SceneMapRecord:
        strategy, bids, tie_break = auction.strategy, auction.ranking, auction.tie_break
        if not (is_computed(strategy) and bids):
            return await self._asked_map(scene, across, up)
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(
            self._worker, computed_map, strategy, bids, scene, across, up, tie_break
        )

    async def _asked_map(
        self, scene: Mapping[str, float], across: ParameterRecord, up: ParameterRecord
    ) -> SceneMapRecord:
        xs, ys = places(across, ASKED), places(up, ASKED)
        winners = []
        for y in ys:
            row = []
            for x in xs:
                place = {**scene, across.name: x, up.name: y}
                row.append(str((await self._preview(place)).winner))
            winners.append(row)
        return map_record(across, up, xs, ys, winners, is_asked=True)

    async def _preview(self, scene: Mapping[str, float]) -> Any:
        answer = await asyncio.wrap_future(self._node.preview(scene, _PREVIEW_S))
        if not answer.accepted:
            raise RefusedElsewhere(str(answer.code), str(answer.message))
        return answer.auction

    async def _strategy(
        self, name: str = "", options: Sequence[str] = (), values: Sequence[float] = ()
    ) -> Mapping[str, object]:
        """Return the strategies of the market, after setting the given strategy and options."""
        if len(options) != len(values):
            raise Refused(RefusalCode.BAD_FIELD, "'values' needs one value for each of 'options'")
        found = await self._strategies()
        changes = changed_parameters(found, name, zip(options, values, strict=True))
        message = ""
        if changes:
            setting = self._node.set_market_parameters(changes, _STRATEGY_S)
            result = (await asyncio.wrap_future(setting)).result
            if not result.successful:
                raise BtAgentsError(str(result.reason or "it gives no reason"))
            found = await self._strategies()
            message = f"{found.current} ranks the bids from the next round on"
        record = StrategiesRecord(
            options={
                name: tuple(
                    StrategyOptionRecord(name=key, **vars(one)) for key, one in options.items()
                )
                for name, options in found.options.items()
            }
        )
        return _accepted(message, record)

    async def _strategies(self) -> Strategies:
        market = self._studio.store.get("market")
        infos = market.strategies if isinstance(market, MarketRecord) else ()
        asked = {"names": parameter_names(infos)}
        described = await self._read("marketplace/describe_parameters", asked)
        got = await self._read("marketplace/get_parameters", asked)
        values = [parameter_value(one) for one in got.values]
        return strategies_of(infos, described.descriptors, values)

    async def _read(self, service: str, asked: Mapping[str, Any]) -> Any:
        return await asyncio.wrap_future(self._node.call(service, asked, _STRATEGY_S))

    async def _keep(self, profile: bool = False, digest: str = "") -> Mapping[str, object]:
        hosts = await asyncio.wrap_future(self._node.tuned())
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._worker, _keep, hosts, profile, digest)


def _keep(hosts: TunedHosts, profile: bool, digest: str) -> Mapping[str, object]:
    """Return the changes of the files; write them if the request has their digest."""
    edits: list[FileEdit] = []
    for host, (folder, states) in hosts.items():
        edits += edits_of(host, folder, states, profile=profile)
    found = digest_of(edits)
    if digest and digest != found:
        raise Refused(
            RefusalCode.CHANGED_MEANWHILE,
            "the values or the files have changed since the change was shown; look at it again",
        )
    if not edits:
        record = KeepRecord(diff="", tests=(), breaks=False, digest="")
        return _accepted("nothing to keep: everything stands as the files say", record)
    if digest:
        for edit in edits:
            edit.write()
        changes = [f"{change}  in {edit.path}" for edit in edits for change in edit.changes]
        return _accepted("\n".join(changes))
    tests = compare_tests(edits)
    record = KeepRecord(
        diff="".join(edit.diff for edit in edits),
        tests=tests.lines,
        breaks=tests.breaks,
        digest=found,
    )
    return _accepted("this would change", record)


def _accepted(message: str, record: object = None) -> Mapping[str, object]:
    """Return the answer to an operation that was done."""
    answer = {"accepted": True, "code": "", "message": message}
    return answer if record is None else {**answer, "record": record}
