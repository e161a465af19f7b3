# SPDX-License-Identifier: Apache-2.0
"""Installs bt_agents_tools as a ROS package."""

from setuptools import find_packages, setup

setup(
    name="bt_agents_tools",
    version="0.1.0",
    description="The command line, the launcher, rehearsals and tests of agents.",
    license="Apache-2.0",
    maintainer="bt-agents maintainers",
    maintainer_email="maintainers@bt-agents.invalid",
    packages=find_packages(include=["bt_agents_tools", "bt_agents_tools.*"]),
    package_data={"bt_agents_tools": ["py.typed", "launcher/*.xml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/bt_agents_tools"]),
        ("share/bt_agents_tools", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest", "hypothesis"]},
    zip_safe=True,
    entry_points={
        "console_scripts": ["bt-agents = bt_agents_tools.cli:main"],
        "pytest11": ["bt_agents = bt_agents_tools.rehearsal.pytest_plugin"],
    },
)
