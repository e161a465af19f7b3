# SPDX-License-Identifier: Apache-2.0
"""What a host says of a run that it stopped, as far as the market goes by it."""

from __future__ import annotations

AS_TOLD = "the market stopped it"
"""Message of a run that was stopped only because the market told the host to."""

CUT_OFF = "its market "
"""How the message of a run begins that was broken off because its market was lost."""
