# SPDX-License-Identifier: Apache-2.0
"""Security files: who may use which topic, service and action, and TLS between machines."""
