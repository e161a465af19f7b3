# SPDX-License-Identifier: Apache-2.0
"""Every code that a problem of a file can have, documented by a wrong and a right example."""
