# SPDX-License-Identifier: Apache-2.0
"""Standard streams of a command: in any encoding, closed, full, or without a reader."""

from __future__ import annotations

import codecs
import errno
import io
import os
import sys
from typing import Any, TextIO

_STREAMS = ("stdin", "stdout", "stderr")

_ERRORS = "bt_agents_plain"
_ASCII = "bt_agents_ascii"
"""Another name for ASCII: click treats an ASCII stream as a mistake, and writes UTF-8."""

_PLAIN = {
    **dict(zip("–—−─·│├└•●◆✔×✘▶▷○◇■▼µ⟨⟩", "-----|||***+xx>>oo#vu<>", strict=True)),
    **dict(
        zip("→←…±≥≤√²∞", ("->", "<-", "...", "+-", ">=", "<=", "sqrt", "^2", "inf"), strict=True)
    ),
}
"""Replacements for characters that an encoding lacks; others become ``\\u2605``."""

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class OutputLost(BaseException):
    """Raised by the first failing write to standard output; no library catches it."""

    def __init__(self, error: OSError) -> None:
        super().__init__(str(error))
        self.error = error

    @property
    def is_left(self) -> bool:
        """Whether the reader of the output has left, as ``head`` does."""
        return self.error.errno == errno.EPIPE


class _Output(io.FileIO):
    """Raw stream that swallows everything after its first error."""

    def __init__(self, descriptor: int, raises: bool) -> None:
        super().__init__(descriptor, "w", closefd=False)
        self._raises = raises
        self._lost = False

    def write(self, data: Any, /) -> int:
        if not self._lost:
            try:
                return super().write(data)
            except BlockingIOError:
                raise
            except OSError as error:
                self._lost = True
                if self._raises:
                    raise OutputLost(error) from None
        return memoryview(data).nbytes


def prepare_streams() -> None:
    """Make the standard streams usable, whatever the shell provides.

    A closed stream is opened to the null device, so that no file gets its number. Characters that
    the encoding lacks are replaced. A failing write to standard output raises :class:`OutputLost`
    once; a failing write to standard error is lost.
    """
    codecs.register_error(_ERRORS, _plain)
    codecs.register(_find_codec)
    for name in _STREAMS:
        if getattr(sys, name) is None:
            descriptor = os.open(os.devnull, os.O_RDWR)
            os.set_inheritable(descriptor, True)
            mode = "r" if name == "stdin" else "w"
            setattr(sys, name, open(descriptor, mode, encoding="utf-8", closefd=False))  # noqa: SIM115
    if isinstance(sys.stdin, io.TextIOWrapper):
        sys.stdin.reconfigure(errors="replace")
    sys.stdout = _output(sys.stdout, raises=True)
    sys.stderr = _output(sys.stderr, raises=False)


def os_error_text(error: OSError) -> str:
    """Return a system error as text for people: the file, the problem, and how to fix it."""
    names = [str(name) for name in (error.filename, error.filename2) if name is not None]
    text = ": ".join([*names, error.strerror or str(error)])
    if error.errno in _FULL:
        text += "; make room, or write to another place"
    return text


def _output(stream: TextIO, raises: bool) -> TextIO:
    encoding = stream.encoding
    if codecs.lookup(encoding).name == "ascii":
        encoding = _ASCII
    return io.TextIOWrapper(
        io.BufferedWriter(_Output(stream.fileno(), raises)),
        encoding=encoding,
        errors=_ERRORS,
        line_buffering=not raises or stream.isatty() or bool(os.environ.get("PYTHONUNBUFFERED")),
    )


def _plain(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    found = error.object[error.start : error.end]
    return "".join(_PLAIN.get(one) or ascii(one)[1:-1] for one in found), error.end


def _find_codec(name: str) -> codecs.CodecInfo | None:
    if name != _ASCII:
        return None
    found = codecs.lookup("ascii")
    return codecs.CodecInfo(
        found.encode,
        found.decode,
        found.streamreader,
        found.streamwriter,
        found.incrementalencoder,
        found.incrementaldecoder,
        name=_ASCII,
    )
