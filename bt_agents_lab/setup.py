# SPDX-License-Identifier: Apache-2.0
"""Installs bt_agents_lab as a ROS package."""

from setuptools import find_packages, setup

setup(
    name="bt_agents_lab",
    version="0.1.0",
    description="A journal of everything that was decided, its replay, and experiments.",
    license="Apache-2.0",
    maintainer="bt-agents maintainers",
    maintainer_email="maintainers@bt-agents.invalid",
    packages=find_packages(include=["bt_agents_lab", "bt_agents_lab.*"]),
    package_data={"bt_agents_lab": ["py.typed", "experiments/*.yaml", "foxglove/*.json"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/bt_agents_lab"]),
        ("share/bt_agents_lab", ["package.xml"]),
        ("share/bt_agents_lab/foxglove", ["bt_agents_lab/foxglove/bt_agents.json"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest", "hypothesis"]},
    zip_safe=True,
    entry_points={
        "bt_agents.commands": [
            "experiment = bt_agents_lab.cli.experiment:experiment",
            "journal = bt_agents_lab.cli.journal:journal",
            "replay = bt_agents_lab.cli.replay:replay",
            "trace = bt_agents_lab.cli.trace:trace",
            "what-if = bt_agents_lab.cli.what_if:what_if",
        ],
        "console_scripts": ["journal = bt_agents_lab:run_journal"],
    },
)
