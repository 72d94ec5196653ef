# For colcon alone; pip and uv build from pyproject.toml.
from setuptools import setup

setup(
    name="crawler_ros",
    version="0.1.0",
    packages=["crawler_model", "crawler_ros", "msgs_config"],
    package_data={"crawler_model": ["py.typed"], "msgs_config": ["*.yaml", "*.json", "scenes/*.yaml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/crawler_ros"]),
        ("share/crawler_ros", ["package.xml"]),
    ],
    zip_safe=False,
    extras_require={"test": ["pytest"]},
    entry_points={
        "console_scripts": [
            "simulator = crawler_ros.simulator:main",
            "gait_player = crawler_ros.gait_player:main",
            "crawler = crawler_ros.cli:main",
        ]
    },
)
