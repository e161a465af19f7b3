# SPDX-License-Identifier: Apache-2.0
"""What the nodes of the system share: base node, executor, QoS, calls and parameters."""
