# SPDX-License-Identifier: Apache-2.0
"""Installs scene_layer as a ROS package."""

from setuptools import find_packages, setup

setup(
    name="scene_layer",
    version="0.1.0",
    description="Turns sensor readings into the vector that describes an interaction.",
    license="Apache-2.0",
    maintainer="bt-agents maintainers",
    maintainer_email="maintainers@bt-agents.invalid",
    packages=find_packages(include=["scene_layer", "scene_layer.*"]),
    package_data={"scene_layer": ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/scene_layer"]),
        ("share/scene_layer", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest", "hypothesis"]},
    zip_safe=True,
    entry_points={"console_scripts": ["scene_layer = scene_layer:main"]},
)
