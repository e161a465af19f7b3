# SPDX-License-Identifier: Apache-2.0
"""Installs bt_agents_fleet as a ROS package."""

from setuptools import find_packages, setup

setup(
    name="bt_agents_fleet",
    version="0.1.0",
    description="Robots of a fleet that learn together, over a PostgreSQL database.",
    license="Apache-2.0",
    maintainer="bt-agents maintainers",
    maintainer_email="maintainers@bt-agents.invalid",
    packages=find_packages(include=["bt_agents_fleet", "bt_agents_fleet.*"]),
    package_data={"bt_agents_fleet": ["py.typed", "migrations/*.sql", "deploy/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/bt_agents_fleet"]),
        ("share/bt_agents_fleet", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest", "hypothesis"]},
    zip_safe=True,
    entry_points={"bt_agents.commands": ["fleet = bt_agents_fleet.commands:fleet"]},
)
