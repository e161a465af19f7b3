# SPDX-License-Identifier: Apache-2.0
"""Bags in the format of ``ros2 bag record`` of Jazzy, made from a system's messages."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import yaml
import zstandard
from mcap.writer import CompressionType, Writer
from rclpy.serialization import serialize_message

from journal_fixture import PublishedMessage, topic_of


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
    names = []
    for number in range(files):
        part = messages[number * size : (number + 1) * size]
        stream = io.BytesIO()
        writer = Writer(stream, compression=chunks, use_chunking=use_chunking)
        writer.start(profile="ros2", library="libmcap 1.1.0")
        channels: dict[str, int] = {}
        schemas: dict[str, int] = {}
        for place, one in enumerate(part, number * size + 1):
            if one.topic not in channels:
                topic = topic_of(type(one.message), f"{namespace}{one.topic}")
                if topic.type not in schemas:
                    schemas[topic.type] = writer.register_schema(
                        name=topic.type,
                        encoding="ros2msg" if definitions else "unknown",
                        data=topic.definition.encode() if definitions else b"",
                    )
                channels[one.topic] = writer.register_channel(
                    topic=topic.name, message_encoding="cdr", schema_id=schemas[topic.type]
                )
            writer.add_message(
                channel_id=channels[one.topic],
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
    information = {
        "version": 9,
        "storage_identifier": "mcap",
        "message_count": len(messages),
        "compression_mode": "FILE" if packed else "",
        "relative_file_paths": names,
        "files": [{"path": name, "message_count": size} for name in names],
        "custom_data": None,
    }
    text = yaml.safe_dump({"rosbag2_bagfile_information": information}, sort_keys=False)
    (folder / "metadata.yaml").write_text(text)
    return folder
