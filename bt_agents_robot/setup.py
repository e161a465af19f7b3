# SPDX-License-Identifier: Apache-2.0
"""Installs bt_agents_robot as a ROS package."""

from setuptools import find_packages, setup

setup(
    name="bt_agents_robot",
    version="0.1.0",
    description="A simulated robot and its visitors, behind real ROS interfaces.",
    license="Apache-2.0",
    maintainer="bt-agents maintainers",
    maintainer_email="maintainers@bt-agents.invalid",
    packages=find_packages(include=["bt_agents_robot", "bt_agents_robot.*"]),
    package_data={"bt_agents_robot": ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/bt_agents_robot"]),
        ("share/bt_agents_robot", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest", "hypothesis"]},
    zip_safe=True,
    entry_points={
        "console_scripts": [
            "robot = bt_agents_robot:run_robot",
            "visitors = bt_agents_robot:run_visitors",
        ]
    },
)
