# SPDX-License-Identifier: Apache-2.0
"""Installs marketplace_node as a ROS package."""

from setuptools import find_packages, setup

setup(
    name="marketplace_node",
    version="0.1.0",
    description="Calls for bids, ranks them and awards the run to one agent.",
    license="Apache-2.0",
    maintainer="bt-agents maintainers",
    maintainer_email="maintainers@bt-agents.invalid",
    packages=find_packages(include=["marketplace_node", "marketplace_node.*"]),
    package_data={"marketplace_node": ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/marketplace_node"]),
        ("share/marketplace_node", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest", "hypothesis"]},
    zip_safe=True,
    entry_points={
        "console_scripts": [
            "marketplace = marketplace_node:main",
            "selector = marketplace_node:selector",
        ]
    },
)
