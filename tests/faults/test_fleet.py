# SPDX-License-Identifier: Apache-2.0
"""Robots that learn together over a real database: outages, hostile rows, and sharing."""

from __future__ import annotations

import contextlib
import re
import socket
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import partial
from importlib.resources import files
from pathlib import Path
from threading import Thread

import pytest
import yaml

from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.feedback import FeedbackKind, Share
from bt_agents_fleet.database import FleetDatabase, FleetError, checked_address
from bt_agents_fleet.fleet_sync import FleetSync
from feedback_node.learning.fleet_steps import base_of
from feedback_node.ledger.check import check
from feedback_node.ledger.file import connect
from fleet_harness import LIMIT_S, FleetRobot, synchronise
from ledger_fixture import SPACE
from postgres_server import PostgresServer, running_server
from simulated_fleet import NAN, Clock, largest_difference, learning

pytestmark = pytest.mark.e2e

BASE = base_of({"age": 3.0, "mood": 3.0})
HANGS_S = 2.0
"""Longest time of a transaction with a database that hangs [s]."""

Make = Callable[..., FleetRobot]


@pytest.fixture(scope="module")
def server() -> Iterator[PostgresServer]:
    with running_server() as started:
        yield started


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def database(server: PostgresServer, request: pytest.FixtureRequest) -> str:
    """Return the address of an empty database."""
    name = f"fleet_{abs(hash(request.node.name))}"
    server.execute(f"CREATE DATABASE {name}")
    return server.address.replace("/postgres?", f"/{name}?")


@pytest.fixture
def make(database: str, tmp_path: Path, clock: Clock) -> Iterator[Make]:
    with ExitStack() as made:

        def new(name: str, *, address: str = database, **fields: object) -> FleetRobot:
            robot = FleetRobot(name, tmp_path, clock, address, **fields)
            made.callback(robot.close)
            return robot

        yield new


@pytest.fixture
def anna(make: Make) -> FleetRobot:
    return make("anna")


@pytest.fixture
def ben(make: Make) -> FleetRobot:
    return make("ben")


@pytest.fixture
def rows(server: PostgresServer, database: str) -> Callable[[str], list[tuple[object, ...]]]:
    """Run a query in the robots' database."""
    return partial(server.execute, address=database)


def test_database_without_encoding_is_read_as_utf_8(make, server):
    server.execute("CREATE DATABASE plain TEMPLATE template0 ENCODING 'SQL_ASCII' LOCALE 'C'")
    address = server.address.replace("/postgres?", "/plain?")
    anna, ben = make("anna", address=address), make("ben", address=address)
    anna.robot.teach()
    synchronise(anna, ben)
    assert ben.robot.current() == anna.robot.current()


def test_twenty_robots_converge_after_three_were_offline(make, clock):
    robots = [make(f"robot-{number:02}") for number in range(20)]
    offline = robots[:3]
    for minute in range(60):
        for number, one in enumerate(robots):
            clock.now += 3.0
            if (minute + number) % 20 == 0:
                place = ("", "lobby", "hall")[number % 3]
                one.robot.teach(values=(1.0 + (number + minute) % 5, 2.0), place=place)
        if minute % 20 == 19:
            synchronise(*robots[3:])
    assert largest_difference([one.robot for one in offline]) > 0.0
    synchronise(*robots)
    assert largest_difference([one.robot for one in robots]) <= 1e-9
    total = sum(len(one.robot.steps()) for one in robots)
    assert [one.sync.status.taken for one in robots] == [
        total - len(one.robot.steps()) for one in robots
    ]


def test_persons_reasons_and_sources_stay_on_robot(make, ben, rows):
    anna = make("anna", rule=learning(layers=("person", "place")))
    anna.robot.teach(
        person="Anna Smith", place="lobby", reason="zoe said so loudly", source="her phone"
    )
    synchronise(anna, ben)
    assert "place/lobby" in ben.robot.current()
    found = str(rows("SELECT row_to_json(step)::text FROM step")).lower()
    assert [word for word in ("anna smith", "loudly", "phone") if word in found] == []


def test_unrequested_rows_from_database_are_refused_by_name(make):
    anna, ben = make("anna"), make("ben", share=Share.PLACE)
    anna.robot.teach()
    anna.sync.cycle()
    pull = ben.database.pull
    ben.database.pull = lambda wanted: pull(
        [replace(one, share=Share.EVERYTHING) for one in wanted]
    )
    ben.sync.cycle()
    assert [one.code for one in ben.sync.status.aside] == ["NOT_SHARED"]
    assert ben.robot.current() == {"": (3.0, 3.0)}


@pytest.mark.parametrize(
    ("share", "layers"), [(Share.EVERYTHING, {"", "place/lobby"}), (Share.PLACE, {"place/lobby"})]
)
def test_robot_shares_layers_named_in_agent_file(make, share, layers):
    anna, ben = make("anna", share=share), make("ben")
    anna.robot.teach()
    anna.robot.teach(place="lobby")
    synchronise(anna, ben)
    changed = {layer for layer in ben.robot.current() if layer} | (
        {""} if ben.robot.current()[""] != (3.0, 3.0) else set()
    )
    assert changed == layers


def test_robot_sharing_nothing_sends_nothing(anna, rows):
    anna.shares = {}
    anna.robot.teach()
    synchronise(anna)
    assert rows("SELECT * FROM step") == []


@pytest.mark.parametrize(
    "shares", [(Share.PLACE, Share.EVERYTHING), (Share.EVERYTHING, Share.PLACE)]
)
def test_enabling_sharing_later_shares_earlier_learning(make, shares):
    anna, ben = (
        make(name, share=share) for name, share in zip(("anna", "ben"), shares, strict=True)
    )
    anna.robot.teach()
    anna.robot.teach(place="lobby")
    synchronise(anna, ben)
    assert ben.robot.current()[""] == (3.0, 3.0)
    anna.shares = ben.shares = {"guide": Share.EVERYTHING}
    synchronise(anna, ben)
    assert largest_difference([anna.robot, ben.robot]) == 0.0


def test_agent_file_sets_weight_of_foreign_steps(anna, make):
    ben = make("ben", rule=learning(sources=("fleet",), weights=(0.5,)))
    anna.robot.teach()
    synchronise(anna, ben)
    assert anna.robot.current()[""][0] == pytest.approx(3.6)
    assert ben.robot.current()[""][0] == pytest.approx(3.3)


def test_hanging_database_neither_loses_nor_doubles_steps(anna, ben, server, monkeypatch):
    synchronise(anna, ben)
    anna.robot.teach()
    server.hold_up()
    try:
        began = time.monotonic()
        with monkeypatch.context() as short:
            short.setattr(anna.database, "_limit_s", HANGS_S)
            with pytest.raises(FleetError, match="DATABASE_AWAY"):
                anna.sync.cycle()
        assert time.monotonic() - began < 10 * HANGS_S
        anna.robot.teach()
    finally:
        server.go_on()
    synchronise(anna, ben)
    assert ben.sync.status.taken == 2
    assert largest_difference([anna.robot, ben.robot]) == 0.0


def test_repeatedly_killed_database_neither_loses_nor_doubles_steps(anna, ben, server, rows):
    synchronise(anna, ben)

    def kill() -> None:
        for _ in range(4):
            server.kill()
            server.start()

    killing = Thread(target=kill)
    killing.start()
    taught = 0
    while killing.is_alive() or taught < 20:
        anna.robot.teach(values=(1.0 + taught % 5, 2.0))
        taught += 1
        for one in (anna, ben):
            with contextlib.suppress(FleetError):
                one.sync.cycle()
    killing.join()
    synchronise(anna, ben)
    assert rows("SELECT count(*) FROM step") == [(taught,)]
    assert ben.sync.status.taken == taught
    assert largest_difference([anna.robot, ben.robot]) == 0.0


def test_repeated_or_restarted_sync_continues_from_ledger(anna, ben):
    anna.robot.teach()
    ben.robot.teach(FeedbackKind.POSITIVE, (1.0, 4.0))
    synchronise(anna, ben)
    before = [len(one.robot.ledger.entries()) for one in (anna, ben)]
    for _ in range(2):
        synchronise(anna, ben)
        assert [len(one.robot.ledger.entries()) for one in (anna, ben)] == before
        for one in (anna, ben):
            one.restart()
    anna.robot.teach()
    synchronise(anna, ben)
    assert largest_difference([anna.robot, ben.robot]) == 0.0


def test_lost_answer_does_not_double_step(anna, ben):
    anna.robot.teach()
    anna.sync.cycle()
    deliver = ben.sync._deliver

    def deliver_and_lose(document: str) -> str:
        deliver(document)
        raise BtAgentsError("the feedback node has not answered")

    ben.sync._deliver = deliver_and_lose
    with pytest.raises(BtAgentsError):
        ben.sync.cycle()
    ben.sync._deliver = deliver
    ben.sync.cycle()
    assert [row.cause.cause for _, row in ben.robot.ledger.entries()] == ["authored", "fleet"]


def test_steps_are_pushed_while_feedback_node_is_away(anna, ben):
    anna.robot.teach()
    anna.sync.cycle()
    ben.feedback_node_is_there = False
    ben.robot.teach()
    with pytest.raises(BtAgentsError, match="away"):
        ben.sync.cycle()
    anna.sync.cycle()
    assert anna.sync.status.taken == 1
    ben.feedback_node_is_there = True
    synchronise(anna, ben)
    assert largest_difference([anna.robot, ben.robot]) == 0.0


def test_steps_wait_for_unknown_agent(anna, ben):
    anna.robot.teach()
    anna.sync.cycle()
    agents, ben.robot.profiles._agents = ben.robot.profiles._agents, {}
    ben.sync.cycle()
    assert (ben.sync.status.taken, ben.sync.status.refused) == (0, 0)
    ben.robot.profiles._agents = agents
    ben.sync.cycle()
    assert ben.sync.status.taken == 1


def test_robot_imports_steps_once_agent_files_match(anna, ben):
    anna.robot.introduce(authored=2.0)
    anna.robot.teach()
    synchronise(anna, ben)
    assert ben.robot.current() == {"": (3.0, 3.0)}
    ben.robot.introduce(authored=2.0)
    synchronise(anna, ben)
    assert largest_difference([anna.robot, ben.robot]) == 0.0


def test_second_ledger_under_same_robot_name_is_refused(anna, tmp_path, clock, database):
    anna.robot.teach()
    synchronise(anna)
    (tmp_path / "other").mkdir()
    clock.now += 1.0
    other = FleetRobot("anna", tmp_path / "other", clock, database)
    with closing(other):
        other.robot.teach(values=(1.0, 1.0))
        other.robot.teach(values=(1.0, 1.0))
        with pytest.raises(Refused, match="OTHER_LEDGER"):
            other.sync.cycle()


def test_ledger_joining_under_second_name_is_refused(anna, clock, database):
    anna.robot.teach()
    synchronise(anna)
    with closing(FleetDatabase(database, "zoe", limit_s=LIMIT_S)) as second:
        second.join()
        anna.database.close()
        anna.sync = FleetSync(
            "zoe", SPACE, anna.path, second, lambda _document: "", lambda: anna.shares, wall=clock
        )
        with pytest.raises(FleetError, match="LEDGER_TAKEN"):
            anna.sync.cycle()


def test_renamed_robot_recovers_shared_steps_without_its_ledger(anna, make):
    anna.robot.teach()
    synchronise(anna)
    new = make("anna-2")
    synchronise(new)
    assert new.robot.current() == anna.robot.current()


def test_robot_needs_no_permission_to_create_tables(make, server, database, rows):
    make("anna")
    server.execute("DROP ROLE IF EXISTS robots")
    rows("CREATE ROLE robots LOGIN")
    tables = "SELECT, INSERT, UPDATE, DELETE ON ALL TABLES IN SCHEMA public"
    rows(f"GRANT {tables} TO robots")
    rows("GRANT USAGE ON ALL SEQUENCES IN SCHEMA public TO robots")
    ben = make("ben", address=database.replace("//fleet@", "//robots@"))
    ben.robot.teach()
    synchronise(ben)
    assert rows("SELECT robot FROM step") == [("ben",)]


def test_robot_joins_server_from_compose_file(tmp_path):
    deploy = Path(str(files("bt_agents_fleet"))) / "deploy"
    service = yaml.safe_load((deploy / "compose.yaml").read_text())["services"]["database"]
    of_image = service["environment"]
    program, *settings = service["command"]
    assert program == "postgres"
    assert of_image["POSTGRES_PASSWORD_FILE"] == f"/run/secrets/{service['secrets'][0]}"
    port = int(service["ports"][0].partition(":")[2])
    assert port == 5432  # the default port of an address
    authority, other = tmp_path / "authority.crt", tmp_path / "other.crt"
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    # Like its image: create the data folder with the password and the arguments.
    initdb = of_image["POSTGRES_INITDB_ARGS"].split()
    with running_server(password="secret", initdb=initdb) as server:
        server.execute(f"CREATE DATABASE {of_image['POSTGRES_DB']}")
        server.certify(other)
        server.certify(authority)
        mounted = {
            target: {"server.crt": server.certificate, "server.key": server.key}[Path(own).name]
            for own, target, _ in (one.split(":") for one in service["volumes"][1:])
        }
        for target, file in mounted.items():
            settings = [word.replace(target, str(file)) for word in settings]
        assert not any("/etc/fleet" in word for word in settings)
        server.kill()
        server.start(port, settings)
        user, name = of_image["POSTGRES_USER"], of_image["POSTGRES_DB"]
        passwords = tmp_path / "passwords"

        def join(
            host: str = "localhost", certificate: Path = authority, password: str = "secret"
        ) -> None:
            passwords.write_text(f"{host}:*:*:*:{password}\n")
            passwords.chmod(0o600)
            options = f"sslrootcert={certificate}&passfile={passwords}"
            address = checked_address(f"postgresql://{user}@{host}:{port}/{name}?{options}")
            with closing(FleetDatabase(address, "anna", limit_s=LIMIT_S)) as opened:
                opened.join()

        join()
        with pytest.raises(FleetError, match="password authentication failed"):
            join(password="guessed")
        with pytest.raises(FleetError, match="certificate verify failed"):
            join(certificate=other)
        with pytest.raises(FleetError, match="does not match host name"):
            join("127.0.0.1")
        assert service["healthcheck"]["test"] == ["CMD-SHELL", f"pg_isready -U {user} -d {name}"]


def test_restored_old_database_is_refilled(anna, ben, rows):
    anna.robot.teach()
    synchronise(anna, ben)
    rows("DELETE FROM step")
    rows("UPDATE robot SET position = 0")
    rows("ALTER SEQUENCE step_arrival_seq RESTART WITH 1")
    anna.robot.teach()
    for one in (anna, ben):
        one.restart()
    synchronise(anna, ben)
    assert ben.sync.status.taken == 2
    assert largest_difference([anna.robot, ben.robot]) == 0.0


GOOD = {
    "layer": "''",
    "event": "'feedback'",
    "kind": "0",
    "target": """'{"age": 5}'""",
    "weight": "1",
    "changes": "0",
    "stamp": "1700000000",
}


HOSTILE = (
    ("weight", "'NaN'", "BAD_STEP"),
    ("stamp", "'Infinity'", "BAD_STEP"),
    ("target", """'{"age": 1e400}'""", "BAD_STEP"),
    ("target", "'[1, 2, 3]'", "BAD_STEP"),
    ("target", "to_jsonb(repeat('x', 1000000))", "BAD_STEP"),
    ("layer", "repeat('place/x', 100000)", "BAD_LAYER"),
)
"""Column → its value instead of the one in :data:`GOOD`, and the code of the refusal."""


def test_hostile_rows_are_refused_without_blocking_others(anna, ben, rows):
    for one in ("agent", "layer", "target"):
        rows(f"ALTER TABLE step DROP CONSTRAINT step_{one}_is_short")
    for number, (field, value, _) in enumerate(HOSTILE, start=100):
        columns = {**GOOD, "number": str(number), field: value}
        rows(
            f"INSERT INTO step (robot, agent, base, {', '.join(columns)}) "
            f"VALUES ('anna', 'guide', '{BASE}', {', '.join(columns.values())})"
        )
    anna.robot.teach()
    synchronise(anna, ben)
    refused = {one.number: one.code for one in ben.sync.status.aside}
    assert refused == {number: code for number, (_, _, code) in enumerate(HOSTILE, start=100)}
    assert ben.sync.status.taken == 1
    assert ben.robot.current() == anna.robot.current()
    ben.restart()
    synchronise(anna, ben)
    assert (ben.sync.status.taken, ben.sync.status.refused) == (1, len(HOSTILE))


def test_newer_schema_is_refused_by_name(anna, rows):
    rows("INSERT INTO schema_version (version) VALUES (99)")
    with pytest.raises(FleetError, match="SCHEMA_NEWER"):
        anna.sync.cycle()
    with pytest.raises(FleetError, match="SCHEMA_NEWER"):
        anna.database.join()


def test_robot_without_tables_or_row_is_refused_by_name(database, make):
    with closing(FleetDatabase(database, "zoe", limit_s=LIMIT_S)) as opened:
        with pytest.raises(FleetError, match="SCHEMA_OLD"):
            opened.connect()
        make("anna")
        with pytest.raises(FleetError, match="NOT_JOINED"):
            opened.position()


def test_many_robots_can_join_concurrently(database):
    def join(number: int) -> None:
        with closing(FleetDatabase(database, f"robot-{number}", limit_s=LIMIT_S)) as opened:
            opened.join()

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(join, range(8)))


def test_push_wakes_waiting_robot(anna, ben):
    synchronise(anna, ben)
    anna.robot.teach()
    anna.sync.cycle()
    began = time.monotonic()
    ben.database.wait(60.0)
    assert time.monotonic() - began < 30.0


def test_leaving_robot_may_remove_its_steps(anna, ben, rows):
    anna.robot.teach()
    synchronise(anna, ben)
    anna.database.erase()
    assert rows("SELECT robot FROM robot") == [("ben",)]
    assert rows("SELECT * FROM step") == []


def test_forgetting_place_reaches_all_robots_and_database(anna, ben, rows):
    anna.robot.teach(place="lobby")
    ben.robot.teach(place="lobby", values=(1.0, NAN))
    anna.robot.teach(place="hall")
    synchronise(anna, ben)
    anna.robot.forget("place/lobby")
    synchronise(anna, ben)
    assert anna.robot.current().keys() == ben.robot.current().keys() == {"", "place/hall"}
    assert largest_difference([anna.robot, ben.robot]) == 0.0
    assert rows("SELECT 1 FROM step WHERE layer = 'place/lobby'") == []
    forgettings = "SELECT robot FROM step WHERE event = 'forget'"
    assert rows(forgettings) == [("anna",)]
    for one in (anna, ben):
        one.restart()
    synchronise(anna, ben)
    assert rows(forgettings) == [("anna",)]
    for one in (anna, ben):
        assert "place/lobby" not in one.robot.current()


def test_offline_robots_older_steps_do_not_undo_forgetting(make, clock, rows):
    anna, ben, cleo = make("anna"), make("ben"), make("cleo")
    anna.robot.teach(place="lobby")
    cleo.robot.teach(place="lobby", values=(1.0, NAN))
    clock.now += 60.0
    anna.robot.forget("place/lobby")
    synchronise(anna, ben)
    clock.now += 60.0
    synchronise(cleo, anna, ben)
    assert rows("SELECT 1 FROM step WHERE layer = 'place/lobby'") == []
    for one in (anna, ben, cleo):
        assert "place/lobby" not in one.robot.current()
    assert largest_difference([anna.robot, ben.robot, cleo.robot]) <= 1e-9


def test_steps_after_forgetting_count_from_uninformed_robots(make, clock, rows):
    anna, ben, cleo = make("anna"), make("ben"), make("cleo")
    anna.robot.teach(place="lobby")
    cleo.robot.teach(place="lobby", values=(1.0, NAN))
    clock.now += 60.0
    anna.robot.forget("place/lobby")
    clock.now += 60.0
    cleo.robot.teach(place="lobby", values=(4.0, NAN))
    synchronise(anna, ben)
    synchronise(cleo, anna, ben)
    synchronise(cleo, anna, ben)
    # From the file's profile, 3, towards 4 with the rate 0.3: earlier steps are gone.
    assert cleo.robot.current()["place/lobby"][0] == pytest.approx(3.3)
    assert largest_difference([anna.robot, ben.robot, cleo.robot]) <= 1e-9
    kept = "SELECT robot, event FROM step WHERE layer = 'place/lobby'"
    assert rows(kept) == [("cleo", "feedback")]
    for one in (anna, ben, cleo):
        with closing(connect(str(one.path), "ro")) as ledger:
            assert check(ledger).problems == []
        one.restart()
    cleo.robot.teach(place="lobby", values=(4.0, NAN))
    synchronise(cleo, anna, ben)
    assert largest_difference([anna.robot, ben.robot, cleo.robot]) <= 1e-9


def test_step_pushed_before_known_forgetting_is_not_doubled(anna, ben, clock, rows):
    clock.now += 60.0
    anna.robot.teach(place="lobby")
    anna.robot.forget("place/lobby")
    clock.now += 60.0
    ben.robot.teach(place="lobby", values=(4.0, NAN))
    ben.sync.cycle()
    synchronise(anna, ben)
    ben.shares = {"guide": Share.PLACE}
    synchronise(ben, anna)
    feedback = "SELECT count(*) FROM step WHERE event = 'feedback' AND robot = 'ben'"
    assert rows(feedback) == [(2,)]  # the place and everybody, once each
    assert anna.robot.current()["place/lobby"] == ben.robot.current()["place/lobby"]


def test_robot_with_different_agent_file_still_forgets(anna, ben):
    anna.robot.teach(place="lobby")
    synchronise(anna, ben)
    ben.robot.introduce(authored=2.0)
    anna.robot.forget("place/lobby")
    synchronise(anna, ben)
    assert "place/lobby" not in ben.robot.current()


def test_first_schema_version_is_migrated_with_its_steps(anna, make, rows):
    anna.robot.teach()
    synchronise(anna)
    rows("DROP INDEX step_that_forgets")
    rows("DELETE FROM schema_version WHERE version = 2")
    with pytest.raises(FleetError, match="SCHEMA_OLD"):
        anna.database.robots()
    anna.database.join()
    ben = make("ben")
    synchronise(anna, ben)
    assert largest_difference([anna.robot, ben.robot]) == 0.0


@pytest.mark.parametrize(
    ("address", "modes"),
    [
        ("postgresql://robots@db.example/fleet", ["verify-full"]),
        ("host=db.example sslmode=require", ["require"]),
        ("hostaddr=192.168.1.9 dbname=fleet", ["verify-full"]),
        ("host=/run/postgresql,db.example dbname=fleet", ["verify-full"]),
        ("dbname=fleet", ["verify-full"]),
    ],
)
def test_remote_server_certificate_is_checked_by_default(address, modes):
    assert re.findall(r"sslmode=(\S+)", checked_address(address)) == modes


def test_files_in_address_become_absolute_paths(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    address = checked_address("host=a sslrootcert=fleet.crt sslkey=k passfile=/etc/passwords")
    assert f"sslrootcert={tmp_path}/fleet.crt" in address
    assert f"sslkey={tmp_path}/k" in address
    assert "passfile=/etc/passwords" in address
    assert "sslrootcert=system" in checked_address("host=a sslrootcert=system")


@pytest.mark.parametrize(
    ("address", "code"),
    [
        ("postgresql://robots:secret@db.example/fleet", "PASSWORD_IN_ADDRESS"),
        ("host=a sslpassword=secret", "PASSWORD_IN_ADDRESS"),
        ("postgresql://[", "BAD_ADDRESS"),
        ("colour=green", "BAD_ADDRESS"),
    ],
)
def test_unusable_address_is_refused(address, code):
    with pytest.raises(FleetError) as refusal:
        checked_address(address)
    assert refusal.value.code == code
    assert "secret" not in str(refusal.value)
