# SPDX-License-Identifier: Apache-2.0
"""Bags in the format of ``ros2 bag record`` of Jazzy, made from a system's messages."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from pathlib import Path

import yaml
import zstandard
from mcap.writer import CompressionType, Writer
from rclpy.serialization import serialize_message

from journal_fixture import PublishedMessage, topic_of

QOS = """\
- history: 1
  depth: 1000
  reliability: 1
  durability: 2
  deadline:
    sec: 9223372036
    nsec: 854775807
  lifespan:
    sec: 9223372036
    nsec: 854775807
  liveliness: 1
  liveliness_lease_duration:
    sec: 9223372036
    nsec: 854775807
  avoid_ros_namespace_conventions: false"""
HASH = "RIHS01_" + "0" * 64


def write_bag(
    folder: Path,
    messages: Sequence[PublishedMessage],
    *,
    files: int = 1,
    namespace: str = "",
    chunks: CompressionType = CompressionType.NONE,
    use_chunking: bool = True,
    packed: bool = False,
    is_sent_known: bool = True,
    definitions: bool = True,
) -> Path:
    """Write the folder of a bag: split files, then its ``metadata.yaml``; return it.

    Args:
        folder: Created by this function.
        messages: Messages in order of receipt.
        files: Number of files to split them over.
        namespace: Namespace of the system, for example ``/robot1``.
        chunks: Compression of the chunks of each file.
        use_chunking: False writes like the preset ``fastwrite``.
        packed: True compresses each file as a whole.
        is_sent_known: False writes like a recorder that does not know when a message was sent.
        definitions: False writes like a recorder without the packages of the messages.
    """
    folder.mkdir(parents=True)
    size = -(-len(messages) // files)
    names, counts = [], []
    for number in range(files):
        part = messages[number * size : (number + 1) * size]
        stream = io.BytesIO()
        writer = Writer(stream, compression=chunks, use_chunking=use_chunking)
        writer.start(profile="ros2", library="libmcap 1.1.0")
        known: dict[str, tuple[int, str]] = {}
        schemas: dict[str, int] = {}
        for place, one in enumerate(part, number * size + 1):
            if one.topic not in known:
                topic = topic_of(type(one.message), f"{namespace}{one.topic}")
                if topic.type not in schemas:
                    schemas[topic.type] = writer.register_schema(
                        name=topic.type,
                        encoding="ros2msg" if definitions else "unknown",
                        data=topic.definition.encode() if definitions else b"",
                    )
                channel = writer.register_channel(
                    topic=topic.name,
                    message_encoding="cdr",
                    schema_id=schemas[topic.type],
                    metadata={"offered_qos_profiles": QOS, "topic_type_hash": HASH},
                )
                known[one.topic] = (channel, topic.type)
            writer.add_message(
                channel_id=known[one.topic][0],
                log_time=place + 1000,
                data=serialize_message(one.message),
                publish_time=place if is_sent_known else 0,
                # Rosbag2 does not number messages.
                sequence=0,
            )
        writer.add_metadata("rosbag2", {"serialized_metadata": "version: 9"})
        writer.finish()
        name = f"{folder.name}_{number}.mcap" + (".zstd" if packed else "")
        content = stream.getvalue()
        (folder / name).write_bytes(zstandard.compress(content) if packed else content)
        names.append(name)
        counts.append(len(part))
    _write_metadata(folder, messages, names, counts, packed=packed, namespace=namespace)
    return folder


def _write_metadata(
    folder: Path,
    messages: Sequence[PublishedMessage],
    names: Sequence[str],
    counts: Sequence[int],
    *,
    packed: bool,
    namespace: str,
) -> None:
    information = {
        "version": 9,
        "storage_identifier": "mcap",
        "duration": {"nanoseconds": len(messages)},
        "starting_time": {"nanoseconds_since_epoch": 1001},
        "message_count": len(messages),
        "topics_with_message_count": list(_topics(messages, namespace)),
        "compression_format": "zstd" if packed else "",
        "compression_mode": "FILE" if packed else "",
        "relative_file_paths": list(names),
        "files": [
            {
                "path": name,
                "starting_time": {"nanoseconds_since_epoch": 1001},
                "duration": {"nanoseconds": count},
                "message_count": count,
            }
            for name, count in zip(names, counts, strict=True)
        ],
        "custom_data": None,
        "ros_distro": "jazzy",
    }
    text = yaml.safe_dump({"rosbag2_bagfile_information": information}, sort_keys=False)
    (folder / "metadata.yaml").write_text(text)


def _topics(messages: Sequence[PublishedMessage], namespace: str) -> Iterator[dict[str, object]]:
    for name in dict.fromkeys(one.topic for one in messages):
        of_topic = [one for one in messages if one.topic == name]
        yield {
            "topic_metadata": {
                "name": f"{namespace}{name}",
                "type": topic_of(type(of_topic[0].message), name).type,
                "serialization_format": "cdr",
                "offered_qos_profiles": yaml.safe_load(QOS),
                "type_description_hash": HASH,
            },
            "message_count": len(of_topic),
        }
