# SPDX-License-Identifier: Apache-2.0
"""Templates of files that authors start from."""
