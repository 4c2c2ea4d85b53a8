from glob import glob

from setuptools import find_packages, setup

PACKAGE = "phd_jdtc_ros"
EXECUTABLES = (
    "sensor_replay",
    "tracker",
    "evaluator",
    "track_bag",
    "simulate",
    "asterix_bridge",
    "report_bridge",
    "tune",
    "register",
    "report",
    "monte_carlo",
    "hand_over",
    "compile_engines",
    "picture",
    "demo",
)

# Folders whose files are installed as they are.
FOLDERS = ["launch", "rviz", "foxglove", "config", *sorted(glob("config/*/") + glob("bags/*/"))]

# The parts of ROS 2 that are on PyPI. A ROS installation brings its own, so they are an extra.
ROS_WHEELS = ["ros-jazzy-rclpy[fastrtps]", "ros-jazzy-common-interfaces"]

setup(
    name=PACKAGE,
    version="1.0.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*", "msg_adapters", "msg_adapters.*"]),
    package_data={f"{PACKAGE}.report.page": ["assets/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        *((f"share/{PACKAGE}/{folder}", glob(f"{folder}/*.*")) for folder in FOLDERS),
    ],
    python_requires=">=3.10",
    install_requires=[
        "setuptools",
        "numpy>=1.26",
        "scipy>=1.11",
        "matplotlib>=3.6",
        "plotly>=5.15",
        "mcap>=1.1",
        "lz4>=4.0",
        "zstandard>=0.22",
        "pyyaml>=6",
        "rich>=13",
        "pyproj>=3.6",
        "libasterix>=0.36",
        # Compiles the step; without it the tracker does the same slowly.
        "numba>=0.59",
    ],
    extras_require={
        "ros": ROS_WHEELS,
        # Writes messages of SAPIENT.
        "sapient": ["sapient-proto>=0.1"],
        # Serves the live picture.
        "picture": ["aiohttp>=3.9"],
        # Checks the polygons of the parameter zones.
        "zones": ["shapely>=2.0"],
        # What report_bridge decodes AIS and raw 1090 MHz with.
        "ais": ["pyais>=3"],
        "adsb": ["rs1090>=0.5"],
        "test": [
            "pytest",
            "pytest-timeout",
            "hypothesis",
            "rosbags",
            "shapely>=2.0",
            "aiohttp>=3.9",
            # Readers of what the tracker sends to other programs.
            "pynmea2",
            "sapient-pydantic",
            "takproto",
            # Decoders of AIS and of raw 1090 MHz, which `report_bridge` imports when they are used.
            "pyais>=3",
            "rs1090>=0.5",
        ],
        # Apart from the others, because numba imports it where it is installed.
        "coverage": ["coverage>=7.10.4"],
        "study": ["dask", "distributed"],
        "peers": ["stonesoup>=1.9,<2"],
        "docs": ["mkdocs>=1.6,<2", "mkdocs-material>=9.5", "latex2mathml>=3.77"],
        "dev": ["ruff", "mypy", "types-PyYAML", "import-linter", "pre-commit"],
        "mutants": ["mutmut>=3.8,<4"],
    },
    zip_safe=True,
    maintainer="Seed a9b9ba5d maintainers",
    maintainer_email="maintainers@users.noreply.h-seed-a9b9ba5d.example",
    description=(
        "Live multi-sensor joint detection, tracking and classification with labelled "
        "multi-Bernoulli filter of Gaussian mixtures, soft association and a fixed-lag "
        "smoother, for radars that publish polar detections with amplitudes."
    ),
    license="Apache-2.0",
    entry_points={
        "console_scripts": [f"{name} = {PACKAGE}.__main__:{name}" for name in EXECUTABLES],
    },
)
