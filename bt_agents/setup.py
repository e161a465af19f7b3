# SPDX-License-Identifier: Apache-2.0
"""Installs bt_agents as a ROS package."""

from setuptools import find_packages, setup

setup(
    name="bt_agents",
    version="0.1.0",
    description="The runtime: ticks behaviour trees and hosts agents as a ROS node.",
    license="Apache-2.0",
    maintainer="bt-agents maintainers",
    maintainer_email="maintainers@bt-agents.invalid",
    packages=find_packages(include=["bt_agents", "bt_agents.*"]),
    package_data={"bt_agents": ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/bt_agents"]),
        ("share/bt_agents", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest", "hypothesis"]},
    zip_safe=True,
    entry_points={"console_scripts": ["agents = bt_agents:main"]},
)
