# SPDX-License-Identifier: Apache-2.0
"""Commands of `bt-agents` for the journal and for experiments."""
